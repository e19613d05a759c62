"""What `fltea devices` and `fltea doctor` say of sensors that the kernel has drivers for."""

import json
from pathlib import Path

import pytest
from fake_iio import FakeIio, imu
from fake_system import FakeSystem
from fltea.cli.devices import devices
from fltea.machine.devices import find_iio
from fltea.machine.doctor.diagnosis import check_source
from fltea.machine.doctor.finding import Finding
from fltea.settings.config import Config


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
        "    bmi160: gyroscope and accelerometer, by a driver of the kernel (IIO), 200 Hz, trigger none\n"
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
    }
    assert "will take the chip's own, bmi160-dev0" in checks["trigger"].message


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
