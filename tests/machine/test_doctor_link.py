"""Tests what `fltea doctor` says of a device on a serial port, from the cable to the device's messages."""

import msgspec
import pytest
from fltea.machine.doctor import checks_link
from fltea.machine.doctor.checks_link import check_serial, judge
from fltea.machine.doctor.hearing import Drift, Heard
from fltea.records.events import Trouble
from fltea.records.stats import DeviceStatus, LinkStats
from fltea.records.version import __version__
from fltea.wire import layout as wire
from fltea.wire.transport import ANY_BOARD, DUE_NATIVE_PORT

from tests.rig.fake_system import FakeSystem, finding_of, levels
from tests.rig.host_support import hello

HELLO = hello(
    firmware_version=f"{__version__} due fca274b5",
    protocol="1.5",
    schema_hash=f"0x{wire.SCHEMA_HASH:08X}",
    sensor="MPU-9250",
    gyro_range_dps=2000.0,
)
OLDER = msgspec.structs.replace(HELLO, firmware_version="0.0.9 due")
STATUS = DeviceStatus(0, 0, 0, 0, 0, "user")


@pytest.fixture(autouse=True)
def all_say_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(checks_link, "hear", lambda url, baud, hear_s: heard())


def heard(**changes: object) -> Heard:
    usual: dict[str, object] = {
        "opened": True,
        "hello": HELLO,
        "status": STATUS,
        "link": LinkStats(bytes=12_000, frames=410, bad_frames={"partial": 1, "crc": 2}),
        "delivered": 401,
        "seconds": 4.0,
        "drift": Drift(12.0, 5.0),
    }
    return Heard(**{**usual, **changes})  # type: ignore[arg-type]


def failed(kind: str) -> dict[str, object]:
    return {"troubles": [Trouble(kind, f"the text of {kind}", 0)], "hello": None}


def trouble_of(kind: str) -> dict[str, object]:
    return {"troubles": [Trouble(kind, f"the text of {kind}", 0, fatal=False)]}


def test_a_device_in_good_health() -> None:
    findings = list(judge("port", heard()))
    assert levels(findings) == dict.fromkeys(
        ("frames", "firmware", "sensor", "samples", "board", "clock drift"), "ok"
    )
    assert finding_of(findings, "firmware").message == (
        f"{__version__} due fca274b5, protocol 1.5, schema 0x{wire.SCHEMA_HASH:08X}, as this program"
    )
    later = heard(hello=msgspec.structs.replace(HELLO, protocol="1.9", schema_hash="0x54B0C642"))
    message = finding_of(list(judge("port", later)), "firmware").message
    assert message.endswith(
        "protocol 1.9, schema 0x54B0C642, which is not this program's: fltea ignores what it does not know"
    )
    assert finding_of(findings, "samples").message == "401 in 4.0 s, 100.00 Hz (100 stated), 0 lost"
    assert finding_of(findings, "clock drift").message.endswith("+12 ± 9.8 ppm")


@pytest.mark.parametrize(
    ("changes", "check", "level", "says"),
    [
        ({"link": LinkStats(9, 3, {"crc": 3})}, "frames", "warning", "damaged ones: 3 crc"),
        ({"link": LinkStats(900, 0, {"cobs": 9})}, "frames", "problem", "is the baud rate"),
        ({"link": LinkStats(bytes=0)}, "frames", "problem", "0 bytes"),
        (failed("version"), "firmware", "problem", "make flash"),
        (failed("silent"), "firmware", "problem", "the text of silent"),
        ({"hello": OLDER}, "firmware", "warning", "it is version 0.0.9"),
        (trouble_of("device_fault"), "sensor", "problem", "the text of device_fault"),
        (trouble_of("sensor_relative"), "sensor", "warning", "of sensor_relative"),
        ({"hello": msgspec.structs.replace(HELLO, who_am_i=0)}, "sensor", "problem", "has found no sensor"),
        ({"delivered": 0, "seconds": 0.0}, "samples", "problem", "no samples"),
        ({"delivered": 391, "lost": 10}, "samples", "warning", "10 lost"),
        ({"seconds": 4.1}, "samples", "warning", "the sensor's clock is wrong"),
        ({"status": DeviceStatus(4, 1, 0, 0, 7, "watchdog")}, "board", "warning", "7 dropped frames, 4 I²C"),
        ({"drift": Drift(900.0, 10.0)}, "clock drift", "warning", "+900 ± 20 ppm"),
        ({"drift": Drift(900.0, 300.0)}, "clock drift", "ok", "+900 ± 590 ppm"),
    ],
)  # fmt: skip
def test_what_can_be_wrong(changes: dict[str, object], check: str, level: str, says: str) -> None:
    found = finding_of(list(judge("port", heard(**changes))), check)
    assert found.level == level
    assert says in f"{found.message} {found.remedy}"


def test_what_was_not_heard_is_not_judged() -> None:
    silent = heard(**failed("silent"), link=LinkStats())
    assert list(levels(list(judge("port", silent)))) == ["frames", "firmware"]
    closed = Heard(troubles=[Trouble("no_port", "the text of no_port", 0)])
    assert [(f.check, f.message) for f in judge("port", closed)] == [("port", "the text of no_port")]
    (found,) = judge("port", Heard())
    assert (found.level, found.message) == ("problem", "port did not open in time.")


@pytest.mark.parametrize("url", [None, ANY_BOARD])
def test_the_only_board_is_found_and_listened_to(system: FakeSystem, url: str | None) -> None:
    system.plug("/dev/ttyUSB0", 0x0403, 0x6001)
    system.plug("/dev/ttyACM0")
    system.link("/dev/serial/by-id/usb-Due-if00", "/dev/ttyACM0")
    findings = list(check_serial(system, url, wire.BAUD))
    assert {finding.level for finding in findings} == {"ok"}
    assert "a name that stays: /dev/serial/by-id/usb-Due-if00" in finding_of(findings, "port").message
    assert "anna may open /dev/ttyACM0 (group 'dialout')" in finding_of(findings, "permission").message
    assert finding_of(findings, "samples").level == "ok"


def test_no_board_several_boards_and_the_wrong_port(system: FakeSystem) -> None:
    (found,) = check_serial(system, None, wire.BAUD)
    assert (found.level, "no serial port at all" in found.message) == ("problem", True)
    assert "a cable that carries data" in str(found.remedy)
    system.plug("/dev/ttyACM1", 0x2341, DUE_NATIVE_PORT)
    (found,) = check_serial(system, None, wire.BAUD)
    assert (found.level, "native port" in found.message) == ("problem", True)
    findings = list(check_serial(system, "/dev/ttyACM1", wire.BAUD))
    assert [finding.level for finding in findings] == ["ok", "problem"]
    assert "beside the power socket" in str(findings[1].remedy)
    system.plug("/dev/ttyACM0")
    system.plug("/dev/ttyACM2")
    (found,) = check_serial(system, None, wire.BAUD)
    assert found.message == "several boards are plugged in: /dev/ttyACM0, /dev/ttyACM2."


def test_a_port_by_its_link_and_one_that_is_not_there(system: FakeSystem) -> None:
    system.plug("/dev/ttyACM0")
    system.link("/dev/fltea-7523", "/dev/ttyACM0")
    findings = list(check_serial(system, "/dev/fltea-7523", wire.BAUD))
    assert finding_of(findings, "port").message == "/dev/ttyACM0: Arduino Due, programming port"
    assert finding_of(findings, "samples").level == "ok"
    (found,) = check_serial(system, "/dev/ttyACM7", wire.BAUD)
    assert (found.message, found.remedy) == (
        "there is no port /dev/ttyACM7.",
        "check the cable and the name. Ports that exist: /dev/fltea-7523.",
    )


def test_a_device_that_is_no_port_has_no_holders(system: FakeSystem) -> None:
    """Many programs hold /dev/null, and none of them is in the way."""
    system.put("/dev/null")
    system.no_ports = {"/dev/null"}
    system.process(31, "/usr/sbin/sshd", opened="/dev/null")
    (found,) = check_serial(system, "/dev/null", wire.BAUD)
    assert (found.level, "/dev/null is a file" in found.message) == ("problem", True)
    assert "sshd" not in f"{found.message} {found.remedy}"


def test_a_port_that_is_closed_to_the_user_is_not_opened(system: FakeSystem) -> None:
    system.plug("/dev/ttyACM0")
    system.refused = {"/dev/ttyACM0"}
    findings = list(check_serial(system, None, wire.BAUD))
    assert levels(findings) == {"port": "ok", "permission": "problem"}
    assert "sudo usermod -aG dialout anna" in str(finding_of(findings, "permission").remedy)


@pytest.mark.parametrize(
    ("command", "level", "says"),
    [
        (("/opt/fltea/bin/python", "/opt/fltea/bin/fltea", "run"), "warning", "that program's records"),
        (("/usr/bin/minicom",), "problem", "in use by minicom (pid 31)"),
    ],
)
def test_a_port_in_use_is_not_opened(
    system: FakeSystem, command: tuple[str, ...], level: str, says: str
) -> None:
    system.plug("/dev/ttyACM0")
    system.process(31, *command, opened="/dev/ttyACM0")
    findings = list(check_serial(system, None, wire.BAUD))
    assert list(levels(findings)) == ["port", "permission", "in use"]
    found = finding_of(findings, "in use")
    assert (found.level, says in found.message) == (level, True)
