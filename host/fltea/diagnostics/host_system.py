"""Finds out what `fltea devices` and `fltea doctor` need to know of the machine.

Tests replace the class `System` by one that invents a machine.
"""

import contextlib
import ctypes
import importlib.util
import os
import shutil
import subprocess
from collections.abc import Iterator, Sequence
from pathlib import Path

import msgspec
from serial.tools import list_ports
from serial.tools.list_ports_common import ListPortInfo

from fltea.diagnostics.folders import first_existing
from fltea.wire.permission import Group, User, group_of, join_remedy, this_user
from fltea.wire.terminal import is_terminal

COMMAND_S = 5.0
TIME_ERROR = 5
"""Return value of adjtimex(2) by which the kernel says that the clock is not synchronised."""

PROGRAM_WORDS = 4


class Holder(msgspec.Struct, frozen=True):
    """A program that has a port open."""

    pid: int
    program: str

    def __str__(self) -> str:
        return f"{self.program} (pid {self.pid})"


class System:
    """The machine that `fltea devices` and `fltea doctor` examine. `root`: folder that is used as /."""

    def __init__(self, root: Path = Path("/")) -> None:
        self.root = root

    def path(self, name: str) -> Path:
        """Return the path of `name`, which begins with /, under `root`."""
        return self.root / name.lstrip("/")

    def exists(self, name: str) -> bool:
        """Return whether file `name` exists under `root`."""
        return self.path(name).exists()

    def names(self, folder: str, pattern: str = "*") -> list[str]:
        """Return the sorted absolute paths of a folder's entries; none if the folder cannot be read."""
        try:
            paths = sorted(self.path(folder).glob(pattern))
        except OSError:
            return []
        return [f"/{path.relative_to(self.root)}" for path in paths]

    def read(self, name: str) -> bytes | None:
        """Return the content of a small file, or None if it cannot be read."""
        try:
            return self.path(name).read_bytes()
        except OSError:
            return None

    def text(self, name: str) -> str:
        """Return a small file as text, without white space and zeros at its end; "" if it cannot be read."""
        return (self.read(name) or b"").decode("utf-8", "replace").rstrip("\0 \t\r\n")

    def serial_ports(self) -> Sequence[ListPortInfo]:
        """Return the serial ports of this machine, sorted by name."""
        return sorted(list_ports.comports(), key=lambda port: port.device)

    def run(self, *command: str) -> str | None:
        """Return a command's output, stripped of white space; None if the command is missing or fails to run.

        The exit code is ignored: systemctl prints `inactive` and returns 3.
        """
        with contextlib.suppress(OSError, subprocess.TimeoutExpired):
            done = subprocess.run(command, capture_output=True, text=True, timeout=COMMAND_S, check=False)
            return done.stdout.strip()
        return None

    def who(self) -> User:
        """Return the user who runs this program, with the user's groups."""
        return this_user()

    def user(self) -> str:
        """Return the name of the user who runs this program."""
        return self.who().name

    def may_use(self, name: str) -> bool:
        """Return whether this process may read and write a file."""
        return os.access(self.path(name), os.R_OK | os.W_OK)

    def is_terminal(self, name: str) -> bool:
        """Return whether a file that exists can be a serial port."""
        return is_terminal(self.path(name))

    def group_of(self, name: str) -> Group | None:
        """Return the group of a file; None if there is no such file."""
        return group_of(self.path(name))

    def holders(self, name: str) -> list[Holder]:
        """Return the other programs that have a file open.

        Without root's rights, two kinds of programs are found: the user's own, and those that have locked the
        file. Every fltea locks the ports that it opens.
        """
        pids = self._openers(str(self.path(name).resolve()), name) | self._lockers(name)
        return [Holder(pid, self._program(pid)) for pid in sorted(pids - {os.getpid()})]

    def listeners(self, port: int) -> list[Holder]:
        """Return the programs that listen at a TCP port of this machine.

        Without root's rights, only the user's own programs are found.
        """
        lines = [
            line.split() for name in ("tcp", "tcp6") for line in self.text(f"/proc/net/{name}").split("\n")
        ]
        # proc(5): the second word is the local address in hexadecimal digits, the fourth the state, of which
        # 0A is LISTEN, and the tenth the socket's inode
        inodes = [
            words[9]
            for words in lines
            if len(words) > 9 and words[3] == "0A" and words[1].endswith(f":{port:04X}")
        ]
        pids = self._openers(*(f"socket:[{inode}]" for inode in inodes))
        return [Holder(pid, self._program(pid)) for pid in sorted(pids - {os.getpid()})]

    def _openers(self, *targets: str) -> set[int]:
        found = set()
        for folder in self.path("/proc").glob("[0-9]*/fd"):
            # an error means that the process belongs to another user, or has ended
            with contextlib.suppress(OSError):
                if any(os.readlink(link) in targets for link in folder.iterdir()):
                    found.add(int(folder.parent.name))
        return found

    def _lockers(self, name: str) -> set[int]:
        """Return the IDs of the processes that hold a lock on a file.

        The kernel lists locks in lines such as `1: FLOCK ADVISORY WRITE 1234 00:05:678 0 EOF` (proc(5)).
        """
        try:
            status = self.path(name).stat()
        except OSError:
            return set()
        where = f"{os.major(status.st_dev):02x}:{os.minor(status.st_dev):02x}:{status.st_ino}"
        lines = (line.split() for line in self.text("/proc/locks").splitlines())
        return {
            int(words[4]) for words in lines if len(words) > 5 and words[5] == where and int(words[4]) > 0
        }

    def _program(self, pid: int) -> str:
        """Return how a process is named to the user: the first words of its command line."""
        words = (self.read(f"/proc/{pid}/cmdline") or b"").decode("utf-8", "replace").split("\0")
        words = [word for word in words if word]
        if not words:
            return self.text(f"/proc/{pid}/comm") or "a program that hides its name"
        words[0] = os.path.basename(words[0])
        return " ".join(words[:PROGRAM_WORDS]) + (" …" if len(words) > PROGRAM_WORDS else "")

    def is_running(self, program: str) -> bool:
        """Return whether another process of the name `program` runs."""
        ours = f"/proc/{os.getpid()}"
        return any(self.text(f"{folder}/comm") == program for folder in self._processes() if folder != ours)

    def _processes(self) -> Iterator[str]:
        yield from self.names("/proc", "[0-9]*")

    def clock_is_kept(self) -> bool | None:
        """Return whether the clock is synchronised, for instance by NTP; None if that is not known."""
        try:
            adjtimex = ctypes.CDLL(None).adjtimex
        except (OSError, AttributeError):
            return None
        # a struct timex of zeros asks for the state of the clock and changes nothing
        state = adjtimex(ctypes.create_string_buffer(512))
        return None if state < 0 else state != TIME_ERROR

    def free_bytes(self, folder: Path) -> int:
        """Return the free space for this user on the disk of a folder, which need not exist yet [bytes]."""
        return shutil.disk_usage(first_existing(folder)).free

    def read_i2c_register(self, bus: str, address: int, register: int) -> int:
        """Return the content of one register of a chip on an I²C bus; reading changes nothing.

        Raises:
            OSError: no chip answers, or a driver of the kernel uses the chip.
        """
        from smbus2 import SMBus

        with SMBus(str(self.path(bus))) as open_bus:
            return int(open_bus.read_byte_data(address, register))

    def has_module(self, name: str) -> bool:
        """Return whether a Python package is installed."""
        return importlib.util.find_spec(name) is not None


def permission_remedy(system: System, name: str) -> str | None:
    """Return how this user gets permission to use a device; None if the user has it."""
    if system.may_use(name):
        return None
    group = system.group_of(name)
    if group is None:
        return f"{name} is gone: is its cable loose?"
    return join_remedy(name, group, system.who())
