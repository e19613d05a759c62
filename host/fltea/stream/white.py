"""What white noise of the same power would give, in step with the axes of a device.

`WhiteRuns` is the band of one axis at the counts of samples at which it is looked at; `StartPower` measures
the power that it is given; `WhiteFollower` is both, fed sample by sample. None of them knows where samples
come from or who looks.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fltea.estimator.white_band import Quantiles, WhiteBand
from fltea.records.records import AXES, Hello
from fltea.settings.config import EstimatorConfig
from fltea.wire.sample_scaling import accel_resolution_ms2, resolution_dps

STEP = 25
"""Samples that the runs are moved on by at a time: often enough for a smooth band, at half the cost of 10."""

NOTHING = Quantiles(np.full(3, np.nan), np.full(3, np.nan))


class Sensor(NamedTuple):
    """What an axis belongs to. h: sampling period in s; resolution: one LSB, None where unknown."""

    config: EstimatorConfig
    h: float
    resolution: float | None


class At(NamedTuple):
    """What white noise gives after the first `samples` of those that were told of last."""

    samples: int
    quantiles: Quantiles


class WhiteRuns:
    """The runs of one axis; `quantiles` are where they stand, NaN before the first `STEP` samples.

    R: measurement variance as given in the settings for this axis, None where it is drawn from the start-up
    window. seed: another one for each axis.
    """

    def __init__(self, sensor: Sensor, R: float | None, seed: int) -> None:
        self.quantiles = NOTHING
        self._sensor, self._R, self._seed = sensor, R, seed
        self._band: WhiteBand | None = None
        self._waiting = 0

    def begin(self) -> None:
        """Begin anew, as the axis does: with a start-up window of their own."""
        self._band, self._waiting, self.quantiles = None, 0, NOTHING

    def advance(self, samples: int, power: float | None) -> list[At]:
        """Follow an axis that has had so many more valid estimates; the band at every `STEP`-th of them.

        power: variance of the axis in its unit squared; while it is None, 0 or not finite the samples wait,
        and what was due before these samples is returned with 0 samples.
        """
        waited, self._waiting = self._waiting, self._waiting + samples
        if not power or not math.isfinite(power):
            return []
        if self._band is None:
            h, resolution = self._sensor.h, self._sensor.resolution
            self._band = WhiteBand(self._sensor.config, h, power, resolution, self._R, seed=self._seed)
        found = []
        total = self._waiting
        while self._waiting >= STEP:
            self._waiting -= STEP
            self.quantiles = self._band.advance(STEP)
            found.append(At(max(0, total - self._waiting - waited), self.quantiles))
        return found


class StartPower:
    """Variance and mean of the first `startup` samples of an epoch.

    They are looked at also where R was given or is an older one, which is not believed.
    """

    def __init__(self, startup: int) -> None:
        self.mean = 0.0
        self._startup = startup
        self._count = 0
        self._squares = 0.0

    @property
    def power(self) -> float | None:
        """Variance of these samples; None while there are too few."""
        return None if self._count < self._startup else self._squares / (self._count - 1)

    def add(self, y: float) -> None:
        """Take a sample, offset included."""
        if self._count >= self._startup:
            return
        self._count += 1
        step = y - self.mean
        self.mean += step / self._count
        self._squares += step * (y - self.mean)


class WhiteFollower:
    """Takes samples and estimates of one axis of an epoch; `quantiles` are what white noise would give now.

    An axis that begins anew has its runs begin anew with it. Samples that were lost are left out of the runs,
    as the filters of α and f leave them out. R, seed: as of `WhiteRuns`.
    """

    def __init__(self, sensor: Sensor, R: float | None, seed: int) -> None:
        self._start = StartPower(sensor.config.startup)
        self._runs = WhiteRuns(sensor, R, seed)
        self._valid = False

    @property
    def quantiles(self) -> Quantiles:
        """What white noise would give now; NaN where that is not known."""
        return self._runs.quantiles

    @property
    def mean(self) -> float:
        """Mean of the first samples so far."""
        return self._start.mean

    @property
    def power(self) -> float | None:
        """Variance of the first samples; None while there are too few."""
        return self._start.power

    def on_sample(self, y: float) -> None:
        """Take a sample, offset included."""
        self._start.add(y)

    def on_estimate(self, valid: bool, steps: int = 1) -> None:
        """Take note of an estimate, `steps` samples after the one before; the runs follow a few at a time."""
        if valid and not self._valid:
            self._runs.begin()
        self._valid = valid
        self._runs.advance(steps * valid, self.power)


def follow(
    axes: Sequence[str], hello: Hello | None, gyro: EstimatorConfig | None, accel: EstimatorConfig | None
) -> dict[str, WhiteFollower | None]:
    """Begin to follow the axes of an epoch; None for one whose settings or scale are not known.

    gyro, accel: settings of the axes of each sensor; their R, where it is a list, has one entry for each of
    its axes among `axes`.
    """
    followers: dict[str, WhiteFollower | None] = {}
    for number, axis in enumerate(axes):
        of_gyro = axis in AXES
        config = gyro if of_gyro else accel
        if hello is None or config is None:
            followers[axis] = None
            continue
        resolution = resolution_dps(hello) if of_gyro else accel_resolution_ms2(hello)
        R = config.R if isinstance(config.R, int | float) else None
        if isinstance(config.R, list):
            R = config.R[[a for a in axes if (a in AXES) == of_gyro].index(axis)]
        followers[axis] = WhiteFollower(Sensor(config, 1 / hello.rate_hz, resolution), R, number)
    return followers
