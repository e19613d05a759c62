"""Tables of numbers, of any kind of file, as a recording: scaled, timed, with gaps where numbers lack."""

from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fltea.recording.columns import Chosen
from fltea.recording.files import (
    AT_ONCE,
    LARGEST_DPS,
    TIME_COLUMN,
    Note,
    Recording,
    Stored,
    check_span,
    listed,
    too_large,
)
from fltea.recording.npz_arrays import NUMBER_BYTES
from fltea.recording.row_times import rate_of, told_by_times
from fltea.recording.spool import Spool
from fltea.records.errors import UsageError
from fltea.settings.how import How
from fltea.settings.limits import Limits

Array = NDArray[np.float64]


class Rows(NamedTuple):
    """Some rows.

    numbers: (n,) of their lines or rows in the file, for messages. values: (n, columns) of the axes and then
    the times; NaN where there is no number. cut: number of a last line that is cut off, and left out.
    """

    numbers: NDArray[np.int64]
    values: NDArray[np.float64]
    cut: int | None = None


def gather(
    path: Path,
    chosen: Chosen,
    blocks: Iterable[Rows],
    how: How,
    limits: Limits,
    place: Callable[[int], str],
) -> Stored:
    """Take all rows; their numbers wait in a temporary file.

    place: a line or row, for messages.

    Raises:
        UsageError: no rows, numbers that no gyroscope gives, times that tell no rate.
    """
    if how.rate_hz is None and chosen.time is None:
        raise UsageError(
            f"{path}: has no column '{TIME_COLUMN}' or another whose name says times, so give its rate: "
            "--rate 100, or name the column: --time-column NAME --time-unit ms (it has: "
            f"{listed(chosen.names)})."
        )
    table = _Table(path, chosen, how, limits, place)
    for block in blocks:
        if len(block.values):
            table.add(block)
        if block.cut is not None:
            text = f"{place(block.cut)}: the last line is cut off, and left out."
            table.notes.append(Note("cut_recording", text))
    return table.stored()


def row_place(path: Path, row: int) -> str:
    """A row, from 0, for messages."""
    return f"{path}: row {row}"


class _Table:
    """What the rows so far came to."""

    def __init__(
        self, path: Path, chosen: Chosen, how: How, limits: Limits, place: Callable[[int], str]
    ) -> None:
        self._path, self._chosen, self._place, self._rate_hz = path, chosen, place, how.rate_hz
        self._most = limits.whole_bytes // NUMBER_BYTES
        self._limits = limits
        self._spool = Spool()
        self._rows = self._missing = self._first_missing = 0
        self._some = np.zeros(len(chosen.needed), dtype=bool)
        self._has_accel = bool(chosen.accel)
        self._first_time: float | None = None
        self.notes: list[Note] = []
        self._last_time = 0.0

    def add(self, block: Rows) -> None:
        """The next ones."""
        numbers, values, _ = block
        width = len(self._chosen.places)
        fits = self._most // width - self._rows
        if len(values) > fits:
            size = (self._most // width + 1) * width * NUMBER_BYTES
            raise self._limits.whole_too_large(self._place(int(numbers[fits])), size)
        values, accel = self._without_accel(numbers, values)
        lacks = np.isnan(values)
        infinite = np.isinf(values)
        if infinite.any():
            row, column = divmod(int(np.argmax(infinite)), values.shape[1])
            name = self._chosen.read[column]
            raise UsageError(f"{self._place(int(numbers[row]))}: column '{name}' is not a finite number.")
        rows = np.arange(self._rows, self._rows + len(values))
        self._rows += len(values)
        self._some |= ~lacks.all(axis=0)
        missing = lacks.any(axis=1)
        if missing.any():
            if not self._missing:
                self._first_missing = int(numbers[int(np.argmax(missing))])
            self._missing += int(missing.sum())
            numbers, values, rows, accel = (
                numbers[~missing],
                values[~missing],
                rows[~missing],
                accel[~missing],
            )
            if not len(values):
                return
        with np.errstate(over="ignore"):
            gyro = values[:, : len(self._chosen.gyro)] * self._chosen.factor
        beyond = too_large(gyro, self._chosen.lsb)
        if beyond.any():
            place = self._place(int(numbers[int(np.argmax(beyond))]))
            raise UsageError(
                f"{place}: more than {LARGEST_DPS:g} deg/s; is --units {self._chosen.units} right?"
            )
        self._spool.append("gyro", gyro)
        if self._has_accel:
            self._spool.append("accel", accel)
        if self._chosen.time is not None:
            self._add_times(numbers, values[:, -1])
        if self._rate_hz is not None:
            self._spool.append("row", rows)

    def _without_accel(self, numbers: NDArray[np.int64], values: NDArray[np.float64]) -> tuple[Array, Array]:
        """What a sample needs, and m/s²; an accelerometer that is not there for each sample is left out."""
        needed = len(self._chosen.needed)
        with np.errstate(over="ignore"):
            values, accel = values[:, :needed], values[:, needed:] * self._chosen.accel_ms2
        bad = ~(np.abs(accel) <= LARGEST_DPS).all(axis=1) & ~np.isnan(values).any(axis=1)
        if self._has_accel and bad.any():
            self._has_accel = False
            self._spool.drop("accel")
            names = listed(self._chosen.read[needed:])
            text = (
                f"{self._place(int(numbers[int(np.argmax(bad))]))}: {names}: no acceleration stands here, so "
                "the accelerometer is left out."
            )
            self.notes.append(Note("missing_numbers", text))
        return values, accel

    def _add_times(self, numbers: NDArray[np.int64], times: NDArray[np.float64]) -> None:
        if self._first_time is None:
            self._first_time, before = float(times[0]), [-np.inf]
        else:
            before = [self._last_time]
        times = times - self._first_time
        steps = np.diff(times, prepend=before)
        if self._rate_hz is None and (steps <= 0).any():
            place = self._place(int(numbers[int(np.argmax(steps <= 0))]))
            name = self._chosen.time_name
            raise UsageError(f"{place}: column '{name}': the time does not increase.")
        self._last_time = float(times[-1])
        self._spool.append("time", times)

    def stored(self) -> Stored:
        """All of it, as a recording."""
        path, chosen, spool, notes = self._path, self._chosen, self._spool, self.notes
        n = spool.length("gyro")
        if not self._rows:
            raise UsageError(f"{path}: has a header but no rows.")
        if not n:
            empty = [name for name, some in zip(chosen.read, self._some, strict=False) if not some]
            where = f"column {listed(empty)} is empty" if empty else "no row has numbers in all columns"
            raise UsageError(f"{self._place(self._first_missing)}: {where} ({listed(chosen.read)} are read).")
        if self._missing:
            text = (
                f"{self._place(self._first_missing)}: the first of {self._missing} rows (of {self._rows}) "
                "with an empty field, NaN or the like: their samples count as lost."
            )
            notes.append(Note("missing_numbers", text))
        step, scale = None, 1.0
        if self._rate_hz is None:
            rate_hz, scale = rate_of(path, chosen.time_name, chosen.time_unit, spool, self._last_time)
        else:
            rate_hz = self._rate_hz
            check_span(path, rate_hz, n, (n - 1) / rate_hz)
            if chosen.time is not None:
                name, unit = chosen.time_name, chosen.time_unit
                step, told = told_by_times(path, name, unit, spool, rate_hz)
                notes += [Note("row_times", told)] if told else []
                spool.drop("time" if step is None else "row")
        make = partial(_blocks, spool, rate_hz, chosen.lsb, step, scale)
        return Stored(n, rate_hz, chosen.lsb, None, make, tuple(notes))


def _blocks(
    spool: Spool, rate_hz: float, lsb: float | None, step: float | None, scale: float
) -> Iterator[Recording]:
    """Blocks of samples, numbered by their rows, by steps of their times, or by whoever reads their times."""
    number, last = -1, None
    columns = ["gyro", "row" if "row" in spool else "time", *(["accel"] if "accel" in spool else [])]
    for gyro, told, *accel in spool.blocks(columns, AT_ONCE):
        accel_ms2 = accel[0] if accel else None
        if "row" in spool:
            if last is None:
                last = int(told[0])
            seq = told - last
        elif step is not None:
            before = told[0] - step if last is None else last
            seq = number + np.cumsum(
                np.maximum(1, np.rint(np.diff(told, prepend=before) / step)).astype(np.int64)
            )
            number, last = int(seq[-1]), told[-1]
        else:
            yield Recording(gyro, rate_hz, told * scale, lsb, accel_ms2=accel_ms2)
            continue
        yield Recording(gyro, rate_hz, seq / rate_hz, lsb, seq=seq, accel_ms2=accel_ms2)
