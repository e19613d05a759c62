"""Tests of which connected devices `fltea devices` finds, including those with kernel drivers, and how it
prints them.
"""

import json
import os
import subprocess
from pathlib import Path

import pytest
import typer
from fltea.cli.devices import devices, doctor
from fltea.diagnostics import host_system
from fltea.diagnostics.finding import Finding
from fltea.diagnostics.host_system import Holder, System, permission_remedy
from fltea.machine.devices import NATIVE, PROGRAMMING, find_iio, find_ports, stable_name
from fltea.machine.doctor import hearing
from fltea.machine.doctor.diagnosis import check_source
from fltea.machine.doctor.hearing import Heard
from fltea.records.events import Trouble
from fltea.settings.config import Config
from fltea.wire.permission import Group
from fltea.wire.transport import DUE_NATIVE_PORT

from tests.rig.fake_iio import FakeIio, imu
from tests.rig.fake_system import FakeSystem
from tests.rig.host_support import hello, wait_until


def test_boards_come_first_and_each_port_says_what_it_is(system: FakeSystem) -> None:
    system.plug("/dev/ttyS0", None, None, None, "n/a")
    system.plug("/dev/ttyUSB0", 0x0403, 0x6001, "FT9", "FT232R USB UART")
    system.plug("/dev/ttyACM1", 0x2A03, DUE_NATIVE_PORT, None, "Arduino Due")
    system.plug("/dev/ttyACM0", 0x2A03)
    ports = find_ports(system)
    assert [(p.device, p.kind, p.usb_id, p.is_board) for p in ports] == [
        ("/dev/ttyACM0", PROGRAMMING, "2a03:003d", True),
        ("/dev/ttyACM1", NATIVE, "2a03:003e", False),
        ("/dev/ttyUSB0", "FT232R USB UART", "0403:6001", False),
        ("/dev/ttyS0", "serial port", None, False),
    ]


def test_the_name_that_stays_is_preferred(system: FakeSystem) -> None:
    system.plug("/dev/ttyACM0")
    system.plug("/dev/ttyACM1")
    assert stable_name(system, "/dev/ttyACM0") == "/dev/ttyACM0"
    system.link("/dev/serial/by-path/pci-usb-1", "/dev/ttyACM0")
    assert stable_name(system, "/dev/ttyACM0") == "/dev/serial/by-path/pci-usb-1"
    system.link("/dev/serial/by-id/usb-Due-if00", "/dev/ttyACM0")
    assert stable_name(system, "/dev/ttyACM0") == "/dev/serial/by-id/usb-Due-if00"
    system.link("/dev/fltea-7523", "/dev/ttyACM0")
    assert stable_name(system, "/dev/ttyACM0") == "/dev/fltea-7523"
    assert [p.path for p in find_ports(system)] == ["/dev/fltea-7523", "/dev/ttyACM1"]


def test_who_has_a_port_open(system: FakeSystem) -> None:
    system.plug("/dev/ttyACM0")
    system.process(50, "/usr/bin/screen", "/dev/ttyACM0", "250000", opened="/dev/ttyACM0")
    system.process(60, "/usr/bin/cat", opened="/dev/ttyACM1")
    system.process(70, "/opt/fltea/bin/python", "/opt/fltea/bin/fltea", "run", "--config", "x.toml")
    status = os.stat(system.path("/dev/ttyACM0"))
    where = f"{os.major(status.st_dev):02x}:{os.minor(status.st_dev):02x}:{status.st_ino}"
    system.put(
        "/proc/locks",
        f"1: FLOCK  ADVISORY  WRITE 70 {where} 0 EOF\n1: -> FLOCK  ADVISORY  WRITE 60 {where} 0 EOF\n"
        f"2: POSIX  ADVISORY  READ 60 00:01:1 0 EOF\n3: FLOCK  ADVISORY  WRITE -1 {where} 0 EOF\n",
    )
    (port,) = find_ports(system)
    assert port.holders == [
        Holder(50, "screen /dev/ttyACM0 250000"),
        Holder(70, "python /opt/fltea/bin/fltea run --config …"),
    ]


def test_of_this_machine_it_knows_who_opened_a_file_but_leaves_itself_out(tmp_path: Path) -> None:
    file = tmp_path / "port"
    file.touch()
    with file.open() as opened:
        assert System().holders(str(file)) == []
        child = subprocess.Popen(["sleep", "60"], pass_fds=[opened.fileno()])
        try:
            arguments = Path(f"/proc/{child.pid}/cmdline")
            wait_until(lambda: arguments.read_bytes() == b"sleep\x0060\x00", "the program to be the child's")
            assert System().holders(str(file)) == [Holder(child.pid, "sleep 60")]
        finally:
            child.kill()
            child.wait()


@pytest.mark.parametrize(
    ("group", "in_force", "granted", "says"),
    [
        (
            Group(20, "dialout", True),
            set(),
            set(),
            "sudo usermod -aG dialout anna, then log out and in again.",
        ),
        (Group(986, "uucp", True), set(), {20}, "sudo usermod -aG uucp anna, then"),
        (Group(20, "dialout", True), set(), {20}, "only after this login: log out and in again"),
        (Group(20, "dialout", True), {20}, {20}, "a container or a security module prevents the access"),
        (Group(0, "root", False), set(), set(), "by joining a group (its group is 'root')"),
    ],
)
def test_the_remedy_names_the_exact_group(
    system: FakeSystem, group: Group, in_force: set[int], granted: set[int], says: str
) -> None:
    system.plug("/dev/ttyACM0")
    system.refused = {"/dev/ttyACM0"}
    system.group, system.in_force, system.granted = group, in_force, granted
    (port,) = find_ports(system)
    assert port.remedy is not None
    assert says in port.remedy


def test_a_port_that_may_be_used_needs_no_remedy_and_one_that_is_gone_says_so(system: FakeSystem) -> None:
    system.plug("/dev/ttyACM0")
    assert permission_remedy(system, "/dev/ttyACM0") is None
    system.refused = {"/dev/ttyACM9"}
    assert "is gone" in str(permission_remedy(system, "/dev/ttyACM9"))


def test_the_group_of_a_real_file(tmp_path: Path) -> None:
    system, file = System(tmp_path), tmp_path / "device"
    file.touch()
    file.chmod(0o660)
    status = file.stat()
    group = system.group_of("/device")
    assert (group.gid, group.joinable) == (status.st_gid, status.st_gid != 0)
    for mode in (0o600, 0o640):
        file.chmod(mode)
        assert system.group_of("/device") == group._replace(joinable=False)
    assert system.group_of("/none") is None


def test_commands_that_are_missing_or_hang_give_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    assert System().run("no-such-command-of-fltea") is None
    assert System().run("sh", "-c", "echo state; exit 3") == "state"
    monkeypatch.setattr(host_system, "COMMAND_S", 0.05)
    assert System().run("sleep", "60") is None


def test_this_machine_answers_every_question() -> None:
    system = System()
    assert all(system.who())
    assert system.clock_is_kept() in (True, False)
    assert system.free_bytes(Path("/no/such/folder")) > 0
    assert system.has_module("fltea")
    assert not system.has_module("no_such_module_of_fltea")
    assert system.is_running(system.text("/proc/self/comm"))
    assert not system.is_running("no-such-program")


def test_a_list_for_a_person(system: FakeSystem, capsys: pytest.CaptureFixture[str]) -> None:
    system.plug("/dev/ttyACM0")
    system.link("/dev/serial/by-id/usb-Due-if00", "/dev/ttyACM0")
    system.plug("/dev/ttyACM1", pid=DUE_NATIVE_PORT, serial_number=None)
    system.process(31, "/usr/bin/minicom", opened="/dev/ttyACM1")
    system.put("/dev/i2c-1")
    system.group, system.refused = Group(998, "i2c", True), {"/dev/i2c-1"}
    devices()
    assert capsys.readouterr().out == (
        "/dev/serial/by-id/usb-Due-if00\n"
        "    Arduino Due, programming port, /dev/ttyACM0, USB 2341:003d, serial number 7523\n"
        "    fltea run --source serial:/dev/serial/by-id/usb-Due-if00\n"
        "/dev/ttyACM1\n"
        "    Arduino Due, native port, USB 2341:003e\n"
        "    in use by minicom (pid 31)\n"
        "/dev/i2c-1\n"
        "    I²C bus\n"
        "    no permission: sudo usermod -aG i2c anna, then log out and in again.\n"
    )


def test_a_list_for_a_program(system: FakeSystem, capsys: pytest.CaptureFixture[str]) -> None:
    devices(json=True)
    assert capsys.readouterr().out == ""
    system.plug("/dev/ttyACM0")
    system.put("/dev/i2c-1")
    devices(json=True)
    port, bus = map(json.loads, capsys.readouterr().out.splitlines())
    assert (port["class"], port["path"], port["usb_id"], port["holders"]) == (
        "port",
        "/dev/ttyACM0",
        "2341:003d",
        [],
    )
    assert bus == {"class": "i2c_bus", "path": "/dev/i2c-1", "driver": "", "remedy": None}


def test_only_boards_that_nobody_uses_are_asked_and_only_on_request(
    system: FakeSystem, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    def answer(url: str, **_: object) -> Heard:
        asked.append(url)
        if url == "/dev/ttyACM0":
            return Heard(opened=True, hello=hello(firmware_version="0.1.0 due", sensor="MPU-9250"))
        return Heard(opened=True, troubles=[Trouble("silent", "has said nothing", 0)])

    monkeypatch.setattr(hearing, "hear", answer)
    for device in ("/dev/ttyACM0", "/dev/ttyACM1", "/dev/ttyACM2", "/dev/ttyACM3"):
        system.plug(device)
    system.plug("/dev/ttyUSB0", 0x0403, 0x6001)
    system.refused = {"/dev/ttyACM2"}
    system.process(31, "/usr/bin/minicom", opened="/dev/ttyACM3")
    devices()
    assert asked == []
    capsys.readouterr()
    devices(probe=True)
    assert asked == ["/dev/ttyACM0", "/dev/ttyACM1"]
    text = capsys.readouterr().out
    assert "    says HELLO: 0.1.0 due, MPU-9250, 100 Hz\n" in text
    assert "    has said nothing\n" in text


def test_the_doctor_prints_a_line_a_finding_and_ends_with_1(
    system: FakeSystem, capsys: pytest.CaptureFixture[str]
) -> None:
    system.kept = False
    with pytest.raises(typer.Exit) as ended:
        doctor()
    assert ended.value.exit_code == 1
    lines = capsys.readouterr().out.splitlines()
    assert all(line.startswith(("ok  ", "warning  ", "problem  ", "         ")) for line in lines[:-1])
    assert lines[-1] == "1 problem, 1 warning."


def test_the_doctor_ends_with_0_if_there_are_only_warnings(
    system: FakeSystem, capsys: pytest.CaptureFixture[str]
) -> None:
    doctor(source=["synthetic:"])
    assert capsys.readouterr().out.endswith("\nAll is well.\n")
    system.kept = False
    doctor(source=["synthetic:", "synthetic:?alpha=0.5"], set_=["link.max_gap=3"])
    text = capsys.readouterr().out
    assert text.endswith("\n1 warning.\n")
    assert "ok       source        synthetic: synthetic:: synthetic noise" in text


def test_the_doctor_for_a_program(
    system: FakeSystem, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    doctor(source=["synthetic:"], record_folder=str(tmp_path), json=True)
    found = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert {entry["class"] for entry in found} == {"finding"}
    assert "disk" in [entry["check"] for entry in found]


def found(system: FakeSystem, rest: str = "bmi160") -> dict[str, Finding]:
    return {finding.check: finding for finding in check_source(Config(source=f"iio:{rest}"), system, 0.0)}


def test_a_list_for_a_person_and_for_a_script(
    system: FakeSystem, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    imu(tmp_path)
    accelerometer = FakeIio(tmp_path, "lis3\x1b[2J", 1)
    accelerometer.channel("accel_x", 0)
    FakeIio(tmp_path, "thermometer", 2).channel("temp", 0)
    system.refused = {"/dev/iio:device1"}
    devices()
    printed = capsys.readouterr().out
    assert (
        "/dev/iio:device0\n"
        "    bmi160: gyroscope and accelerometer, by a driver of the kernel (IIO), 200 Hz, trigger none, "
        "mount matrix 0, 1, 0; -1, 0, 0; 0, 0, 1\n"
        "    fltea run --source iio:bmi160\n"
        "/dev/iio:device1\n"
    ) in printed
    assert "no permission" in printed
    assert "\x1b" not in printed
    assert "thermometer" not in printed
    devices(json=True)
    first = json.loads(capsys.readouterr().out.splitlines()[0])
    assert (first["class"], first["name"], first["rate_hz"]) == ("iio_device", "bmi160", 200.0)


def test_two_of_a_kind_go_by_their_numbers(system: FakeSystem, tmp_path: Path) -> None:
    for number in range(2):
        FakeIio(tmp_path, "adxrs", number).channel("anglvel_z", 0)
    assert [one.name for one in find_iio(system)] == ["iio:device0", "iio:device1"]
    assert "several devices are called 'adxrs'" in found(system, "adxrs")["iio"].message
    assert found(system, "iio:device1")["iio"].level == "ok"


def test_a_sensor_that_is_ready(system: FakeSystem, tmp_path: Path) -> None:
    imu(tmp_path)
    checks = found(system)
    assert {check: finding.level for check, finding in checks.items()} == {
        "iio": "ok",
        "permission": "ok",
        "trigger": "ok",
        "rate": "ok",
        "axes": "ok",
    }
    assert checks["axes"].message == "turned by the driver's mount matrix: 0, 1, 0; -1, 0, 0; 0, 0, 1"
    assert "will take the chip's own, bmi160-dev0" in checks["trigger"].message


def test_the_driver_of_the_mpus(system: FakeSystem, tmp_path: Path) -> None:
    """The driver in this test accepts only its own trigger, and sets the sensor's low-pass filter by the
    sampling rate.
    """
    device = imu(tmp_path)
    (device.folder.parent / "driver").symlink_to(tmp_path / "sys/bus/i2c/drivers/inv-mpu6050-i2c")
    device.trigger("fltea", 1)
    checks = found(system)
    assert checks["trigger"].level == "ok"
    assert "half the rate" in checks["low-pass"].message
    refused = found(system, "bmi160?trigger=fltea")["trigger"]
    assert (refused.level, "INT pin" in str(refused.remedy)) == ("problem", True)


def test_a_mount_matrix_that_is_no_rotation(system: FakeSystem, tmp_path: Path) -> None:
    imu(tmp_path).put("mount_matrix", "1, 0, 0; 0, 1, 0; 0, 0, -1")
    axes = found(system)["axes"]
    assert (axes.level, "mount=off" in axes.message) == ("problem", True)
    assert found(system, "bmi160?mount=off")["axes"].level == "ok"


def test_pitfalls(system: FakeSystem, tmp_path: Path) -> None:
    device = imu(tmp_path)
    (tmp_path / "sys/bus/iio/devices/trigger0/name").write_text("other\n")
    for name in ("sampling_frequency", "scan_elements/in_timestamp_en"):
        (device.folder / name).unlink()
    device.put("buffer/enable", "1")
    system.refused = {"/dev/iio:device0"}
    checks = found(system)
    assert {check: finding.level for check, finding in checks.items() if finding.level != "ok"} == {
        "permission": "problem",
        "in use": "warning",
        "trigger": "problem",
        "rate": "warning",
        "time stamps": "warning",
    }
    assert "iio-trig-hrtimer" in str(checks["trigger"].remedy)
    assert "udev" in str(checks["permission"].remedy)


def test_what_is_not_there(system: FakeSystem, tmp_path: Path) -> None:
    assert "industrialio is not loaded" in found(system)["iio"].message
    device = imu(tmp_path)
    assert "There is bmi160 (/dev/iio:device0)" in found(system, "icm20948")["iio"].message
    device.node.unlink()
    assert "has no node" in found(system)["permission"].message
    FakeIio(tmp_path, "lis3", 1).channel("accel_x", 0)
    assert "has no gyroscope" in found(system, "lis3")["iio"].message
    assert found(system, "lis3?rate=3")["iio"].level == "problem"
