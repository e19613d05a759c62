"""Tests of `fltea doctor` on simulated machines: each finding, and the advice that comes with it."""

import os
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest
from fltea.diagnostics.finding import Finding
from fltea.machine.doctor.checks_host import check_packages, check_service, check_udev
from fltea.machine.doctor.checks_i2c import check_i2c
from fltea.machine.doctor.checks_outputs import check_outputs
from fltea.machine.doctor.diagnosis import check_source, examine
from fltea.settings.config import load_configs
from fltea.settings.extras import how_to_install
from fltea.sources.i2c.chips import CHIPS
from fltea.wire.sensors import SENSORS

from tests.rig.fake_system import FakeSystem, finding_of, levels


def outputs(system: FakeSystem, **settings: object) -> list[Finding]:
    (config,) = load_configs(None, {name.replace("__", "."): value for name, value in settings.items()})
    return list(check_outputs([config], system))


def test_a_machine_without_a_board_is_looked_at_as_a_whole(system: FakeSystem) -> None:
    findings = list(examine(load_configs(None, {}), system))
    assert levels(findings) == {
        "program": "ok",
        "native": "ok",
        "packages": "ok",
        "port": "problem",
        "clock": "ok",
        "udev rule": "ok",
        "ModemManager": "ok",
    }
    assert finding_of(findings, "port").device == "due"
    assert finding_of(findings, "program").device is None


@pytest.mark.parametrize("name", ["replay:{}", "{}"])
def test_a_recording_is_only_looked_for(system: FakeSystem, tmp_path: Path, name: str) -> None:
    recording = tmp_path / "rest.npz"
    recording.touch()
    (config,) = load_configs(None, {}, [name.format(recording)])
    assert levels(list(check_source(config, system, 0.0))) == {"source": "ok"}
    (config,) = load_configs(None, {}, [f"replay:{recording}x"])
    assert levels(list(check_source(config, system, 0.0))) == {"source": "problem"}


def test_packages_have_to_be_there_only_if_asked_for(system: FakeSystem) -> None:
    (config,) = load_configs(None, {"mqtt.broker": "localhost", "metrics.address": 9100})
    assert finding_of(list(check_packages(config, system)), "packages").level == "ok"
    system.without = {"mcap"}
    assert finding_of(list(check_packages(config, system)), "packages").level == "ok"
    system.without = {"mcap", "paho"}
    found = finding_of(list(check_packages(config, system)), "packages")
    assert (found.level, found.remedy) == ("problem", f"{how_to_install('mqtt')}.")


@pytest.mark.parametrize(
    ("runs", "board", "properties", "rule", "level", "says"),
    [
        (False, True, "", False, "ok", "does not run"),
        (True, True, "", True, "warning", "nothing tells it to leave /dev/ttyACM0 alone"),
        (True, True, "ID_BUS=usb\nID_MM_DEVICE_IGNORE=1", True, "ok", "is told to leave /dev/ttyACM0 alone"),
        (True, True, "ID_MM_PORT_IGNORE=1", True, "ok", "is told to leave"),
        (True, True, "ID_MM_DEVICE_IGNORE=0", True, "warning", "nothing tells it"),
        (True, False, "", True, "ok", "will keep it away"),
        (True, False, "", False, "warning", "may write 'AT' to a board when it is plugged in"),
    ],
)
def test_modem_manager(
    system: FakeSystem, runs: bool, board: bool, properties: str, rule: bool, level: str, says: str
) -> None:
    system.plug("/dev/ttyUSB0", 0x0403, 0x6001)
    system.answers["udevadm"] = properties
    if runs:
        system.process(9, "/usr/sbin/ModemManager")
    if board:
        system.plug("/dev/ttyACM0")
    if rule:
        system.put("/etc/udev/rules.d/70-fltea.rules")
    findings = list(check_udev(system))
    found = finding_of(findings, "ModemManager")
    assert (found.level, says in found.message) == (level, True)
    assert (found.remedy is not None) == (level == "warning")
    assert ("is installed" in finding_of(findings, "udev rule").message) == rule


@pytest.mark.parametrize(
    ("state", "expected"),
    [
        (None, []),
        ("", []),
        ("LoadState=not-found\nActiveState=inactive", [("ok", "not installed")]),
        (
            "LoadState=loaded\nActiveState=active\nSubState=running\nNRestarts=0\nUnitFileState=enabled",
            [("ok", "fltea.service is active (running)")],
        ),
        (
            "LoadState=loaded\nActiveState=active\nSubState=running\nNRestarts=3\nUnitFileState=disabled",
            [("warning", "was restarted 3 times"), ("warning", "will not start with the machine")],
        ),
        (
            "LoadState=loaded\nActiveState=failed\nResult=exit-code\nUnitFileState=enabled",
            [("problem", "fltea.service failed (exit-code)")],
        ),
    ],
)
def test_the_service(system: FakeSystem, state: str | None, expected: list[tuple[str, str]]) -> None:
    if state is not None:
        system.answers["systemctl"] = state
    findings = list(check_service(system))
    assert [finding.level for finding in findings] == [level for level, _ in expected]
    for finding, (_, says) in zip(findings, expected, strict=True):
        assert says in finding.message


def test_a_raspberry_pi_is_told_how_to_switch_its_bus_on(system: FakeSystem) -> None:
    assert list(check_i2c(system, None)) == []
    system.put("/proc/device-tree/model", "Raspberry Pi 5")
    (found,) = check_i2c(system, None)
    assert (found.level, "raspi-config nonint do_i2c 0" in found.message) == ("ok", True)
    system.put("/dev/i2c-1")
    (found,) = check_i2c(system, None)
    assert found.message == "buses: /dev/i2c-1"


@pytest.mark.parametrize(
    ("registers", "level", "says", "remedy"),
    [
        ({0x68: 0x71}, "ok", "MPU-9250 answers at /dev/i2c-1, address 0x68", None),
        ({0x68: 0x70}, "warning", "the same kind of gyroscope, but no magnetometer", None),
        ({0x68: 0xEA}, "ok", "ICM-20948 answers at /dev/i2c-1, address 0x68", None),
        ({0x68: 0x33}, "problem", "WHO_AM_I 0x33", "a bad contact on SDA"),
        ({0x69: 0x71}, "problem", "but at 0x69: MPU-9250", "--source 'i2c:///dev/i2c-1?addr=0x69'"),
        ({}, "problem", "no chip answers at /dev/i2c-1, address 0x68", "i2cdetect -y 1"),
        ({0x68: OSError(16, "busy")}, "ok", "a driver of the kernel uses the chip at 0x68", None),
    ],
)
def test_the_chip_on_the_bus(
    system: FakeSystem, registers: dict[int, int | OSError], level: str, says: str, remedy: str | None
) -> None:
    system.put("/dev/i2c-1")
    system.put("/sys/bus/i2c/devices/i2c-1/of_node/clock-frequency", (400_000).to_bytes(4, "big"))
    system.registers = registers
    findings = list(check_i2c(system, "i2c:///dev/i2c-1?addr=0x68"))
    assert finding_of(findings, "i2c").message.endswith("; 400 kHz")
    found = finding_of(findings, "sensor")
    assert (found.level, says in found.message) == (level, True), found
    assert found.remedy is None if remedy is None else remedy in str(found.remedy)


@pytest.mark.parametrize("who_am_i", SENSORS)
def test_every_chip_that_a_pi_reads_is_known(system: FakeSystem, who_am_i: int) -> None:
    system.put("/dev/i2c-1")
    system.registers = {0x68: {CHIPS[SENSORS[who_am_i].family].who_am_i: who_am_i}}
    found = finding_of(list(check_i2c(system, "i2c:///dev/i2c-1")), "sensor")
    assert found.message.startswith(f"{SENSORS[who_am_i].name} answers at /dev/i2c-1, address 0x68")
    assert found.level == ("warning" if SENSORS[who_am_i].note else "ok")


def test_a_bus_that_is_missing_closed_too_fast_or_misspelt(system: FakeSystem) -> None:
    system.put("/dev/i2c-0")
    (found,) = check_i2c(system, "i2c:///dev/i2c-1")
    assert (found.level, found.message) == ("problem", "there is no bus /dev/i2c-1. There is /dev/i2c-0.")
    system.put("/dev/i2c-1")
    system.refused = {"/dev/i2c-1"}
    (found,) = check_i2c(system, "i2c:///dev/i2c-1")
    assert (found.level, "usermod -aG dialout anna" in str(found.remedy)) == ("problem", True)
    system.refused = set()
    assert levels(list(check_i2c(system, "i2c:///dev/i2c-1"))) == {"i2c": "ok", "sensor": "problem"}
    system.put("/sys/bus/i2c/devices/i2c-1/of_node/clock-frequency", (1_000_000).to_bytes(4, "big"))
    assert levels(list(check_i2c(system, "i2c:///dev/i2c-1")))["i2c"] == "warning"
    assert levels(list(check_i2c(system, "i2c:///dev/i2c-1?addr=seventy"))) == {"i2c": "problem"}


def test_room_for_recordings_in_days_at_the_rate_of_the_last_ones(system: FakeSystem, tmp_path: Path) -> None:
    folder = tmp_path / "recordings"
    found = finding_of(outputs(system, record__folder=str(folder)), "disk")
    assert (found.level, found.message) == (
        "ok",
        f"100.0 GB free for {folder}: 36 days (2.8 GB a day, a guess for 1 at 100 Hz)",
    )
    folder.mkdir()
    for hour in range(4):
        file = folder / f"{hour}.mcap"
        file.write_bytes(bytes(36_000))
        stamp(file, 1_000_000 + 3600 * hour)
    found = finding_of(outputs(system, record__folder=str(folder)), "disk")
    assert "115741 days (0.00086 GB a day, as the last recordings grew)" in found.message
    system.free = 6_000_000
    found = finding_of(outputs(system, record__folder=str(folder)), "disk")
    assert (found.level, "7 days" in found.message) == ("warning", True)
    for file in folder.iterdir():
        file.unlink()
    assert finding_of(outputs(system, record__folder=str(folder)), "disk").level == "warning"


def stamp(file: Path, time_s: float) -> None:
    os.utime(file, (time_s, time_s))


def test_a_folder_that_cannot_be_one(system: FakeSystem, tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.touch()
    found = finding_of(outputs(system, record__folder=str(file / "recordings")), "recordings")
    assert (found.level, found.message) == ("problem", f"{file} is no folder.")
    assert outputs(system, state__file=str(tmp_path / "state")) == []
    assert levels(outputs(system, state__file=str(file / "state"))) == {"state": "problem"}
    # `fltea run` creates the folder of recordings, but not the folder of the snapshot.
    missing = finding_of(outputs(system, state__file=str(tmp_path / "no/state")), "state")
    assert (missing.level, missing.message) == ("problem", f"there is no folder {tmp_path / 'no'}.")
    assert levels(outputs(system, state__file=str(tmp_path))) == {"state": "problem"}
    tilde = finding_of(
        outputs(system, record__folder="~/rec"), "disk"
    )  # `fltea run` takes "~/rec" literally as the name of a folder
    assert " free for ~/rec:" in tilde.message


@pytest.fixture
def taken() -> Iterator[int]:
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield server.getsockname()[1]


def test_the_broker(system: FakeSystem, taken: int) -> None:
    found = finding_of(outputs(system, mqtt__broker=f"127.0.0.1:{taken}"), "mqtt")
    assert (found.level, found.message.startswith("something answers at 127.0.0.1")) == ("ok", True)
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        address = f"mqtts://127.0.0.1:{unused.getsockname()[1]}"
        found = finding_of(outputs(system, mqtt__broker=address), "mqtt")
    assert (found.level, "Connection refused" in found.message) == ("problem", True)


def test_ports_of_the_page_and_of_the_metrics(system: FakeSystem, taken: int) -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        unused = free.getsockname()[1]
    findings = outputs(system, dashboard__address=str(unused), metrics__address=f"127.0.0.1:{taken}")
    assert levels(findings) == {"dashboard": "ok", "metrics": "problem"}
    assert finding_of(findings, "metrics").remedy == f"ss -ltnp 'sport = :{taken}' names that program."
    system.process(5, "/opt/fltea/bin/fltea", "run")
    assert levels(outputs(system, metrics__address=taken)) == {"metrics": "ok"}
    assert levels(outputs(system, metrics__address="192.0.2.1:80")) == {"metrics": "problem"}
