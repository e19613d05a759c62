"""Simulate a machine for the checks of `fltea doctor`. A folder is its file system, and all other queries get
fixed answers.
"""

from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from fltea.diagnostics.finding import Finding
from fltea.diagnostics.host_system import System
from fltea.wire.permission import Group, User
from fltea.wire.transport import DUE_PROGRAMMING_PORT


class FakeSystem(System):
    """A system that permits everything, with no program and no device, unless a test changes it."""

    def __init__(self, root: Path) -> None:
        super().__init__(root)
        self.ports: list[Any] = []
        self.answers: dict[str, str] = {}
        self.refused: set[str] = set()
        self.group = Group(20, "dialout", True)
        self.in_force: set[int] = set()
        self.granted: set[int] = set()
        self.kept: bool | None = True
        self.free = 100_000_000_000
        self.no_ports: set[str] = set()
        self.without: set[str] = set()
        self.registers: Mapping[int, int | dict[int, int] | OSError] = {}

    def serial_ports(self) -> list[Any]:
        return self.ports

    def run(self, *command: str) -> str | None:
        return self.answers.get(command[0])

    def who(self) -> User:
        return User("anna", self.in_force, self.granted)

    def may_use(self, name: str) -> bool:
        return name not in self.refused

    def is_terminal(self, name: str) -> bool:
        return name not in self.no_ports

    def group_of(self, name: str) -> Group | None:
        return self.group if self.exists(name) else None

    def clock_is_kept(self) -> bool | None:
        return self.kept

    def free_bytes(self, folder: Path) -> int:
        return self.free

    def has_module(self, name: str) -> bool:
        return name not in self.without

    def read_i2c_register(self, bus: str, address: int, register: int) -> int:
        answer = self.registers.get(address, OSError(121, "Remote I/O error"))
        if isinstance(answer, OSError):
            raise answer
        return answer.get(register, 0) if isinstance(answer, dict) else answer

    def put(self, name: str, content: str | bytes = "") -> None:
        path = self.path(name)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content.encode() if isinstance(content, str) else content)

    def link(self, name: str, target: str) -> None:
        path = self.path(name)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.symlink_to(self.path(target))

    def process(self, pid: int, *command: str, opened: str | None = None) -> None:
        self.put(f"/proc/{pid}/cmdline", "\0".join(command) + "\0")
        self.put(f"/proc/{pid}/comm", Path(command[0]).name[:15] + "\n")
        self.path(f"/proc/{pid}/fd").mkdir()
        if opened is not None:
            self.path(f"/proc/{pid}/fd/7").symlink_to(opened)

    def plug(
        self,
        device: str,
        vid: int | None = 0x2341,
        pid: int | None = DUE_PROGRAMMING_PORT,
        serial_number: str | None = "7523",
        description: str = "Arduino Due Prog. Port",
    ) -> None:
        self.put(device)
        self.ports.append(
            SimpleNamespace(
                device=device, vid=vid, pid=pid, serial_number=serial_number, description=description
            )
        )


def finding_of(findings: list[Finding], check: str) -> Finding:
    (found,) = [finding for finding in findings if finding.check == check]
    return found


def levels(findings: list[Finding]) -> dict[str, str]:
    """Return how bad each finding of `fltea doctor` is (such as "warning"), by the name of its check.

    If a check has several findings, the last one counts.
    """
    return {finding.check: finding.level for finding in findings}
