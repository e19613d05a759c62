"""What `fltea devices` and `fltea doctor` print, on machines of our own making."""

import json
from pathlib import Path

import pytest
import typer
from fake_system import FakeSystem
from fltea.cli.devices import devices, doctor
from fltea.machine.doctor import hearing
from fltea.machine.doctor.hearing import Heard
from fltea.records.events import Trouble
from fltea.wire.permission import Group
from fltea.wire.transport import DUE_NATIVE_PORT
from host_support import hello


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
    assert "ok       source        synthetic: synthetic:: made-up noise" in text


def test_the_doctor_for_a_program(
    system: FakeSystem, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    doctor(source=["synthetic:"], record_folder=str(tmp_path), json=True)
    found = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert {entry["class"] for entry in found} == {"finding"}
    assert "disk" in [entry["check"] for entry in found]
