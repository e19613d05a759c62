"""Where a fault is played: the board, the daemon on its port, and what is found afterwards."""

import contextlib
import time
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

from fltea.recording.session import LINK, WIRE, Entry, LinkMessage
from fltea.sources.mcap import find_parts, read_entries
from msgspec import json

from tools.fault_script.account import Account, account, check_totals
from tools.fault_script.board import Board
from tools.fault_script.program import Program

RECORDING = "recording"
UNINTERRUPTED_S = 0.45


class Skip(Exception):
    """A fault cannot be played here; the text says what is missing."""


class Outcome(NamedTuple):
    """What a fault did.

    errors: kinds that the daemon told. epochs: why new ones began. fault_s: how long the trouble lasted.
    again_s: from its end to the next estimate. pause_s: the longest time between two estimates. others: what
    other outputs lost. figures: whatever else there is to say. wrong: what should not be.
    """

    account: Account
    errors: list[str]
    epochs: list[str]
    fault_s: float
    again_s: float
    pause_s: float
    others: str
    figures: Mapping[str, float]
    wrong: list[str]


class Stage:
    """One folder, and whatever runs in it; nothing is left running. short: as the tests play it."""

    def __init__(self, folder: Path, *, short: bool) -> None:
        self.folder = folder
        self.short = short
        self._stack = contextlib.ExitStack()
        self._began_ns = self._ended_ns = 0

    def __enter__(self) -> "Stage":
        return self

    def __exit__(self, *exception: object) -> None:
        self._stack.close()

    def later(self, action: Callable[[], Any]) -> None:
        """Do this at the end, whatever happens."""
        self._stack.callback(action)

    def board(self, seed: int = 1) -> Board:
        """A board, plugged in."""
        board = Board(self.folder / "board", seed)
        self.later(board.close)
        return board

    def program(self, *arguments: str | Path, **how: Any) -> Program:
        """The daemon; see `Program`."""
        program = Program(arguments, **how)
        self.later(program.kill)
        return program

    def recorder(self, board: Board, *arguments: str | Path, **how: Any) -> Program:
        """The daemon on the board's port, and recording."""
        source = ("--source", f"serial:{board.link}", "--record", self.folder / RECORDING)
        return self.program(*source, *arguments, **how)

    def pair(self, *arguments: str | Path, **how: Any) -> tuple[Board, Program]:
        """A board and the daemon that has heard its first HELLO."""
        board = self.board()
        program = self.recorder(board, *arguments)
        introduce(board, program, **how)
        return board, program

    def fault(self) -> contextlib.AbstractContextManager[None]:
        """Notes when the trouble begins and ends."""
        return _Timed(self)

    def finish(self, board: Board, *programs: Program) -> None:
        """Let the programs have the last sample, and end them."""
        i, k = max(board.arrived())
        boot = board.boots[i]
        for program in programs:
            program.wait_for_sample(boot.boot_id, boot.sequence + k)
            program.end()

    def outcome(
        self,
        board: Board,
        *programs: Program,
        others: str | None = None,
        figures: Mapping[str, float] | None = None,
        wrong: Sequence[str] = (),
        line_is_known: bool = True,
    ) -> Outcome:
        """Sum up. programs: those that listened to the board, one after the other."""
        books = account(board, [p.records for p in programs], line_is_known=line_is_known)
        found = [*wrong, *books.wrong]
        for program in programs:
            if program.code == 0:
                found += check_totals(program.records)
            elif program.code is not None and program.code > 0:
                found.append(f"exit code {program.code}: {program.stderr[-500:]}")
            if "Traceback" in program.stderr:
                found.append(program.stderr[-500:])
        if others is None:
            others = dropped(programs[-1])
            found += missing_in_recording(self.folder / RECORDING, board)
        times = sorted(ns for program in programs for ns in program.estimates_ns)
        after = [ns for ns in times if ns >= self._ended_ns]
        if not after:
            found.append("no estimates after the fault")
        pauses = [b - a for a, b in pairwise(times)]
        return Outcome(
            account=books,
            errors=[kind for program in programs for kind in program.errors()],
            epochs=[record["reason"] for program in programs for record in program.of("epoch")][1:],
            fault_s=(self._ended_ns - self._began_ns) * 1e-9,
            again_s=(after[0] - self._ended_ns) * 1e-9 if after else -1.0,
            pause_s=max(pauses, default=0) * 1e-9,
            others=others,
            figures=figures or {},
            wrong=found,
        )


class _Timed(contextlib.AbstractContextManager[None]):
    def __init__(self, stage: Stage) -> None:
        self._stage = stage

    def __enter__(self) -> None:
        self._stage._began_ns = time.monotonic_ns()

    def __exit__(self, *exception: object) -> None:
        self._stage._ended_ns = time.monotonic_ns()


class Recorded(NamedTuple):
    """What a recording holds.

    wire: all bytes. gaps: where the recorder missed something. steps_ns: Unix time less the recording's own
    time, wherever it changed.
    """

    wire: bytes
    gaps: list[LinkMessage]
    steps_ns: list[int]


def read_recording(folder: Path) -> Recorded:
    """Read the wire of the one recording in a folder."""
    wire = bytearray()
    gaps: list[LinkMessage] = []
    steps_ns: list[int] = []
    for part in find_parts([folder]):
        for entry in read_entries(part):
            if isinstance(entry, Entry) and entry.topic == WIRE:
                wire += entry.data
                step_ns = entry.publish_ns - entry.log_ns
                if not steps_ns or abs(step_ns - steps_ns[-1]) > 10**9:
                    steps_ns.append(step_ns)
            elif isinstance(entry, Entry) and entry.topic == LINK:
                message = json.decode(entry.data, type=LinkMessage)
                gaps += [message] if message.event == "gap" else []
    return Recorded(bytes(wire), gaps, steps_ns)


def missing_in_recording(folder: Path, board: Board) -> list[str]:
    """What was put on the line after each introduction has to be in the recording, byte by byte.

    But for the half frame with which a board may have been unplugged.
    """
    wire, at = read_recording(folder).wire, 0
    for number, stream in enumerate(board.streams):
        if board.streams[number + 1 :]:
            stream = stream[: stream.rfind(0) + 1]
        at = wire.find(bytes(stream), at)
        if at < 0:
            return [f"the recording does not hold what the board sent (plugged in {number + 1} times)"]
        at += len(stream)
    return []


def dropped(program: Program, but: str = "") -> str:
    """Which outputs lost something, as their last counts have it."""
    outputs = program.of("stats")[-1]["outputs"]
    lost = {name: one["dropped"] for name, one in outputs.items() if one["dropped"] and name != but}
    return ", ".join(f"{name} lost {n}" for name, n in lost.items()) or "unaffected"


def introduce(board: Board, program: Program, **how: int) -> None:
    """Boot the board until the daemon has heard of it."""
    boot_id = len(board.boots) + 1
    board.introduce(lambda: program.process.poll() is not None or program.has_hello(boot_id), **how)
    program.wait_for(lambda: program.has_hello(boot_id), "the first HELLO")


def time_stamps_off_ms(program: Program, epoch: int) -> float:
    """Spread of the samples' host time about a straight line in device time, within an epoch [ms]."""
    samples = [record for record in program.of("sample") if record["epoch"] == epoch]
    delays = [record["host_ns"] - record["device_us"] * 1000 for record in samples]
    return float(max(delays) - min(delays)) * 1e-6
