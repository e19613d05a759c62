"""Starts the boards, programs, brokers and connections that a fault needs, and ends all of them."""

import contextlib
import struct
from pathlib import Path
from typing import Any, Protocol, TypeVar

from tools.faults.cut_line import CutLine
from tools.faults.program import Program
from tools.faults.pty_board import Board
from tools.faults.server import Broker
from tools.faults.small_disk import SmallDisk

QUICK = ("--startup", "50", "--set", "estimator.window=200")
"""Setting of the estimator's start-up: it takes 0.5 s instead of 5 s, so that faults can be played sooner."""


class _Ends(Protocol):
    def close(self) -> object: ...


E = TypeVar("E", bound=_Ends)


class Stage(contextlib.ExitStack):
    """A folder, and all programs and servers that run for one fault.

    When the `with` block ends, all of them are ended.

    Further functions that are to be called on exit can be registered with `callback`.

    `short`: whether faults last seconds instead of minutes. `image`: firmware image for the emulated Due, by
    default the committed image. `clock`: file whose value shifts the clock of programs; `set_clock` writes
    it. The file has to be passed to a program when it is started.
    """

    def __init__(self, folder: Path, *, short: bool = True, image: Path | None = None) -> None:
        super().__init__()
        self.folder, self.short, self.image = folder, short, image
        self.clock = folder / "clock"
        self.set_clock(0)

    def closing(self, made: E) -> E:
        """Call `made.close` when the `with` block ends; return `made`."""
        self.callback(made.close)
        return made

    def program(self, *command: str | Path, **how: Any) -> Program:
        """Start a command of `fltea`; see `Program`."""
        program = Program(command, **how)
        self.callback(program.kill)
        return program

    def daemon(self, *arguments: str | Path, **how: Any) -> Program:
        """Start `fltea run` with settings that make it report every sample and begin to estimate early."""
        return self.program("run", "--samples", *QUICK, *arguments, **how)

    def board(self, seed: int = 1) -> Board:
        """Return a board on a pseudo-terminal, plugged in."""
        return self.closing(Board(self.folder / "board", seed))

    def broker(self, *, persistent: bool = False, logs: bool = True) -> Broker:
        """Start an MQTT broker; see `Broker`."""
        broker = Broker(self.folder, persistent=persistent, logs=logs)
        self.callback(broker.kill)
        return broker

    def line(self, port: int) -> CutLine:
        """Return a connection to a TCP port, which can be cut."""
        return self.closing(CutLine(port))

    def disk(self, name: str, **how: Any) -> SmallDisk:
        """Return a disk that can be filled; see `SmallDisk`."""
        return self.closing(SmallDisk(self.folder / name, **how))

    def set_clock(self, ahead_ns: int) -> None:
        """Set the clock of the programs ahead of the machine's clock by `ahead_ns`."""
        with self.clock.open("r+b" if self.clock.exists() else "wb") as file:
            file.write(struct.pack("<q", ahead_ns))
