"""What white noise of the same power would give, in step with one axis of a device.

`WhiteRuns` is the band of an axis after each `STEP`-th of its estimates; `StartPower` measures the power that
it is given; `AxisBand` is both. None of them knows where samples come from or who looks.
"""

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fltea.estimator.white_band import Quantiles, WhiteBand
from fltea.records.block import Bools
from fltea.records.records import WhiteBandStats
from fltea.settings.config import EstimatorConfig

Array = NDArray[np.float64]

STEP = 25
"""Samples that the runs are moved on by at a time: often enough for a smooth band, at half the cost of 10."""

NOTHING = Quantiles(np.full(3, np.nan), np.full(3, np.nan))


class Sensor(NamedTuple):
    """What an axis belongs to. h: sampling period in s; resolution: one LSB, None where unknown."""

    config: EstimatorConfig
    h: float
    resolution: float | None


class WhiteRuns:
    """The runs of one axis: `quantiles` after `samples` samples, NaN before the first `STEP` of them.

    R: measurement variance as given in the settings for this axis, None where it is drawn from the start-up
    window. seed: another one for each axis.
    """

    def __init__(self, sensor: Sensor, R: float | None, seed: int) -> None:
        self._sensor, self._R, self._seed = sensor, R, seed
        self.begin()

    def begin(self) -> None:
        """Begin again, as the axis does: with a start-up window of their own."""
        self._band: WhiteBand | None = None
        self._waiting = self.samples = 0
        self.quantiles = NOTHING

    def advance(self, samples: int, power: float | None) -> None:
        """Follow an axis that has had so many more estimates.

        power: variance of the axis in its unit squared; while it is None, 0 or not finite the samples wait.
        """
        self._waiting += samples
        due = self._waiting // STEP * STEP
        if not due or not power or not math.isfinite(power):
            return
        if self._band is None:
            h, resolution = self._sensor.h, self._sensor.resolution
            self._band = WhiteBand(self._sensor.config, h, power, resolution, self._R, seed=self._seed)
        self.quantiles = self._band.advance(due)
        self._waiting -= due
        self.samples += due


class StartPower:
    """Variance of the first `startup` samples of an epoch.

    They are looked at also where R was given or is an older one, which is not believed.
    """

    def __init__(self, startup: int) -> None:
        self._startup = startup
        self._count = 0
        self._mean = 0.0
        self._squares = 0.0

    @property
    def power(self) -> float | None:
        """Variance of these samples; None while there are too few."""
        return None if self._count < self._startup else self._squares / (self._count - 1)

    def add(self, y: Array) -> int:
        """Take samples (n,), offset included; return how many of them came after the first `startup`."""
        used = min(self._startup - self._count, len(y))
        for value in y[:used].tolist():
            self._count += 1
            step = value - self._mean
            self._mean += step / self._count
            self._squares += step * (value - self._mean)
        return len(y) - used


class AxisBand:
    """Takes samples and estimates of one axis of an epoch; `stats` is what white noise would give now.

    An axis that begins again has its runs begin again with it. Samples that were lost are left out of the
    runs, as the filters of α and f leave them out. R, seed: as of `WhiteRuns`.
    """

    def __init__(self, sensor: Sensor, R: float | None, seed: int) -> None:
        self._start = StartPower(sensor.config.startup)
        self._runs = WhiteRuns(sensor, R, seed)
        self._valid = True

    def on_samples(self, y: Array) -> int:
        """Take samples (n,), offset included; return how many came after the start-up window."""
        return self._start.add(y)

    def on_estimates(self, valid: Bools) -> None:
        """Take the estimates after these samples: whether each is valid, (n,)."""
        changes = (np.flatnonzero(valid[1:] != valid[:-1]) + 1).tolist()
        ends = [*changes, len(valid)] if len(valid) else []
        for begin, end in pairwise([0, *ends]):
            self.on_count(end - begin, valid=bool(valid[begin]))

    def on_count(self, samples: int, *, valid: bool) -> None:
        """Take the estimates after so many samples, all valid or none."""
        if valid:
            if not self._valid:
                self._runs.begin()
            self._runs.advance(samples, self._start.power)
        self._valid = valid

    def stats(self) -> WhiteBandStats | None:
        """What white noise would give now; None where that is not known."""
        alpha, f = self._runs.quantiles
        power = self._start.power
        if power is None or not (np.isfinite(alpha).all() and np.isfinite(f).all()):
            return None
        return WhiteBandStats(tuple(alpha.tolist()), tuple(f.tolist()), power, self._runs.samples)
