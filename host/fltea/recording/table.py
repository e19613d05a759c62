"""Turns tables of numbers from any file into a recording: scales the rows and finds lost samples."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from fltea.recording.clocks import clock_of
from fltea.recording.columns import Chosen
from fltea.recording.files import (
    AT_ONCE,
    LARGEST_DPS,
    LARGEST_NUMBER,
    Note,
    Recording,
    Stored,
    check_span,
    listed,
)
from fltea.recording.row_counts import RowCounts
from fltea.recording.sample_numbers import Numbering
from fltea.recording.sample_store import SampleStore
from fltea.recording.sample_times import Elapsed, Floats, Ints, Marks, between
from fltea.recording.spool import Spool
from fltea.recording.timing import Timing, check_given, timing
from fltea.settings.limits import Limits

FEWEST_BETWEEN = 20
"""Surplus rows are rows between two samples that are one sampling period apart (`sample_times.between`). They
are left out only if a recording has at least this many. If there are fewer, the clock's jitter may cause
them.
"""

STEPS_AT_ONCE = 1 << 16
LATEST = LARGEST_NUMBER * 1e3
"""Largest number that is accepted in a column of times, in the unit of the column."""


class Rows(NamedTuple):
    """Successive rows of a table.

    `numbers`: (n,) number of each row or line in the file, for messages. `values`: (n, columns), in the order
    of `Chosen.places` and scaled by `Chosen.scale`; NaN: no number. `ordinal`: (n,) position of each row,
    from 0, among all samples, lost ones included. `begins`: whether the sender restarted just
    before the first of these rows.
    """

    numbers: Ints
    values: Floats
    ordinal: Ints
    begins: bool = False


def joined(pieces: Sequence[Rows]) -> Rows:
    """Join one or more successive `Rows` to one."""
    if len(pieces) == 1:
        return pieces[0]
    numbers, values, ordinal = (
        np.concatenate(parts) for parts in zip(*(one[:3] for one in pieces), strict=True)
    )
    return Rows(numbers, values, ordinal, pieces[0].begins)


class Samples(NamedTuple):
    """Those rows of a block that are samples.

    `time`: (n,) times as in the file, or None. `accel`: (n, 3) [m/s²], or None.

    `left_out`: for each reason in `text_numbers.REASONS`, the first row that was left out and the number of
    such rows.
    """

    numbers: Ints
    ordinal: Ints
    gyro: Floats
    time: Floats | None
    accel: Floats | None
    left_out: dict[str, tuple[int, int]]


def samples_of(rows: Rows, chosen: Chosen) -> Samples:
    """Return the rows that are samples. A sample has all needed numbers, and no impossible numbers."""
    values, numbers, ordinal = rows.values, rows.numbers, rows.ordinal
    axes, needed = len(chosen.gyro), len(chosen.needed)
    largest = LARGEST_DPS * (chosen.unit.lsb or 1.0)
    left_out: dict[str, tuple[int, int]] = {}

    def leave_out(reason: str, bad: Marks) -> None:
        nonlocal values, numbers, ordinal
        left_out[reason] = int(numbers[int(np.argmax(bad))]), int(bad.sum())
        values, numbers, ordinal = values[~bad], numbers[~bad], ordinal[~bad]

    if not np.isfinite(values[:, :needed]).all():
        leave_out("not_finite", np.asarray(~np.isfinite(values[:, :needed]).all(axis=1)))
    if len(values) and np.abs(values[:, :axes]).max() > largest:
        leave_out("too_large", np.asarray((np.abs(values[:, :axes]) > largest).any(axis=1)))
    if needed > axes and len(values) and np.abs(values[:, axes]).max() > LATEST:
        leave_out("time", np.asarray(np.abs(values[:, axes]) > LATEST))
    time = values[:, axes] if needed > axes else None
    accel = values[:, needed:] if chosen.accel else None
    return Samples(numbers, ordinal, values[:, :axes], time, accel, left_out)


def gather(
    path: Path,
    chosen: Chosen,
    blocks: Iterable[Rows],
    limits: Limits,
    place: Callable[[int], str],
) -> Stored:
    """Read all rows into a temporary file, and return them as a recording.

    `place`: function that returns the position of a line or row in words, for messages.

    Raises:
        UsageError: there are no rows, no gyroscope gives such numbers, or the times give no rate.
    """
    table = _Table(path, chosen, limits, place)
    for block in blocks:
        if len(block.values):
            table.add(block)
    return table.stored()


def row_place(path: Path, row: int) -> str:
    """Return the position of a row in a file, for messages. `row`: number of the row, counted from 0."""
    return f"{path}: row {row}"


class _Runs:
    """Collects the indices of samples at which a new run begins, because the sender restarted.

    `by_times`: indices where the times show a new run. `by_headers`: indices where a repeated header shows a
    new run.
    """

    def __init__(self) -> None:
        self.by_times: list[Ints] = []
        self.by_headers: list[int] = []
        self._is_due = False

    def add(self, row: int, marks: Marks | None, block: Rows) -> None:
        """Add the samples of a block. `marks` is None if no new run begins in the block."""
        self._is_due |= block.begins
        if marks is None:
            return
        if self._is_due and row:
            self.by_headers.append(row)
        self._is_due = False
        if marks.any():
            self.by_times.append(row + np.flatnonzero(marks))


class _Table:
    """Collects the rows of a table.

    `place`: function that returns the position of a row in words, for messages.
    """

    def __init__(self, path: Path, chosen: Chosen, limits: Limits, place: Callable[[int], str]) -> None:
        self._path, self._chosen, self._place = path, chosen, place
        self._samples = SampleStore(chosen, len(chosen.places), limits)
        self._counts = RowCounts(chosen)
        self._elapsed = Elapsed(chosen.clock.unit)
        self._runs = _Runs()
        self._notes: list[Note] = []

    def add(self, block: Rows) -> None:
        """Add the next rows of the table."""
        found = samples_of(block, self._chosen)
        self._counts.add(block.values, found.left_out)
        row = len(self._samples)
        if not len(found.gyro):
            self._runs.add(row, None, block)
            return
        begins: Marks = np.zeros(len(found.gyro), dtype=bool)
        others: dict[str, Floats | Ints] = {"row": found.ordinal}
        if found.time is not None:
            others["time"], begins = self._elapsed.add(found.time, found.gyro, found.numbers)
        self._runs.add(row, begins, block)
        self._samples.add(found.gyro, found.accel, others, lambda k: self._place(int(found.numbers[k])))

    def stored(self) -> Stored:
        """Return all rows as a recording."""
        chosen, spool = self._chosen, self._samples.spool
        n = len(self._samples)
        if not n:
            raise self._counts.none(self._path, self._place)
        self._drop_bad_accel()
        self._samples.plausible.check(str(self._path))
        self._notes += self._counts.notes(self._place)
        found, begins = self._timing()
        if found.warning:
            self._notes.append(Note("row_times", found.warning))
        has_between = False
        if found.period is None or "time" not in spool:
            spool.drop("time")
            samples, last_s = n, (n - 1) / found.rate_hz
        else:
            spool.drop("row")
            count = self._count_between(found.period)
            has_between = count > 0
            samples = n - self._elapsed.repeated - count
            last_s = self._elapsed.span * found.unit_s
        check_span(self._path, found.rate_hz, samples, last_s)
        make = partial(
            _blocks, spool, chosen, found, begins, given=self._given_hz is not None, has_between=has_between
        )
        answers = (*chosen.answers, *found.answers)
        notes = (*chosen.notes, *self._notes)
        return Stored(
            samples, found.rate_hz, chosen.unit.lsb, None, make, notes, reading=answers, axes=chosen.axes
        )

    def _drop_bad_accel(self) -> None:
        """Leave the accelerometer out if the acceleration of even one sample is missing or impossible."""
        first = self._samples.bad_accel.first
        if first is not None:
            self._samples.spool.drop("accel")
            names = listed(self._chosen.read[len(self._chosen.needed) :])
            text = f"{first}: {names}: a row has no acceleration here, so the accelerometer is left out."
            self._notes.append(Note("missing_numbers", text))

    def _count_between(self, period: float) -> int:
        """Return the number of surplus rows, and report them. If there are too few to leave out, return 0."""
        blocks = self._samples.spool.blocks(["time"], AT_ONCE)
        count = sum(int(between(times, period).sum()) for (times,) in blocks)
        if count < FEWEST_BETWEEN:
            return 0
        self._note_times(
            f"{count} rows stand between two samples of an even clock, and are left out: are they of another "
            "sensor?"
        )
        return count

    def _note_times(self, text: str) -> None:
        self._notes.append(Note("row_times", f"{self._path}: column '{self._chosen.time_name}': {text}"))

    @property
    def _given_hz(self) -> float | None:
        return self._chosen.rate.hz if self._chosen.rate.is_given else None

    def _timing(self) -> tuple[Timing, Ints]:
        """Return how rows are numbered, and where new runs begin.

        Warn the user if the times show something unusual.
        """
        chosen, spool, elapsed = self._chosen, self._samples.spool, self._elapsed
        by_headers = np.array(self._runs.by_headers, np.int64)
        if chosen.time is None:
            # `choose` has made sure that there is a rate if there is no column of times
            assert chosen.rate.hz is not None
            check_given(str(self._path), chosen.rate.hz, overrule=chosen.rate.overrule)
            return Timing(chosen.rate.hz, None), by_headers
        clock = clock_of(lambda: (times for (times,) in spool.blocks(["time"], STEPS_AT_ONCE)), elapsed)
        found = timing(str(self._path), chosen.times, clock, elapsed, self._place)
        if found.period is None:
            return found, by_headers
        if runs := sum(map(len, self._runs.by_times)):
            text = f"column '{chosen.time_name}' runs backwards {runs} times; a new run begins at each."
            self._notes.append(Note("row_times", f"{self._path}: {text}"))
        if elapsed.seconds:
            self._note_times(
                "its times begin again at each second, so they are taken for fractions of seconds; a gap of "
                "whole seconds cannot be seen."
            )
        hours = elapsed.local.hours
        if hours and elapsed.unit_s == found.unit_s:
            self._note_times(
                f"{hours} steps of an hour; a new run begins at each. A clock of local time makes "
                "such a step when daylight saving time begins or ends, and then no sample is missing: write "
                "times in UTC, or with their offset (+02:00)."
            )
        if elapsed.repeated:
            self._note_times(
                f"{elapsed.repeated} rows have the time of the row before them, and are left out."
            )
        return found, np.concatenate([np.empty(0, np.int64), *self._runs.by_times])


def _blocks(
    spool: Spool, chosen: Chosen, timing: Timing, begins: Ints, *, given: bool, has_between: bool
) -> Iterator[Recording]:
    """Yield blocks of the recording's samples.

    `given`: whether the user gives the rate. If so, the time of a sample is its sequence number divided by
    the rate. `has_between`: whether surplus rows are left out (see `FEWEST_BETWEEN`).
    """
    rate_hz, by_times = timing.rate_hz, timing.period is not None and "time" in spool
    columns = ["gyro", "time" if by_times else "row", *(["accel"] if "accel" in spool else [])]
    numbering = Numbering(timing.period or 1.0, rate_hz, is_rounded=timing.is_rounded)
    row = epoch = 0
    origin: int | None = None
    for gyro, place, *accel in spool.blocks(columns, AT_ONCE):
        accel_ms2 = accel[0] if accel else None
        marks = np.zeros(len(gyro), dtype=bool)
        marks[begins[(begins >= row) & (begins < row + len(gyro))] - row] = True
        row += len(gyro)
        if by_times:
            if has_between and (off := between(place, timing.period or 1.0)).any():
                gyro, place, marks = gyro[~off], place[~off], marks[~off]
                accel_ms2 = None if accel_ms2 is None else accel_ms2[~off]
            found = numbering.add(place, marks)
            if not found.kept.all():
                gyro, accel_ms2 = gyro[found.kept], None if accel_ms2 is None else accel_ms2[found.kept]
            seq, marks = found.sequence, found.begins
            device_s = seq / rate_hz if given else found.elapsed * timing.unit_s
        else:
            origin = int(place[0]) if origin is None else origin
            seq = place - origin
            device_s = seq / rate_hz
        epochs = epoch + np.cumsum(marks)
        if len(seq):
            epoch = int(epochs[-1])
            yield Recording(
                gyro, rate_hz, device_s, chosen.unit.lsb, seq=seq, epoch=epochs, accel_ms2=accel_ms2
            )
