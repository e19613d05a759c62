"""Blocks: consecutive samples of one device and their estimates, passed from the pipeline to the outputs.

Each row of a block is a sample. An output makes records only of those rows that it writes.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain, starmap
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from fltea.records.arrays import Array
from fltea.records.estimate import AxisEstimate, FlteaEstimate, Whiteness
from fltea.records.events import Ints
from fltea.records.fit import Interval, VerdictKind
from fltea.records.records import AXES, GYRO_UNIT, Corrected, CorrectedAxis, Estimate, Sample

Bools = NDArray[np.bool_]
T = TypeVar("T")


class Values:
    """Chooses some rows of a block, and converts columns in these rows to flat lists of Python values."""

    def __init__(self, chosen: slice = slice(None)) -> None:
        self._chosen = chosen

    def of(self, column: NDArray[Any]) -> Sequence[Any]:
        """Return the numbers or flags of a column in the chosen rows as a flat list."""
        values: list[Any] = column[self._chosen].ravel().tolist()
        return values

    def nullable(self, column: Array) -> Sequence[float | None]:
        """Return the numbers of a column in the chosen rows, with None in place of NaN and infinity."""
        values = self.of(column)
        if math.isfinite(sum(values)):
            return values
        return [value if math.isfinite(value) else None for value in values]


ALL = Values()


class AxisColumns(NamedTuple):
    """Estimates of one sensor's axes after each of n samples. Arrays have shape (n, axes); NaN means unknown.

    `null_p`, `whiteness`: results of the newest fit, one for each axis.
    `state`, `innovation`: in `unit`.
    `settled`: whether the innovations are white and, if the live fit is to set the variances of the filters,
    whether it has done so.
    """

    axes: tuple[str, ...]
    unit: str
    null_p: tuple[float | None, ...]
    whiteness: tuple[Whiteness | None, ...]
    alpha: Array
    alpha_std: Array
    f: Array
    f_std: Array
    state: Array
    innovation: Array
    valid: Bools
    settled: Bools

    def rows(self, begin: int, end: int) -> "AxisColumns":
        """Return the rows from `begin` to before `end`."""
        return AxisColumns._make((*self[:4], *(column[begin:end] for column in self[4:])))

    def of_rows(
        self, values: Values, tracked: "TrackedColumns | None" = None
    ) -> Iterator[dict[str, AxisEstimate]]:
        """Yield a dictionary from axes to estimates for each row that `values` chooses.

        `tracked`: results of the bias trackers of the same axes.
        """
        # Each call converts a column for all axes, since the number of calls determines the time if a block
        # has only one row.
        of_paper = list(map(FlteaEstimate, *map(values.nullable, self[4:10]), *map(values.of, self[10:])))
        rows = len(of_paper) // len(self.axes)
        known = _tracked(tracked, values, rows, len(self.axes))
        of_fit = self.null_p * rows, self.whiteness * rows, (self.unit,) * len(of_paper)
        columns = zip(*known, *of_fit, of_paper, strict=True)
        return _by_axis(self.axes, starmap(AxisEstimate, columns))


class TrackedColumns(NamedTuple):
    """Results of the bias trackers (Kalman filters) of one sensor's axes after each of n samples.

    Arrays have shape (n, axes) and are in `unit`; NaN means unknown.

    `bias`: offset of the sensor plus state of its noise. `verdict`, `alpha`, `f`: results of the newest
    accepted fit, one for each axis.
    """

    axes: tuple[str, ...]
    unit: str
    state: Array
    state_std: Array
    bias: Array
    bias_std: Array
    innovation: Array
    moving: Bools
    verdict: tuple[VerdictKind | None, ...]
    alpha: tuple[Interval, ...]
    f: tuple[Interval, ...]

    def rows(self, begin: int, end: int) -> "TrackedColumns":
        """Return the rows from `begin` to before `end`."""
        return TrackedColumns._make((*self[:2], *(column[begin:end] for column in self[2:8]), *self[8:]))


Tracked = tuple[TrackedColumns, ...]
"""Results of the bias trackers, one `TrackedColumns` for each sensor."""

C = TypeVar("C", AxisColumns, TrackedColumns)


def _in_unit(sensors: Sequence[C], unit: str) -> C | None:
    """Return the columns of the sensor whose samples are in `unit`; None if there is no such sensor."""
    return next((columns for columns in sensors if columns.unit == unit), None)


def _by_axis(axes: tuple[str, ...], values: Iterator[T]) -> Iterator[dict[str, T]]:
    """Yield for each row a dictionary from axes to values. `values`: all values, row after row."""
    return (dict(zip(axes, row, strict=True)) for row in zip(*[values] * len(axes), strict=True))


def _tracked(tracked: TrackedColumns | None, values: Values, rows: int, axes: int) -> list[Sequence[Any]]:
    """Return a list for each field of `AxisEstimate` that comes from a tracker (`verdict` to `moving`).

    Each list holds all axes of the first row, then all axes of the second row, and so on.
    """
    if tracked is None:
        nothing = (None, Interval(), Interval(), *[None] * 5, False)
        return [[one] * (rows * axes) for one in nothing]
    of_fit = [one * rows for one in (tracked.verdict, tracked.alpha, tracked.f)]
    numbers = (tracked.bias, tracked.bias_std, tracked.state, tracked.state_std, tracked.innovation)
    return [*of_fit, *map(values.nullable, numbers), values.of(tracked.moving)]


COLUMNS = ("seq", "device_us", "host_ns", "gyro_dps", "accel_ms2", "temperature_c", "flags")
"""Fields of a block that have one row for each sample."""


# Why more than 12 attributes: each is one column of the samples, or one fact about all samples.
@dataclass(frozen=True)
class Block:
    """n consecutive samples of one epoch; each column has n rows.

    `seq`, `device_us`: sample numbers and device times (n,), which go on rising where the device's counters
    restart at 0.
    `host_ns`: Unix times (n,).
    `gyro_dps`: rates (n, axes).
    `accel_ms2` (n, 3), `temperature_c` (n,), `flags` (n,): each is None if the device does not send it.
    `variant`: variant of the estimator, "triple" or "joint".
    `estimates`: estimates of each sensor with filters; empty while the start-up window fills.
    `every`: records are written only for samples whose number is a multiple of `every`.
    `corrected`: whether records of corrected rates are written too.
    `tracked`: tracker results of each sensor.
    """

    device: str | None
    epoch: int
    seq: Ints
    device_us: Ints
    host_ns: Ints
    gyro_dps: Array
    accel_ms2: Array | None = None
    temperature_c: Array | None = None
    flags: Ints | None = None
    variant: str = ""
    estimates: tuple[AxisColumns, ...] = ()
    every: int = 1
    corrected: bool = False
    tracked: Tracked = ()

    def __len__(self) -> int:
        return len(self.seq)

    @cached_property
    def weight(self) -> int:
        """Number of records that outputs make of the block."""
        return len(self.due_rows) * self.weight_of_row

    @property
    def weight_of_row(self) -> int:
        """Number of records (sample, estimate, corrected rates) for each row in `due_rows`."""
        return 1 + bool(self.estimates) + (self.corrected_dps is not None)

    @property
    def due_rows(self) -> range:
        """Indices of the rows for which records are written."""
        return range(len(self))[self.due(self.every)]

    def but(self, **fields: Any) -> "Block":
        """Return a copy with `fields` changed. `dataclasses.replace` would take ten times as long."""
        other = object.__new__(Block)
        other.__dict__.update(self.__dict__, **fields)
        for cached in ("weight", "corrected_dps"):
            other.__dict__.pop(cached, None)
        return other

    def rows(self, begin: int, end: int) -> "Block":
        """Return a block of the rows from `begin` to before `end`."""
        columns = {name: getattr(self, name) for name in COLUMNS}
        cut = {name: column[begin:end] for name, column in columns.items() if column is not None}
        estimates = tuple(columns.rows(begin, end) for columns in self.estimates)
        tracked = tuple(columns.rows(begin, end) for columns in self.tracked)
        return self.but(**cut, estimates=estimates, tracked=tracked)

    def due(self, every: int) -> slice:
        """Return the rows whose sample number is a multiple of `every`."""
        return slice(-int(self.seq[0]) % every, None, every)

    def estimates_at(self, row: int, unit: str) -> dict[str, AxisEstimate]:
        """Return the estimates of one sensor's axes after one sample. `unit`: unit of this sensor's samples.

        The estimates by the paper's filters are empty as long as only the bias trackers run.
        """
        values = Values(slice(row, row + 1))
        tracked, own = _in_unit(self.tracked, unit), _in_unit(self.estimates, unit)
        if own is not None:
            return next(own.of_rows(values, tracked))
        if tracked is None:
            return {}
        known = zip(*_tracked(tracked, values, 1, len(tracked.axes)), strict=True)
        return {
            axis: AxisEstimate(*(*one, None, None, unit, FlteaEstimate()))
            for axis, one in zip(tracked.axes, known, strict=True)
        }

    def last_estimate(self) -> Estimate | None:
        """Return the record of estimates for the last row in `due_rows`; None if there is none."""
        rows = self.due_rows
        return next(self.estimate_records(Values(slice(rows[-1], rows[-1] + 1))), None) if rows else None

    def records(
        self,
        *,
        samples: bool = True,
        estimates: bool = True,
        corrected: bool = True,
        values: Values | None = None,
    ) -> Iterator[Sample | Estimate | Corrected]:
        """Yield the records of the rows for which records are written, in the order of the samples.

        `values`: chooses the rows. By default, these are the rows in `due_rows`.
        """
        values = values or Values(self.due(self.every))
        kinds: list[Iterator[Sample | Estimate | Corrected]] = []
        if samples:
            kinds.append(self.samples(values))
        if estimates and self.estimates:
            kinds.append(self.estimate_records(values))
        if corrected and self.corrected_dps is not None:
            kinds.append(self.corrected_records(values))
        return chain.from_iterable(zip(*kinds, strict=True))

    @cached_property
    def corrected_dps(self) -> Array | None:
        """Rates minus biases of the axes with a bias tracker; None if corrected rates are not written."""
        if not self.corrected:
            return None
        tracked = _in_unit(self.tracked, GYRO_UNIT)
        if tracked is None:
            return None
        return self.gyro_dps[:, [AXES.index(axis) for axis in tracked.axes]] - tracked.bias

    def corrected_records(self, values: Values) -> Iterator[Corrected]:
        """Yield a record of the gyroscope's rates minus their biases for each of the chosen rows."""
        tracked = _in_unit(self.tracked, GYRO_UNIT)
        assert tracked is not None
        assert self.corrected_dps is not None
        numbers = map(values.nullable, (self.corrected_dps, tracked.bias_std))
        rows = _by_axis(tracked.axes, map(CorrectedAxis, *numbers, values.of(tracked.moving)))
        for seq, device_us, host_ns, axes in zip(*self._numbers_and_times(values), rows, strict=True):
            yield Corrected(seq, self.epoch, device_us, host_ns, axes, device=self.device)

    def samples(self, values: Values = ALL) -> Iterator[Sample]:
        """Yield a record of the sample in each of the chosen rows."""
        numbers_and_times, epoch, device = self._numbers_and_times(values), self.epoch, self.device
        n = len(numbers_and_times[0])
        columns = zip(
            *numbers_and_times,
            _rows(values, self.gyro_dps),
            [None] * n if self.accel_ms2 is None else _rows(values, self.accel_ms2),
            [None] * n if self.temperature_c is None else values.of(self.temperature_c),
            [0] * n if self.flags is None else values.of(self.flags),
            strict=True,
        )
        for seq, *columns_of_one in columns:
            yield Sample(seq, epoch, *columns_of_one, device=device)

    def estimate_records(self, values: Values = ALL) -> Iterator[Estimate]:
        """Yield a record of estimates for each of the chosen rows.

        While the start-up window fills, yield nothing.
        """
        if not self.estimates:
            return
        epoch, variant, device = self.epoch, self.variant, self.device
        tracked = {columns.unit: columns for columns in self.tracked}
        first, *others = (own.of_rows(values, tracked.get(own.unit)) for own in self.estimates)
        by_axis = first if not others else (a | b for a, b in zip(first, *others, strict=True))
        for seq, device_us, host_ns, axes in zip(*self._numbers_and_times(values), by_axis, strict=True):
            yield Estimate(seq, epoch, device_us, host_ns, variant, axes, device=device)

    def _numbers_and_times(self, values: Values) -> list[Sequence[int]]:
        """Return the sample numbers, device times and host times of the chosen rows."""
        return [values.of(column) for column in (self.seq, self.device_us, self.host_ns)]


def _rows(values: Values, column: Array) -> Iterator[tuple[float, ...]]:
    """Yield the chosen rows of a column as tuples."""
    return zip(*[iter(values.of(column))] * column.shape[1], strict=True)
