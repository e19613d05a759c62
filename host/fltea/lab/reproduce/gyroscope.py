"""Set up section 7 of Macias & Sierociuk 2023: a resting gyroscope, or white noise without a recording.

Without a recording, white noise with the paper's R as its variance is used, and the filters use this R. With
a recording, its first 3,000 samples are used. Their mean is subtracted, since the paper's algorithm diverges
if the samples have an offset. R is then the variance of these samples, and not the paper's R: R is a property
of the sensor, and the algorithm diverges if R is far too small.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from fltea.lab.reproduce import paper
from fltea.lab.reproduce.scenarios import GYROSCOPE_FILTERS, Data, Scenario
from fltea.records.arrays import Array
from fltea.records.errors import UsageError
from fltea.settings.how import AS_IT_SAYS, How
from fltea.sources.replay import ReplaySource
from fltea.stream.decode import Decoded, Decoder

ANY_GAP = 10**9
"""Longest gap in a recording, in samples, that is ignored, since the paper's filters cannot treat gaps."""

Make = Callable[[Sequence[int]], Data]


def white_noise() -> dict[str, Scenario]:
    """Return the experiment of each axis on white noise with the paper's R. The noises are independent."""
    return {axis: _white_axis(number, axis, R) for number, (axis, R) in enumerate(paper.GYRO_R.items())}


def _white_axis(number: int, axis: str, R: float) -> Scenario:
    def make(seeds: Sequence[int]) -> Data:
        n = paper.GYRO_SAMPLES
        noise = [np.random.default_rng((seed, number)).normal(0, np.sqrt(R), n) for seed in seeds]
        return Data(np.column_stack(noise))

    source = "white noise with the paper's R as its variance, in place of a recording"
    return _scenario(axis, source, R, make, paper.GYRO_H, single=False)


def recorded(path: Path, how: How = AS_IT_SAYS) -> dict[str, Scenario]:
    """Return the experiment of each axis on a recording, read as `replay:` does.

    Raises:
        UsageError: the file cannot be read, is shorter than the paper's run, or an axis is constant.
    """
    gyro_dps, rate_hz = _read(path, how)
    n = paper.GYRO_SAMPLES
    if len(gyro_dps) < n:
        raise UsageError(f"{path}: has {len(gyro_dps):,} samples; the paper's runs take {n:,}.")
    first = gyro_dps[:n] - gyro_dps[:n].mean(axis=0)
    scenarios = {}
    for axis, values in zip(paper.GYRO_R, first.T, strict=False):
        R = float(values.var())
        if R == 0:
            raise UsageError(f"{path}: the {axis} axis never changes in the first {n:,} samples.")
        source = f"recording {path.name}, {rate_hz:g} Hz, R = its variance"
        make = _always(Data(values[:, np.newaxis]))
        scenarios[axis] = _scenario(axis, source, R, make, 1 / rate_hz, single=True)
    return scenarios


def _always(data: Data) -> Make:
    return lambda seeds: data


def _scenario(axis: str, source: str, R: float, make: Make, h: float, *, single: bool) -> Scenario:
    return Scenario(
        title=f"Gyroscope, {axis} axis",
        source=source,
        lengths=paper.GYRO_LENGTHS,
        filters=replace(GYROSCOPE_FILTERS, h=h, R=R),
        R=R,
        samples=paper.GYRO_SAMPLES,
        make=make,
        unit="deg/s",
        single=single,
    )


def _read(path: Path, how: How) -> tuple[Array, float]:
    """Return the samples (n, axes) of a recording's first epoch in deg/s, and their rate in Hz."""
    source, decoder = ReplaySource(path, how=how), Decoder(lambda: 0, ANY_GAP)
    decoded = [found for event in source.events() for found in decoder.feed(event)]
    first = [one for one in decoded if isinstance(one, Decoded) and one.block.epoch == 1]
    if not first:
        raise UsageError(f"{path}: holds no samples.")
    return np.concatenate([one.block.gyro_dps for one in first]), first[0].hello.rate_hz
