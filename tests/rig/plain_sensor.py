"""Estimate the axes of one sensor in plain Python, one sample at a time, as an oracle.

The filters of each axis and their supervisors are in `sample_by_sample`. The steps before and after these
estimates are in `plain_device_stream`.
"""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from fltea.estimator.engine import CAUSES
from fltea.estimator.lane_settings import LaneSettings
from fltea.estimator.lanes import Reason
from fltea.records.estimate import AxisEstimate, FlteaEstimate
from fltea.records.fit import Interval
from fltea.records.records import EstimatorInfo
from fltea.records.stats import AxisStats
from fltea.settings.estimator import EstimatorConfig

from tests.rig.sample_by_sample import LanesBySample, whiteness

LONGEST_BRIDGE = 30_000
"""Filters that continue from a snapshot predict over the samples that are missing since then. Filters with
unlimited memory predict over at most this many.
"""

COLUMNS = ("alpha", "alpha_std", "f", "f_std", "state", "innovation")
"""Fields of an estimate, in the order of the filters' output columns."""

Vector = tuple[float, ...]
Loss = tuple[str, Reason]
"""An axis that has become invalid, and the reason."""


class Baseline(NamedTuple):
    """Bias of each axis, and variance R of its white noise.

    Axes that never changed have no R and no estimate, and are listed.
    """

    bias: Vector
    R: Vector
    constant: tuple[bool, ...]


def baseline_of(window: list[Vector], axes: int, config: EstimatorConfig, resolution: float) -> Baseline:
    """Return bias and R from the settings, or else from the samples of the start-up window, summed in the
    order of the native code.
    """
    means, variances = [0.0] * axes, [0.0] * axes
    for axis, values in enumerate(zip(*window, strict=True)):
        n, total, squares = len(values), 0.0, 0.0
        for value in values:
            distance = value - values[0]
            total, squares = total + distance, squares + distance * distance
        spread = n * squares - total * total
        means[axis] = values[0] + total / n
        variances[axis] = max(spread / (n * (n - 1)), resolution**2 / 12) if spread else 0.0
    bias = tuple(means) if config.bias == "startup" else _each(config.bias, axes)
    if config.R != "auto":
        return Baseline(bias, _each(config.R, axes), (False,) * axes)
    return Baseline(bias, tuple(variances), tuple(not R > 1e-100 for R in variances))


def _each(setting: str | float | list[float], axes: int) -> Vector:
    """Return the value of a setting for each axis.

    The setting is a text such as "none" (0 for all axes), one number for all axes, or a list with a number
    for each axis.
    """
    values = [0.0] if isinstance(setting, str) else setting if isinstance(setting, list) else [setting]
    return tuple(map(float, values if len(values) > 1 else values * axes))


# Why more than 12 attributes: it mirrors the native sensor, so that the two can be read side by side.
class Sensor:
    """Estimates the axes of one sensor from the beginning of an epoch: a start-up window, then the filters.

    `axes`: names of the axes with their columns in the samples. `resolution`: size of one count, 0 if
    unknown.
    """

    def __init__(
        self, axes: dict[str, int], unit: str, config: EstimatorConfig, rate_hz: float, resolution: float
    ) -> None:
        self.axes, self.unit, self.config = axes, unit, config.at(rate_hz)
        self._names = tuple(axes)
        self.rate_hz, self._resolution = rate_hz, resolution
        self.startup_remaining = self.config.startup_needed
        self._window: list[Vector] = []
        self.baseline: Baseline | None = None
        self._innovations: dict[str, list[tuple[float, float] | None]] = {axis: [] for axis in axes}
        self._white, self._there = dict.fromkeys(axes, False), dict.fromkeys(axes, 0)
        self._waits_for_a_fit = self.config.tuned_by == "live"
        if not self.startup_remaining:
            self._begin()

    @property
    def constant_axes(self) -> list[str]:
        """Return the axes that did not change over the start-up window."""
        constant = self.baseline.constant if self.baseline else ()
        return [axis for axis, still in zip(self.axes, constant, strict=False) if still]

    def _begin(self) -> None:
        self.baseline = found = baseline_of(self._window, len(self.axes), self.config, self._resolution)
        self._live = [k for k, still in enumerate(found.constant) if not still]
        settings = LaneSettings(self.config, 1 / self.rate_hz, [found.R[k] for k in self._live])
        self._lanes = LanesBySample(len(self._live), settings) if self._live else None

    def take(self, sample: Vector) -> tuple[dict[str, AxisEstimate], list[Loss]]:
        """Process one sample; return the estimates, and the axes that have become invalid, with the reasons.

        There are no estimates while the start-up window fills.
        """
        own = tuple(sample[column] for column in self.axes.values())
        if self.baseline is None:
            self._window.append(own)
            self.startup_remaining -= 1
            if not self.startup_remaining:
                self._begin()
            return {}, []
        said: dict[str, AxisEstimate] = {}
        lost: list[Loss] = []
        columns: dict[str, Vector] = {}
        if self._lanes is not None:
            row = self._lanes.step([own[k] - self.baseline.bias[k] for k in self._live])
            for lane, k in enumerate(self._live):
                if row.valid[lane]:
                    columns[self._names[k]] = tuple(row.columns[:, lane].tolist())
            lost = [(self._names[self._live[lane]], why) for lane, why in row.lost.items()]
        for axis in self._names:
            said[axis] = _axis_estimate(self._of_filters(axis, columns.get(axis)), self.unit)
        return said, lost

    def _of_filters(self, axis: str, columns: Vector | None) -> FlteaEstimate:
        """Return the filters' estimate of one axis.

        Whether the innovations are white is tested after every 100 valid estimates. The field `settled` is
        true if they passed the last test. It is always false for filters that a live fit has to tune.
        """
        rows = self._innovations[axis]
        rows.append((columns[5], columns[6]) if columns else None)
        self._there[axis] += columns is not None
        if columns and self._there[axis] % 100 == 0:
            self._white[axis] = whiteness(rows).is_white is True
        accepted = self._white[axis] and not self._waits_for_a_fit
        if columns is None:
            return FlteaEstimate(settled=accepted)
        numbers = (one if math.isfinite(one) else None for one in columns[:6])
        return FlteaEstimate(**dict(zip(COLUMNS, numbers, strict=True)), valid=True, settled=accepted)

    def miss(self, count: int) -> list[Loss]:
        """Let the filters predict over lost samples; return the axes that became invalid meanwhile.

        The start-up window ignores lost samples.
        """
        if self.baseline is None or not count:
            return []
        for rows in self._innovations.values():
            rows.append(None)
        lost: list[Loss] = []
        for _ in range(count if self._lanes is not None else 0):
            assert self._lanes is not None
            row = self._lanes.step(np.zeros(len(self._live)), missing=True)
            lost += [(self._names[self._live[lane]], why) for lane, why in row.lost.items()]
        return lost

    def bridge(self, count: int) -> None:
        """Let the filters predict over the samples that are missing since a snapshot.

        The filters predict over at most as many samples as their memory holds.
        """
        self.miss(min(count, self.config.window_samples or LONGEST_BRIDGE))

    def stats(self) -> Iterator[tuple[str, AxisStats]]:
        """Yield the statistics of each axis."""
        if self.baseline is None:
            yield from ((axis, AxisStats(None, None, 0, {}, unit=self.unit)) for axis in self.axes)
            return
        for k, (axis, rows) in enumerate(self._innovations.items()):
            alive = k in self._live
            restarts, causes = 0, dict[str, int]()
            if alive and self._lanes is not None:
                lane = self._live.index(k)
                restarts = self._lanes.restarts[lane]
                counts = self._lanes.engine.interventions()[lane].tolist()
                causes = {cause: n for cause, n in zip(CAUSES, counts, strict=True) if n}
            lag1, nis, is_white = whiteness(rows)
            yield (
                axis,
                AxisStats(
                    self.baseline.bias[k],
                    self.baseline.R[k] if alive else None,
                    restarts,
                    causes,
                    lag1,
                    nis,
                    self.unit,
                    self.config.state.Q if alive else None,
                    describes_noise=False if is_white is False else None,
                ),
            )

    def info(self) -> EstimatorInfo:
        """Return the settings with which the axes are estimated."""
        c = self.config
        bias, R = (
            () if one in ("startup", "auto") else _each(one, len(one) if isinstance(one, list) else 1)
            for one in (c.bias, c.R)
        )
        length, needed = c.window_samples, c.startup_needed
        return EstimatorInfo(c.variant, c.estimate_on, c.memory, c.guard, length, needed, bias, R, c.tuned_by)


def _axis_estimate(found: FlteaEstimate, unit: str) -> AxisEstimate:
    """Return the filters' estimate of an axis as an `AxisEstimate`.

    The fields of the live fit and of the tracker stay empty.
    """
    tracked = None, None, None, None, None, False
    return AxisEstimate(None, Interval(), Interval(), *tracked, None, None, unit, found)
