"""What white noise would give: the same estimator on many runs of noise that has no order.

No α means anything by itself (host/README.md, What α and f are worth). The runs go through all that the data
go through: start-up window, bias, R, quantisation, settings. Their quantiles, after as many samples as the
data had so far, are what an estimate has to leave before it says anything.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fltea.estimator.baseline import lane_moments
from fltea.estimator.lane_settings import lane_settings
from fltea.estimator.lanes import Lanes
from fltea.records.records import WHITE_QUANTILES
from fltea.settings.config import EstimatorConfig

Array = NDArray[np.float64]

RUNS = 64
"""The edges of the band are then uncertain by 0.008 in α after 3,000 samples, where the band is 0.12 wide;
128 runs, at twice the cost, have 0.006."""

SLAB = 1024
"""Samples of all runs at a time."""

COARSEST = 0.5
"""Quantised only where the noise has a standard deviation of at least this many LSB: below, what a quantiser
gives depends on where between two counts the offset lies."""


class Quantiles(NamedTuple):
    """5, 50 and 95 % of the runs, each (3,); NaN if none of them has an estimate."""

    alpha: Array
    f: Array


class WhiteBand:
    """White Gaussian noise as strong as one axis, in `runs` runs, estimated with the settings of the data.

    h: sampling period in s. power: variance of the axis in its unit squared, > 0. resolution: one LSB, None
    if unknown. R: measurement variance, None to draw it from the start-up window as the data do. Memory is
    compressed whatever `config.engine` says (exact memory differs far less than two runs do), so "reference"
    has a band too. A run that is lost begins again and is left out while it is not valid, as an axis is.
    """

    def __init__(
        self,
        config: EstimatorConfig,
        h: float,
        power: float,
        resolution: float | None,
        R: float | None = None,
        *,
        runs: int = RUNS,
        seed: int = 0,
    ) -> None:
        lsb = 0.0 if resolution is None else resolution
        self._lsb = lsb if math.sqrt(power) >= COARSEST * lsb else 0.0
        self._std = math.sqrt(power - self._lsb**2 / 12)  # quantisation adds LSB²/12, part of the power
        self._rng = np.random.default_rng(seed)
        self._runs = runs
        self._bias = np.zeros(runs)
        variances = np.full(runs, R or power)
        if config.startup_needed:
            mean, drawn = lane_moments(self._noise(config.startup), resolution)
            if config.bias == "startup":
                self._bias = mean
            if R is None:
                variances = drawn
        settings = lane_settings(config, h, variances.tolist())
        self._lanes = Lanes(runs, replace(settings, memory="compressed"))

    def advance(self, count: int) -> Quantiles:
        """Let every run take `count` more samples, at least one; return where they stand then."""
        while count:
            rows = min(count, SLAB)
            after = self._lanes.run(self._noise(rows) - self._bias)
            count -= rows
        valid = after.valid[-1]
        return Quantiles(_quantiles(after.alpha[-1, valid]), _quantiles(after.f[-1, valid]))

    def _noise(self, count: int) -> Array:
        """Samples as a sensor at rest without offset gives them, (count, runs)."""
        y = self._rng.standard_normal((count, self._runs)) * self._std
        return np.rint(y / self._lsb) * self._lsb if self._lsb else y


def _quantiles(values: Array) -> Array:
    """At Weibull's positions: one more run of the same kind falls between two of them with their share."""
    if not values.size:
        return np.full(len(WHITE_QUANTILES), np.nan)
    places = np.array(WHITE_QUANTILES) * (values.size + 1) - 1
    result: Array = np.interp(places, np.arange(values.size), np.sort(values))
    return result
