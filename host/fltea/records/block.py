"""What walks from the pipeline to the outputs: samples of one device without a gap, and their estimates.

An output makes records of a block only as far as it prints them.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import starmap
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fltea.records.events import Ints
from fltea.records.fit import Interval, VerdictKind
from fltea.records.records import (
    AXES,
    GYRO_UNIT,
    AxisEstimate,
    Corrected,
    CorrectedAxis,
    Estimate,
    FlteaEstimate,
    Sample,
)

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]


class AxisColumns(NamedTuple):
    """Estimates of the axes of one sensor after n samples, all (n, axes); NaN where there is no number.

    state, innovation: in `unit`. null_p: of the newest fit, NaN while there is none; white_rejected: what it
    says then. settled: the innovations are white, and if the fit is to tune it has.
    """

    axes: tuple[str, ...]
    unit: str
    alpha: Array
    alpha_std: Array
    f: Array
    f_std: Array
    state: Array
    innovation: Array
    valid: Bools
    null_p: Array
    white_rejected: Bools
    settled: Bools

    def rows(self, begin: int, end: int) -> "AxisColumns":
        """Return the block of some of its rows."""
        return AxisColumns._make((self.axes, self.unit, *(column[begin:end] for column in self[2:])))

    def of_rows(
        self, chosen: slice, tracked: "TrackedColumns | None" = None
    ) -> Iterator[dict[str, AxisEstimate]]:
        """Return the estimates after each of the chosen samples, by axis; tracked: of the same axes."""
        # All axes of a column at once: of a block of one row most of the cost is that of the calls.
        numbers = [_nullable(column[chosen]) for column in self[2:8]]
        flags = [column[chosen].ravel().tolist() for column in (self.valid, self.settled)]
        p = _nullable(self.null_p[chosen])
        rejected: list[bool] = self.white_rejected[chosen].ravel().tolist()
        whiteness = [None if q is None else _WORDS[bad] for q, bad in zip(p, rejected, strict=True)]
        of_paper = list(map(FlteaEstimate, *numbers, *flags))
        known = _tracked(tracked, chosen, len(of_paper), len(self.axes))
        columns = zip(*known, p, whiteness, [self.unit] * len(p), of_paper, strict=True)
        rows = starmap(AxisEstimate, columns)
        return (dict(zip(self.axes, row, strict=True)) for row in zip(*[rows] * len(self.axes), strict=True))


class TrackedColumns(NamedTuple):
    """What the biases of one sensor's axes are after n samples, (n, axes), in `unit`; NaN: not known yet.

    bias: offset and state. verdict, alpha, f: of the newest fit that stands, one an axis.
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
        """Return the block of some of its rows."""
        return TrackedColumns._make((*self[:2], *(column[begin:end] for column in self[2:8]), *self[8:]))


def _tracked(tracked: TrackedColumns | None, chosen: slice, size: int, axes: int) -> list[Sequence[Any]]:
    """Return the columns verdict to moving of `AxisEstimate`, all axes of a row after one another."""
    if tracked is None:
        nothing = (None, Interval(), Interval(), *[None] * 5, False)
        return [[one] * size for one in nothing]
    rows = size // axes
    of_fit = [list(one) * rows for one in (tracked.verdict, tracked.alpha, tracked.f)]
    numbers = (tracked.bias, tracked.bias_std, tracked.state, tracked.state_std, tracked.innovation)
    flags = tracked.moving[chosen].ravel().tolist()
    return [*of_fit, *(_nullable(column[chosen]) for column in numbers), flags]


_WORDS = {False: "not rejected", True: "rejected"}


def _nullable(column: Array) -> Sequence[float | None]:
    """Return all numbers of columns, row after row, None for those that are not finite."""
    values: list[float] = column.ravel().tolist()
    if math.isfinite(sum(values)):
        return values
    return [value if math.isfinite(value) else None for value in values]


COLUMNS = ("seq", "device_us", "host_ns", "gyro_dps", "accel_ms2", "temperature_c", "flags")
"""Fields of a block that have a row a sample."""


@dataclass(frozen=True)
class Block:
    """n samples, rows of all columns, of one epoch.

    seq, device_us: unwrapped; host_ns: Unix time. gyro_dps (n, axes); accel_ms2 (n, 3), temperature_c (n,)
    and flags (n,) are None where there are none. estimates: of each sensor that has any; empty while the
    start-up window fills. tracked: the biases of each sensor. variant: that of the estimates. every: there
    are records of samples whose number is a multiple of it. corrected: there are records of corrected rates.
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
    tracked: tuple[TrackedColumns, ...] = ()

    def __len__(self) -> int:
        return len(self.seq)

    @cached_property
    def weight(self) -> int:
        """The number of records that it stands for."""
        return len(self.due_rows) * (1 + bool(self.estimates) + self._has_corrected)

    @property
    def due_rows(self) -> range:
        """The rows of which there are records."""
        return range(len(self))[self.due(self.every)]

    def rows(self, begin: int, end: int) -> "Block":
        """Return the block of some of its rows."""
        columns = {name: getattr(self, name) for name in COLUMNS}
        cut = {name: column[begin:end] for name, column in columns.items() if column is not None}
        estimates = tuple(one.rows(begin, end) for one in self.estimates)
        tracked = tuple(one.rows(begin, end) for one in self.tracked)
        return replace(self, **cut, estimates=estimates, tracked=tracked)

    def due(self, every: int) -> slice:
        """Return the rows whose number is a multiple of `every`.

        The numbers of a block follow one another.
        """
        return slice(-int(self.seq[0]) % every, None, every)

    def estimates_at(self, row: int, unit: str) -> dict[str, AxisEstimate]:
        """Return what is known of the axes in this unit after one sample, with or without the filters."""
        chosen = slice(row, row + 1)
        tracked = next((one for one in self.tracked if one.unit == unit), None)
        own = next((one for one in self.estimates if one.unit == unit), None)
        if own is not None:
            return next(own.of_rows(chosen, tracked))
        if tracked is None:
            return {}
        known = zip(*_tracked(tracked, chosen, len(tracked.axes), len(tracked.axes)), strict=True)
        return {
            axis: AxisEstimate(*(*one, None, None, unit, FlteaEstimate()))
            for axis, one in zip(tracked.axes, known, strict=True)
        }

    def last_estimate(self) -> Estimate | None:
        """Return the newest of which there is a record; None where there is none."""
        rows = self.due_rows
        return next(self.estimate_records(slice(rows[-1], rows[-1] + 1)), None) if rows else None

    def records(
        self, *, samples: bool = True, estimates: bool = True, corrected: bool = True
    ) -> Iterator[Sample | Estimate | Corrected]:
        """Yield the records of the rows that are due, in the order of the samples."""
        chosen = self.due(self.every)
        kinds: list[Iterator[Sample | Estimate | Corrected]] = []
        if samples:
            kinds.append(self.samples(chosen))
        if estimates and self.estimates:
            kinds.append(self.estimate_records(chosen))
        if corrected and self._has_corrected:
            kinds.append(self.corrected_records(chosen))
        if len(kinds) == 1:
            yield from kinds[0]
        else:
            for found in zip(*kinds, strict=True):
                yield from found

    @property
    def _has_corrected(self) -> bool:
        return self.corrected and any(one.unit == GYRO_UNIT for one in self.tracked)

    def corrected_records(self, chosen: slice = slice(None)) -> Iterator[Corrected]:
        """Yield a record for each of the chosen rows: the gyroscope's rates less their biases."""
        tracked = next(one for one in self.tracked if one.unit == GYRO_UNIT)
        places = [AXES.index(axis) for axis in tracked.axes]
        rates = _nullable(self.gyro_dps[chosen][:, places] - tracked.bias[chosen])
        found = map(
            CorrectedAxis, rates, _nullable(tracked.bias_std[chosen]), tracked.moving[chosen].ravel().tolist()
        )
        rows = zip(*[found] * len(places), strict=True)
        for seq, device_us, host_ns, row in zip(*self._places(chosen), rows, strict=True):
            axes = dict(zip(tracked.axes, row, strict=True))
            yield Corrected(seq, self.epoch, device_us, host_ns, axes, device=self.device)

    def samples(self, chosen: slice = slice(None)) -> Iterator[Sample]:
        """Yield a record for each of the chosen rows."""
        n, epoch, device = len(self.seq[chosen]), self.epoch, self.device
        columns = zip(
            *self._places(chosen),
            map(tuple, self.gyro_dps[chosen].tolist()),
            [None] * n if self.accel_ms2 is None else map(tuple, self.accel_ms2[chosen].tolist()),
            [None] * n if self.temperature_c is None else self.temperature_c[chosen].tolist(),
            [0] * n if self.flags is None else self.flags[chosen].tolist(),
            strict=True,
        )
        for seq, device_us, host_ns, gyro, accel, temperature, flags in columns:
            yield Sample(seq, epoch, device_us, host_ns, gyro, accel, temperature, flags, device=device)

    def estimate_records(self, chosen: slice = slice(None)) -> Iterator[Estimate]:
        """Yield a record for each of the chosen rows; none while the start-up window fills."""
        if not self.estimates:
            return
        epoch, variant, device = self.epoch, self.variant, self.device
        tracked = {one.unit: one for one in self.tracked}
        first, *others = (one.of_rows(chosen, tracked.get(one.unit)) for one in self.estimates)
        axes = first if not others else (a | b for a, b in zip(first, *others, strict=True))
        for seq, device_us, host_ns, found in zip(*self._places(chosen), axes, strict=True):
            yield Estimate(seq, epoch, device_us, host_ns, variant, found, device=device)

    def _places(self, chosen: slice) -> list[list[int]]:
        """Numbers and times of the chosen rows."""
        return [column[chosen].tolist() for column in (self.seq, self.device_us, self.host_ns)]
