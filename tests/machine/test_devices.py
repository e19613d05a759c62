"""What is plugged in, on machines of our own making."""

import os
import subprocess
from pathlib import Path

import pytest
from fake_system import FakeSystem
from fltea.machine import host_system
from fltea.machine.devices import NATIVE, PROGRAMMING, find_ports, stable_name
from fltea.machine.host_system import Holder, System, permission_remedy
from fltea.wire.permission import Group
from fltea.wire.transport import DUE_NATIVE_PORT
from host_support import wait_until


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
        (Group(20, "dialout", True), set(), {20}, "this login is older than that: log out and in again"),
        (Group(20, "dialout", True), {20}, {20}, "a container or a security module is in the way"),
        (Group(0, "root", False), set(), set(), "admits no group that anna could join (its group is 'root')"),
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
    assert group is not None
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
