"""Turns tables of numbers from any file into a recording: scaled, timed, with gaps for missing numbers."""

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
from fltea.recording.npz_arrays import NUMBER_BYTES
from fltea.recording.sample_numbers import Numbering
from fltea.recording.sample_times import Elapsed, Floats, Ints, Marks, between
from fltea.recording.spool import Spool
from fltea.recording.timing import Timing, check_given, timing
from fltea.records.errors import Implausible, NoNumbers, UsageError
from fltea.settings.limits import Limits

MOST_DPS = 4000.0
"""Largest plausible rate [deg/s]; gyroscopes in phones and for navigation have no wider range."""

ENOUGH_ROWS = 50
"""Number of rows from which implausible numbers are reported."""

FEWEST_BETWEEN = 20
"""Fewest rows between two samples that are left out as surplus; fewer rows may be jitter of the clock."""

STEPS_AT_ONCE = 1 << 16
LATEST = LARGEST_NUMBER * 1e3
"""Latest accepted time, in the unit of the column of times."""


class Rows(NamedTuple):
    """Some rows of a table.

    `numbers`: (n,) number of each row or line in the file, for messages.
    `values`: (n, columns), in the order of `Chosen.places` and scaled by `Chosen.scale`; NaN: no number.
    `ordinal`: (n,) index of each row among all samples, lost samples included, from 0.
    `begins`: whether the sender restarted before the first of these rows.
    """

    numbers: Ints
    values: Floats
    ordinal: Ints
    begins: bool = False


def joined(pieces: Sequence[Rows]) -> Rows:
    """Join successive `Rows`, at least one, to one."""
    if len(pieces) == 1:
        return pieces[0]
    numbers, values, ordinal = (
        np.concatenate(parts) for parts in zip(*(one[:3] for one in pieces), strict=True)
    )
    return Rows(numbers, values, ordinal, pieces[0].begins)


class Samples(NamedTuple):
    """Rows that are samples. `time`: (n,) times as in the file, or None. `accel`: (n, 3) [m/s²], or None.

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
    """Return the rows that are samples: rows that have all needed numbers and no impossible ones."""
    values, numbers, ordinal = rows.values, rows.numbers, rows.ordinal
    axes, needed = len(chosen.gyro), len(chosen.needed)
    largest = LARGEST_DPS * (chosen.lsb or 1.0)
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


class Plausible:
    """Checks whether rates fit a gyroscope at rest; a wrong unit or column gives impossible values."""

    def __init__(self, chosen: Chosen) -> None:
        self._chosen, self.rows = chosen, 0
        self._large = np.zeros(len(chosen.gyro), np.int64)
        self._rises: Marks = np.ones(len(chosen.gyro), np.bool_)
        self._last: Floats | None = None

    def add(self, gyro: Floats) -> None:
        """Add the next samples."""
        self.rows += len(gyro)
        size, most = np.abs(gyro), MOST_DPS * (self._chosen.lsb or 1.0)
        if size.max() > most:  # tested first, since the sum over rows is slow
            self._large += (size > most).sum(axis=0)
        if self._rises.any():
            steps = np.diff(gyro, axis=0, prepend=gyro[:1] - 1.0 if self._last is None else self._last)
            self._rises &= (steps > 0).all(axis=0)
        self._last = gyro[-1:]

    def check(self, where: str) -> None:
        """Check all samples so far, if there are enough.

        Raises:
            Implausible: no gyroscope gives such numbers.
        """
        if self.rows < ENOUGH_ROWS:
            return
        chosen = self._chosen
        names = [chosen.names[place] for place in chosen.gyro]
        for name, rises, large in zip(names, self._rises, self._large, strict=True):
            if rises:
                raise Implausible(
                    f"{where}: column '{name}' rises from each of its {self.rows} rows to the next, as "
                    "times and counters do and no gyroscope at rest does. Name the axes with --columns."
                )
            if large > self.rows // 2:
                raise Implausible(
                    f"{where}: column '{name}' is beyond {MOST_DPS:g} deg/s in {large} of {self.rows} rows, "
                    f"read in the unit {chosen.units}; no gyroscope at rest gives that. If it holds counts, "
                    "say how many a deg/s has by the data sheet, such as --units lsb:131; if thousandths, "
                    "--units mdps."
                )


def is_of_sensor(values: Floats) -> Marks:
    """Mark the rows whose numbers a sensor can give, in deg/s or m/s²; rows with NaN are not marked."""
    good = np.abs(values) <= LARGEST_DPS
    return np.ones(len(values), np.bool_) if good.all() else np.asarray(good.all(axis=1))


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
    """Return the position of a row, counted from 0, for messages."""
    return f"{path}: row {row}"


class _Table:
    """Collects the rows of a table."""

    def __init__(self, path: Path, chosen: Chosen, limits: Limits, place: Callable[[int], str]) -> None:
        self._path, self._chosen, self._place = path, chosen, place
        self._given_hz = chosen.rate_hz if chosen.is_given else None
        self._limits = limits
        self._most = limits.whole_bytes // NUMBER_BYTES
        self._spool = Spool()
        self._rows = 0
        self._left_out: dict[str, tuple[int, int]] = {}
        self._plausible = Plausible(chosen)
        self._some = np.zeros(len(chosen.needed), dtype=bool)
        self._has_accel = bool(chosen.accel)
        self._is_new_run = False
        self._elapsed = Elapsed(chosen.time_unit)
        self._last_elapsed = 0.0
        self._has_between = False
        self._begins: list[Ints] = []
        self._headers: list[int] = []
        self._notes: list[Note] = []

    def add(self, block: Rows) -> None:
        """Add the next rows."""
        width = len(self._chosen.places)
        fits = self._most // width - self._rows
        if len(block.values) > fits:
            size = (self._most // width + 1) * width * NUMBER_BYTES
            raise self._limits.whole_too_large(self._place(int(block.numbers[fits])), size)
        self._rows += len(block.values)
        self._some |= np.isfinite(block.values[:, : len(self._some)]).any(axis=0)
        found = samples_of(block, self._chosen)
        for reason, (first, count) in found.left_out.items():
            before = self._left_out.get(reason, (first, 0))
            self._left_out[reason] = before[0], before[1] + count
        self._is_new_run |= block.begins
        if not len(found.gyro):
            return
        self._plausible.add(found.gyro)
        row = self._spool.length("gyro")
        begins = np.zeros(len(found.gyro), dtype=bool)
        if found.time is not None:
            elapsed, begins = self._elapsed.add(found.time, found.gyro, found.numbers)
            self._spool.append("time", elapsed)
            self._last_elapsed = float(elapsed[-1])
        if self._is_new_run and row:
            self._headers.append(row)
        self._is_new_run = False
        if begins.any():
            self._begins.append(row + np.flatnonzero(begins))
        self._spool.append("gyro", found.gyro)
        self._spool.append("row", found.ordinal)
        if self._has_accel and found.accel is not None:
            self._add_accel(found.numbers, found.accel)

    def _add_accel(self, numbers: Ints, accel: Floats) -> None:
        """Keep the accelerations; drop the accelerometer if a sample has no acceleration."""
        good = is_of_sensor(accel)
        if good.all():
            self._spool.append("accel", accel)
            return
        self._has_accel = False
        self._spool.drop("accel")
        names = listed(self._chosen.read[len(self._chosen.needed) :])
        text = (
            f"{self._place(int(numbers[int(np.argmax(~good))]))}: {names}: a row has no acceleration here, "
            "so the accelerometer is left out."
        )
        self._notes.append(Note("missing_numbers", text))

    def stored(self) -> Stored:
        """Return all rows as a recording."""
        chosen, spool = self._chosen, self._spool
        n = spool.length("gyro")
        if not n:
            raise self._none()
        self._plausible.check(str(self._path))
        self._note_left_out()
        found = self._timing()
        if found.warning:
            self._notes.append(Note("row_times", found.warning))
        if found.period is None or "time" not in spool:
            spool.drop("time")
            samples, last_s = n, (n - 1) / found.rate_hz
        else:
            spool.drop("row")
            samples = n - self._elapsed.repeated - self._note_between(found)
            last_s = self._last_elapsed * found.unit_s
        check_span(self._path, found.rate_hz, samples, last_s)
        begins = np.concatenate(self._begins) if self._begins else np.empty(0, np.int64)
        make = partial(
            _blocks,
            spool,
            chosen,
            found,
            begins,
            given=self._given_hz is not None,
            has_between=self._has_between,
        )
        answers = (*chosen.answers, *found.answers)
        notes = (*chosen.notes, *self._notes)
        return Stored(
            samples, found.rate_hz, chosen.lsb, None, make, notes, reading=answers, axes=chosen.axes
        )

    def _note_between(self, timing: Timing) -> int:
        """Count and report the rows between two samples, which are left out."""
        assert timing.period is not None
        count = sum(
            int(between(times, timing.period).sum()) for (times,) in self._spool.blocks(["time"], AT_ONCE)
        )
        self._has_between = count >= FEWEST_BETWEEN
        if self._has_between:
            text = f"{count} rows stand between two samples of an even clock, and are left out: are they of"
            self._notes.append(
                Note("row_times", f"{self._path}: column '{self._chosen.time_name}': {text} another sensor?")
            )
        return count if self._has_between else 0

    def _none(self) -> UsageError:
        chosen = self._chosen
        if not self._rows:
            return UsageError(f"{self._path}: has a header but no rows.")
        reason, (first, _) = next(iter(self._left_out.items()))
        where = self._place(first)
        if reason == "too_large":
            return UsageError(f"{where}: more than {LARGEST_DPS:g} deg/s; is --units {chosen.units} right?")
        if reason == "time":
            return UsageError(f"{where}: column '{chosen.time_name}' has a time that cannot be.")
        empty = [name for name, some in zip(chosen.read, self._some, strict=False) if not some]
        what = f"column {listed(empty)} is empty" if empty else "no row has numbers in all columns"
        return NoNumbers(f"{where}: {what} ({listed(chosen.read)} are read).", self._rows)

    def _note_left_out(self) -> None:
        for reason, (first, count) in self._left_out.items():
            where = f"{self._place(first)}: the first of {count} rows (of {self._rows}) "
            match reason:
                case "not_finite":
                    text = "with an empty field, NaN or the like: their samples count as lost."
                    self._notes.append(Note("missing_numbers", where + text))
                case "too_large":
                    right = f"is --units {self._chosen.units} right?"
                    text = f"with more than {LARGEST_DPS:g} deg/s, which are left out; {right}"
                    self._notes.append(Note("bad_lines", where + text))
                case _:
                    text = f"with a time in '{self._chosen.time_name}' that cannot be, which are left out."
                    self._notes.append(Note("bad_lines", where + text))

    def _timing(self) -> Timing:
        """Return how rows are numbered; report new runs and repeated rows that the times show."""
        chosen, spool = self._chosen, self._spool
        if chosen.time is None:
            assert chosen.rate_hz is not None  # `choose` requires a column of times or a rate
            check_given(str(self._path), chosen.rate_hz, overrule=chosen.overrule)
            self._begins = [np.array(self._headers, np.int64)]
            return Timing(chosen.rate_hz, None)
        clock = clock_of(
            lambda: (times for (times,) in spool.blocks(["time"], STEPS_AT_ONCE)),
            self._elapsed,
        )
        found = timing(str(self._path), chosen.times, clock, self._elapsed, self._place)
        if found.period is None:
            self._begins = [np.array(self._headers, np.int64)]
        elif runs := sum(map(len, self._begins)):
            text = f"column '{chosen.time_name}' runs backwards {runs} times; a new run begins at each."
            self._notes.append(Note("row_times", f"{self._path}: {text}"))
        if found.period is not None and self._elapsed.hours and self._elapsed.unit_s == found.unit_s:
            text = (
                f"{self._elapsed.hours} steps of an hour, at which a new run begins. In a night of daylight "
                "saving a clock of local time has one, and then no sample is missing: write times in UTC, or "
                "with their offset (+02:00)."
            )
            self._notes.append(Note("row_times", f"{self._path}: column '{chosen.time_name}': {text}"))
        if found.period is not None and self._elapsed.repeated:
            text = f"{self._elapsed.repeated} rows have the time of the row before them, and are left out."
            self._notes.append(Note("row_times", f"{self._path}: column '{chosen.time_name}': {text}"))
        return found


def _blocks(
    spool: Spool, chosen: Chosen, timing: Timing, begins: Ints, *, given: bool, has_between: bool
) -> Iterator[Recording]:
    """Yield blocks of samples.

    `given`: whether the user gives the rate; then sequence numbers determine the times. `has_between`:
    whether surplus rows between two samples are left out.
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
            yield Recording(gyro, rate_hz, device_s, chosen.lsb, seq=seq, epoch=epochs, accel_ms2=accel_ms2)
