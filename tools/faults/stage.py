"""Where a fault is played: it starts boards, programs, brokers and lines, and ends what it started."""

import contextlib
import struct
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Protocol, TypeVar

from tools.faults.cut_line import CutLine
from tools.faults.program import Program
from tools.faults.pty_board import Board
from tools.faults.server import Broker
from tools.faults.small_disk import SmallDisk

QUICK = ("--startup", "50", "--set", "estimator.window=200")
"""A start-up window of 0.5 s in place of 5 s."""


class _Ends(Protocol):
    def close(self) -> object: ...


E = TypeVar("E", bound=_Ends)


class Stage:
    """One folder, and whatever runs in it; nothing is left running.

    short: seconds in place of minutes. image: file for the emulated Due, if not ours. clock: the file that
    moves the clock of the programs that are started with it.
    """

    def __init__(self, folder: Path, *, short: bool = True, image: Path | None = None) -> None:
        self.folder = folder
        self.short = short
        self.image = image
        self.clock = folder / "clock"
        self.set_clock(0)
        self.began_ns = self.ended_ns = 0
        self._stack = contextlib.ExitStack()

    def __enter__(self) -> "Stage":
        return self

    def __exit__(self, *exception: object) -> None:
        self._stack.close()

    def later(self, action: Callable[[], Any]) -> None:
        """Do this at the end, whatever happens."""
        self._stack.callback(action)

    def closing(self, made: E) -> E:
        """Close it at the end, whatever happens."""
        self.later(made.close)
        return made

    def program(self, *command: str | Path, **how: Any) -> Program:
        """A command of `fltea`; see `Program`."""
        program = Program(command, **how)
        self.later(program.kill)
        return program

    def daemon(self, *arguments: str | Path, **how: Any) -> Program:
        """`fltea run`, which reports every sample, and estimates soon."""
        return self.program("run", "--samples", *QUICK, *arguments, **how)

    def board(self, seed: int = 1) -> Board:
        """A board on a pseudo-terminal, plugged in."""
        return self.closing(Board(self.folder / "board", seed))

    def broker(self, *, persistent: bool = False, logs: bool = True) -> Broker:
        """An MQTT broker; see `Broker`."""
        broker = Broker(self.folder, persistent=persistent, logs=logs)
        self.later(broker.kill)
        return broker

    def line(self, port: int) -> CutLine:
        """A line to a port, which can be cut."""
        return self.closing(CutLine(port))

    def disk(self, name: str, **how: Any) -> SmallDisk:
        """A disk that can be filled; see `SmallDisk`."""
        return self.closing(SmallDisk(self.folder / name, **how))

    def set_clock(self, ahead_ns: int) -> None:
        """Set the clock so far ahead of the machine's."""
        self.clock.touch()
        with self.clock.open("r+b") as file:
            file.write(struct.pack("<q", ahead_ns))

    @contextlib.contextmanager
    def fault(self) -> Iterator[None]:
        """Notes when the trouble begins and ends."""
        self.began_ns = time.monotonic_ns()
        yield
        self.ended_ns = time.monotonic_ns()
