"""Runs the daemon on a simulated board's port.

The functions compare what the daemon has written with what the board has sent.
"""

import contextlib
import time
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

from fltea.recording.part_reader import read_entries
from fltea.recording.session import LINK, WIRE, LinkMessage
from fltea.sources.mcap import find_session
from fltea.sources.wire_events import SILENCE_S
from msgspec import json

from tools.faults.account import Account, Record, Sample, account, heard, shown, wrong_ends
from tools.faults.outcome import Outcome
from tools.faults.program import Program
from tools.faults.pty_board import LSB_PER_DPS, Board
from tools.faults.stage import Stage

RECORDING = "recording"
BEFORE = AFTER = 150
"""Numbers of samples that the board sends before and after the fault."""
UNINTERRUPTED_S = 0.45


class Scene:
    """A simulated board on a serial port, and the daemon that records what the board sends.

    `settings`: flags of `fltea run`. `board`: the board to use; without it a new board is made. `source`:
    options that name the daemon's source, by default the board's port. `boot`: see `Board.boot`. `how`: see
    `Program`.
    """

    def __init__(
        self,
        stage: Stage,
        *settings: str | Path,
        board: Board | None = None,
        source: Sequence[str] | None = None,
        boot: Mapping[str, int] | None = None,
        **how: Any,
    ) -> None:
        self.stage = stage
        self.board = board or stage.board()
        self.recording = stage.folder / RECORDING
        self._ended_ns = 0
        self.programs: list[Program] = []
        """Programs that read the board's port, one after another."""
        if source is None:
            source = ("--source", f"serial:{self.board.link}")
        self.program = self.listen(*source, "--record", self.recording, *settings, **how)
        self.introduce(**(boot or {}))

    def listen(self, *arguments: str | Path, **how: Any) -> Program:
        """Start another daemon on the board."""
        self.programs.append(self.stage.daemon(*arguments, **how))
        return self.programs[-1]

    def introduce(self, **how: int) -> None:
        """Boot the board, and let it send HELLO until the daemon has received it."""
        boot_id, program = len(self.board.boots) + 1, self.program

        def heard() -> bool:
            return program.process.poll() is not None or program.has_hello(boot_id)

        try:
            self.board.introduce(heard, **how)
        except TimeoutError as error:
            raise TimeoutError(f"{error}: {program.stderr[-500:]} {program.records[-1:]}") from error
        program.wait_for(lambda: program.has_hello(boot_id), "the first HELLO")

    @contextlib.contextmanager
    def fault(self, *, before: int = BEFORE) -> Iterator[Board]:
        """Send `before` samples, then let the caller cause the fault in the `with` block.

        The time at which the block ends is stored as the end of the fault.
        """
        self.board.send(before)
        yield self.board
        self._ended_ns = time.monotonic_ns()

    def send_until_error(self, kind: str) -> None:
        """Let the board send until the daemon has reported this kind of error."""
        self.board.send_until(lambda: kind in self.programs[-1].errors(), kind)

    def finish(self, *, after: int = AFTER) -> None:
        """Send `after` more samples. Once the newest program has received the last one, end this program.

        The newest program is the one that was started last.
        """
        self.board.send(after)
        i, k = max(self.board.arrived())
        boot, program = self.board.boots[i], self.programs[-1]
        program.wait_for_sample(boot.boot_id, boot.sequence + k)
        program.end()

    def outcome(
        self,
        *,
        but: str = "",
        excuse: str = "",
        figures: Mapping[str, float] | None = None,
        wrong: Sequence[str] = (),
        line_is_known: bool = True,
        recording_is_whole: bool = True,
    ) -> Outcome:
        """Return what became of samples, recording and estimates.

        Call `finish` first, if it has not been called yet.

        `but`: name of the only output that may lose records; empty if none may. `excuse`, `line_is_known`:
        see `samples_of`. `recording_is_whole`: whether the recording has to contain all bytes that were sent.
        """
        if self.programs[-1].code is None:
            self.finish()
        programs, records = self.programs, [program.records for program in self.programs]
        samples = samples_of(self.board, records, excuse=excuse, line_is_known=line_is_known)
        found = [*wrong, *samples.wrong]
        for program in programs:
            found += wrong_ends(program)
            if program.code == 0:
                found += check_totals(program.records)
                found += lost_by_outputs(program, but=but)
        if recording_is_whole:
            found += missing_in_recording(self.recording, self.board)
        times = sorted(ns for program in programs for ns in program.estimates_ns)
        after = [ns for ns in times if ns >= self._ended_ns]
        if not after:
            found.append("no estimates after the fault")
        pause_s = max((b - a for a, b in pairwise(times)), default=0) * 1e-9
        again_s = (after[0] - self._ended_ns) * 1e-9 if after else 0.0
        estimates = f"again after {again_s:.1f} s" if pause_s >= UNINTERRUPTED_S else "not interrupted"
        epochs = [record["reason"] for program in programs for record in program.of("epoch")][1:]
        return Outcome(
            [*faults_of(programs, self.board), *epochs],
            samples.due,
            samples.where,
            more=f"estimates {estimates}",
            figures=dict(figures or {}),
            wrong=found,
        )


def samples_of(
    board: Board, programs: Sequence[Sequence[Record]], *, excuse: str = "", line_is_known: bool = True
) -> Account:
    """Return what became of each sampling instant of a board: delivered, counted as lost, or excused.

    An instant is identified by its boot and its number in that boot.

    `programs`: the records of the programs that listened, one after another. `excuse`: why samples may be
    missing before a boot's first delivered sample or after its last one. If it is empty, none may be missing
    there. `line_is_known`: False if another program also read bytes from the serial port.
    """
    boots = {boot.boot_id: number for number, boot in enumerate(board.boots)}
    due = {(i, k) for i, boot in enumerate(board.boots) for k in range(boot.due)}
    arrived = board.arrived()
    found, spans, wrong = [], set[Sample](), []
    for records in programs:
        boot_of = {r["epoch"]: boots[r["boot_id"]] for r in records if r["class"] == "epoch"}

        def instant(record: Record, boot_of: dict[int, int] = boot_of) -> tuple[int, int]:
            i = boot_of[record["epoch"]]
            return i, (record["seq"] - board.boots[i].sequence) % (1 << 16)

        for record in records:
            if record["class"] == "sample":
                i, k = instant(record)
                counts = tuple(round(rate * LSB_PER_DPS) for rate in record["gyro_dps"])
                if (i, k) in due and counts != board.boots[i].counts[k]:
                    wrong.append(f"not what was sent: {(i, k)} {counts}")
        one = heard(records, instant)
        for i in set(boot_of.values()):
            numbers = [k for boot, k in one.delivered if boot == i]
            spans |= {(i, k) for k in range(min(numbers, default=0), max(numbers, default=-1) + 1)}
        found.append(one)
    delivered = {sample for one in found for sample in one.delivered}
    checks = {
        "delivered, but not whole on the line": delivered - arrived,
        "whole on the line, but not delivered": (arrived & spans) - delivered if line_is_known else set(),
    }
    wrong += [f"{what}: {shown(which)}" for what, which in checks.items() if which]
    excused = due - spans if excuse else set[Sample]()
    sums = account(due, found, excused, excuse, once=True)
    return sums._replace(wrong=[*wrong, *sums.wrong])


def check_totals(records: Sequence[Record]) -> list[str]:
    """Return the counts in a program's last `stats` record that differ from the sums over all records."""
    stats = [record for record in records if record["class"] == "stats"][-1]["sample_counts"]
    gaps = [record["missing"] for record in records if record["class"] == "gap"]
    samples = sum(record["class"] == "sample" for record in records)
    expected = {"delivered": samples, "lost": sum(gaps), "gaps": len(gaps), "duplicates": 0}
    return [
        f"stats.sample_counts.{name} is {stats[name]}, not {value}"
        for name, value in expected.items()
        if stats[name] != value
    ]


def faults_of(programs: Sequence[Program], board: Board) -> list[str]:
    """Return the kinds of errors that programs reported.

    The kind `silent` says that no bytes arrive. It is left out if the board really sent nothing for so long.
    """
    was_silent = board.longest_silence_s > SILENCE_S - 1
    kinds = (kind for program in programs for kind in program.errors())
    return [kind for kind in kinds if not (kind == "silent" and was_silent)]


class Recorded(NamedTuple):
    """Contents of a recording.

    `wire`: all recorded bytes of the serial port. `gaps`: the entries that say that bytes are missing.
    `steps_ns`: Unix time minus the recording's own time, which never jumps: first at the beginning, then
    after each jump of Unix time by more than a second.
    """

    wire: bytes
    gaps: list[LinkMessage]
    steps_ns: list[int]


def read_recording(folder: Path) -> Recorded:
    """Read the recorded bytes of the only recording in a folder."""
    wire = bytearray()
    gaps: list[LinkMessage] = []
    steps_ns: list[int] = []
    for part in find_session([folder]).parts:
        for entry in read_entries(part):
            if entry.topic == WIRE:
                wire += entry.data
                step_ns = entry.publish_ns - entry.log_ns
                if not steps_ns or abs(step_ns - steps_ns[-1]) > 10**9:
                    steps_ns.append(step_ns)
            elif entry.topic == LINK:
                message = json.decode(entry.data, type=LinkMessage)
                gaps += [message] if message.event == "gap" else []
    return Recorded(bytes(wire), gaps, steps_ns)


def missing_in_recording(folder: Path, board: Board) -> list[str]:
    """Return a text if the recording lacks bytes that the board sent after an accepted HELLO.

    A half frame at the end does not count, since the board may have been unplugged in the middle of it.
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


def lost_by_outputs(program: Program, but: str = "") -> list[str]:
    """Return which outputs, except `but`, lost records according to their last counts."""
    outputs = program.of("stats")[-1]["outputs"]
    return [
        f"the output {name} lost {one['dropped']} records"
        for name, one in outputs.items()
        if one["dropped"] and name != but
    ]


def time_stamps_off_ms(program: Program, *epochs: int) -> dict[str, float]:
    """Return how much host time minus device time varies while samples come without a break [ms].

    For each epoch (run of samples without a break), the smallest difference is subtracted from the largest.
    The result is the greatest of these values.
    """
    spreads = []
    for epoch in epochs:
        samples = [record for record in program.of("sample") if record["epoch"] == epoch]
        delays = [record["host_ns"] - record["device_us"] * 1000 for record in samples]
        spreads.append(float(max(delays) - min(delays)) * 1e-6)
    return {"time stamps off [ms]": max(spreads)}


def bad_frames(program: Program) -> dict[str, float]:
    """Return a figure for `Outcome.figures`: the number of frames that did not pass the program's checks."""
    return {"bad frames": sum(program.of("stats")[-1]["link"]["bad_frames"].values())}
