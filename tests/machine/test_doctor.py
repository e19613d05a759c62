"""Tests of `fltea doctor` on simulated machines: each finding, and the advice that comes with it."""

import os
import socket
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from fltea.diagnostics.finding import Finding
from fltea.machine.doctor.checks_host import check_packages, check_service, check_udev
from fltea.machine.doctor.checks_i2c import check_i2c
from fltea.machine.doctor.checks_outputs import check_outputs
from fltea.machine.doctor.diagnosis import check_source, examine
from fltea.records.errors import UsageError
from fltea.service.checks import check_settings
from fltea.settings.config import load_configs
from fltea.settings.extras import how_to_install
from fltea.sources.i2c.chips import CHIPS
from fltea.wire.sensors import SENSORS

from tests.rig.fake_system import FakeSystem, finding_of, levels
from tests.rig.source_contracts import CONTRACTS


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


def source(system: FakeSystem, url: str, **settings: object) -> Finding:
    """Return what the doctor says of a source that `fltea run` refuses, or accepts without a device."""
    overrides = {name.replace("__", "."): value for name, value in settings.items()}
    (config,) = load_configs(None, overrides, [url])
    (found,) = check_source(config, system, 0.0)
    return found


@pytest.mark.parametrize("name", ["replay:{}", "{}"])
def test_a_recording_is_read(system: FakeSystem, tmp_path: Path, name: str) -> None:
    recording = tmp_path / "rest.npz"
    np.savez(recording, gyro_dps=np.random.default_rng(1).normal(size=(600, 3)), fs_hz=100.0)
    assert source(system, name.format(recording)).level == "ok"
    recording.write_bytes(b"")
    assert source(system, name.format(recording)).level == "problem"
    assert "there is no such file" in source(system, f"replay:{recording}x").message


@pytest.mark.parametrize(
    ("url", "settings", "says"),
    [
        ("synthetic:?alpha=x", {}, "alpha"),
        ("serial-text:/dev/none?baud=x", {}, "'baud=x' is not known"),
        ("serial-text:/dev/none", {"replay__units": "furlongs"}, "furlongs"),
        ("stdin:/none", {}, "cannot be read"),
        ("replay:{folder}", {}, "{folder}"),
        ("serial:/dev/none", {"replay__units": "dps"}, "such options are for recordings"),
        ("i2c:///dev/i2c-1?adr=1", {}, "there is no key 'adr'"),
        ("iio:x?rate=1", {}, "there is no 'rate=1'"),
        ("file:rest", {}, "is not a kind of source"),
        ("mqtt://pi:x", {}, "must have a PORT"),
        ("mqtts://127.0.0.1:1", {"mqtt__ca": "{folder}/none.pem"}, "none.pem"),
        ("mqtt://127.0.0.1:1", {"mqtt__password_file": "{folder}/none"}, "none"),
        ("nats://127.0.0.1:1", {"ingest__ca": "{folder}/none.pem"}, "none.pem"),
    ],
)
def test_a_source_that_the_program_would_refuse(
    url: str, settings: dict[str, str], says: str, system: FakeSystem, tmp_path: Path
) -> None:
    settings = {name: value.format(folder=tmp_path) for name, value in settings.items()}
    found = source(system, url.format(folder=tmp_path), **settings)
    assert found.level == "problem"
    assert says.format(folder=tmp_path) in found.message


def test_a_text_port_is_looked_at_and_not_opened(system: FakeSystem) -> None:
    assert "there is no port /dev/ttyUSB0" in source(system, "serial-text:/dev/ttyUSB0?baud=9600").message
    system.plug("/dev/ttyUSB0", 0x0403, 0x6001)
    system.refused = {"/dev/ttyUSB0"}
    (config,) = load_configs(None, {}, ["serial-text:/dev/ttyUSB0"])
    assert levels(list(check_source(config, system, 0.0))) == {"port": "ok", "permission": "problem"}
    system.refused = set()
    found = list(check_source(config, system, 0.0))
    assert levels(found) == {"port": "ok", "permission": "ok", "source": "ok"}


def test_a_pipe_is_not_opened(system: FakeSystem, tmp_path: Path) -> None:
    """A program that waits to write to the pipe must not begin while nobody reads it."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    for url in (f"stdin:{pipe}", str(pipe), f"replay:{pipe}"):
        assert source(system, url).level == "ok"
    with pytest.raises(OSError, match="No such device"):
        os.open(pipe, os.O_WRONLY | os.O_NONBLOCK)


@pytest.mark.parametrize("sources", [pair for one in CONTRACTS.values() for pair in one.same])
def test_one_port_by_two_names(system: FakeSystem, sources: tuple[str, str]) -> None:
    configs = load_configs(None, {}, sources)
    with pytest.raises(UsageError, match="Only one source can read from it"):
        check_settings(configs)
    assert finding_of(list(examine(configs, system, 0.0)), "settings").level == "problem"


@pytest.mark.parametrize(
    "sources",
    [
        ("mqtt://localhost:1893", "MQTT://localhost:1893"),
        ("mqtt://Pi", "mqtt://pi:1883"),
        ("mqtt://localhost", "mqtt://127.0.0.1"),
        ("nats://a,nats://b", "nats://B:4222"),
    ],
)
def test_one_broker_by_two_names(sources: tuple[str, str]) -> None:
    with pytest.raises(UsageError, match="everything would come twice"):
        check_settings(load_configs(None, {}, sources))


@pytest.mark.parametrize(
    "sources",
    [
        *(pair for one in CONTRACTS.values() for pair in one.apart),
        ("mqtt://pi", "mqtt://pi:1884"),
        ("nats://pi", "mqtt://pi"),
    ],
)
def test_what_two_sources_may_share(sources: tuple[str, str]) -> None:
    check_settings(load_configs(None, {}, sources))


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
    (folder,) = outputs(system, state__file=str(tmp_path))
    assert (folder.level, folder.message) == ("problem", f"{tmp_path} is a folder.")
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
    us = os.getpid()
    system.process(us, "/opt/fltea/bin/fltea", "doctor")  # the doctor itself holds no port
    assert levels(outputs(system, metrics__address=taken)) == {"metrics": "problem"}
    system.process(us + 1, "/opt/fltea/bin/fltea", "run")
    assert levels(outputs(system, metrics__address=taken)) == {"metrics": "warning"}
    local = f"0100007F:{taken:04X} 00000000:0000 0A 00000000:00000000 00:00000000 00000000 0 0 4711 1"
    system.put("/proc/net/tcp", f"  sl  local_address\n   0: {local}\n")
    system.process(us + 2, "/usr/bin/nc", opened="socket:[4711]")
    found = finding_of(outputs(system, metrics__address=taken), "metrics")
    assert (found.level, f"is taken by nc (pid {us + 2})" in found.message) == ("problem", True)
    assert levels(outputs(system, metrics__address="192.0.2.1:80")) == {"metrics": "problem"}
    same = outputs(system, metrics__address=unused, dashboard__address=unused)
    assert any("the live page has the port" in one.message and one.level == "problem" for one in same)
    same = outputs(system, metrics__address=f"0.0.0.0:{unused}", dashboard__address=unused)
    assert any("the live page has the port" in one.message for one in same)


def test_files_that_outputs_need(system: FakeSystem, tmp_path: Path, taken: int) -> None:
    login = tmp_path / "login"
    broker = f"mqtts://127.0.0.1:{taken}"
    for settings, says in (
        ({"dashboard__address": 0, "dashboard__password_file": str(login)}, "dashboard.password_file"),
        ({"mqtt__broker": broker, "mqtt__password_file": str(login)}, "mqtt.password_file"),
        ({"mqtt__broker": broker, "mqtt__ca": str(login)}, "mqtt.ca"),
    ):
        found, answer = outputs(system, **settings)
        assert (found.level, says in found.message, answer.level) == ("problem", True, "ok")
    login.write_text("anna:secret\n")
    login.chmod(0o644)
    found, _ = outputs(system, dashboard__address=0, dashboard__password_file=str(login))
    assert "everybody on this machine may read it" in found.message
    found, _ = outputs(system, dashboard__address=0, dashboard__password_file=str(tmp_path))
    assert found.message == f"dashboard.password_file {tmp_path}: is a folder, and has to be a file."
    login.chmod(0o600)
    (found,) = outputs(system, dashboard__address=0, dashboard__password_file=str(login))
    assert found.level == "ok"


def test_a_snapshot_that_is_no_file_of_ours(system: FakeSystem, tmp_path: Path) -> None:
    notes = tmp_path / "notes"
    notes.write_text("[1]")
    (found,) = outputs(system, state__file=str(notes))
    assert (found.level, "no snapshot of fltea" in found.message) == ("problem", True)
    for k, target in enumerate((notes, tmp_path / "none", tmp_path)):
        (link := tmp_path / f"link{k}").symlink_to(target)
        (found,) = outputs(system, state__file=str(link))
        assert (found.level, f"{link}: is a link" in found.message) == ("problem", True)
    notes.write_bytes(b"")  # what a power cut may leave is set aside by `fltea run`
    assert outputs(system, state__file=str(notes)) == []
