"""Keeps the runs of white noise in step with one axis of a device."""

import math
from typing import NamedTuple

import numpy as np

from fltea.estimator.white_band import Quantiles, WhiteBand
from fltea.settings.config import EstimatorConfig

STEP = 25
"""Samples that the runs are moved on by at a time: often enough for a smooth band, at half the cost of 10."""

NOTHING = Quantiles(np.full(3, np.nan), np.full(3, np.nan))


class Sensor(NamedTuple):
    """What an axis belongs to. h: sampling period in s; resolution: one LSB, None where unknown."""

    config: EstimatorConfig
    h: float
    resolution: float | None


class WhiteFollower:
    """Takes samples and estimates of one axis of an epoch; `quantiles` are what white noise would give now.

    The power is the variance of the epoch's first `startup` samples, also where R was given or is an older
    one: they are looked at, not believed. An axis that begins anew has its runs begin anew with it. Samples
    that were lost are left out of the runs, as the filters of α and f leave them out.
    R: as given in the settings for this axis, None where it is drawn from the start-up window.
    """

    def __init__(self, sensor: Sensor, R: float | None, seed: int) -> None:
        self.quantiles = NOTHING
        self.mean = 0.0
        self._sensor = sensor
        self._R = R
        self._seed = seed
        self._count = 0
        self._squares = 0.0
        self._runs: WhiteBand | None = None
        self._waiting = 0
        self._valid = False

    @property
    def power(self) -> float | None:
        """Variance of the first samples; None while there are too few."""
        if self._count < self._sensor.config.startup:
            return None
        return self._squares / (self._count - 1)

    def on_sample(self, y: float) -> None:
        """Take a sample, offset included."""
        if self._count >= self._sensor.config.startup:
            return
        self._count += 1
        step = y - self.mean
        self.mean += step / self._count
        self._squares += step * (y - self.mean)

    def on_estimate(self, valid: bool, steps: int = 1) -> None:
        """Take note of an estimate, `steps` samples after the one before; the runs follow a few at a time."""
        if valid and not self._valid:
            self._runs, self._waiting, self.quantiles = None, 0, NOTHING
        self._valid = valid
        self._waiting += steps * valid
        power = self.power
        if not power or not math.isfinite(power):
            return
        if self._runs is None:
            h, resolution = self._sensor.h, self._sensor.resolution
            self._runs = WhiteBand(self._sensor.config, h, power, resolution, self._R, seed=self._seed)
        while self._waiting >= STEP:
            self._waiting -= STEP
            self.quantiles = self._runs.advance(STEP)
