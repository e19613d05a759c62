"""Run FLTEA over shuffled copies of the samples.

Shuffling makes any noise white.

The engine processes several copies in parallel, each as a lane. As in the daemon, each has its own start-up
window, bias and R.
"""

import math
from collections.abc import Iterator, Sequence
from itertools import chain

import msgspec
import numpy as np
from numpy.typing import NDArray

from fltea.estimator.baseline import lane_baselines
from fltea.estimator.lane_settings import LaneSettings
from fltea.estimator.lanes import Lanes
from fltea.records.arrays import Array
from fltea.settings.estimator import EstimatorConfig

PROBABILITIES = (0.05, 0.5, 0.95)
BLOCK = 100
"""Number of samples of each copy that the engine processes at once; the results have to fit into the
caches.
"""
GROUP_BYTES = 64_000_000
"""Memory for the samples of a group of copies [bytes]."""
LEAST_LANES, MOST_LANES = 8, 40
"""Least and largest number of copies in a group.

Smaller groups do not use vector instructions fully. Larger ones leave other processes idle at the end.
"""
LONGEST = 1 << 17
"""Length in samples above which copies are drawn from the record at random, block by block, to save memory.

Copies for the joint filter have at most this length. This filter forgets old samples: up to a million
samples, the quantiles of its last α change by 0.003. Those of the triple filter keep falling (from 0.13 to
0.11), so its copies are as long as the record.
"""
DRAWN = 1 << 13
"""Number of samples in a block that is drawn from the record."""
ACCURACY = 3
"""Digits of the compressed memory of the past.

Its error in α is 1e-6, while copies differ by 1e-2. It needs a sixth of the time of an exact memory.
"""


class ShuffledBand(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The 5, 50 and 95 % quantiles of the copies' last estimates; None if no copy has a valid estimate."""

    copies: int
    lost: int
    """Number of copies that were left out, since their estimates diverged or are not valid at the end."""
    alpha: tuple[float, float, float] | None
    f: tuple[float, float, float] | None
    """The parameter f of s^-α."""
    alpha_rank: float | None
    """Share of the copies whose α is below that of the data.

    For white noise it is between 0.05 and 0.95 in nine of ten cases.
    """
    f_rank: float | None


class Copies(msgspec.Struct, frozen=True):
    """The last estimates for some copies, (copies,). α and f are finite for copies that are not left out."""

    alpha: Array
    f: Array
    lost: NDArray[np.bool_]


def groups(samples: int, copies: int) -> list[range]:
    """Divide the numbers of the copies into groups that fit into memory.

    The groups depend on the length of the record and the number of copies, but not on the workers.
    """
    samples = min(samples, LONGEST)
    size = max(
        LEAST_LANES, min(MOST_LANES, GROUP_BYTES // (8 * max(samples, 1)) // LEAST_LANES * LEAST_LANES)
    )
    return [range(first, min(first + size, copies)) for first in range(0, copies, size)]


def estimate(
    y: Array,
    h: float,
    config: EstimatorConfig,
    lsb: float | None,
    copies: range,
    seed: int,
    part: tuple[int, int] | None = None,
) -> Copies:
    """Run FLTEA over shuffled copies of one axis with the settings of `config`.

    Each copy is shuffled by the seed (seed, number), so that it is the same in any group. Copies of records
    longer than LONGEST are drawn instead. Memory is compressed whatever `config.memory` says.

    Args:
        y: samples of the axis, (n,).
        h: sampling period [s].
        config: settings of FLTEA.
        lsb: one count in the unit of y, if known.
        copies: numbers of the copies.
        seed: seed of the shuffles.
        part: begin and end of the samples that FLTEA was run over; None: all.

    Raises:
        ValueError: the settings give no filter that works.
    """
    if part is not None:
        y = y[slice(*part)]
    lanes, startup = len(copies), config.startup_needed
    parts = _parts(np.asarray(y), copies, seed, startup, config.variant)
    shuffles = next(parts)
    bias, R = lane_baselines(shuffles[:, :startup].T, config, lsb)
    if config.R == "auto":
        # If the data hardly ever change, a copy may happen to be constant in its start-up window.
        R = np.maximum(R, 1e-6 * y[:LONGEST].var())
    settings = LaneSettings(msgspec.structs.replace(config, memory="compressed"), h, R, accuracy=ACCURACY)
    runner = Lanes(lanes, settings)
    lost = np.zeros(lanes, dtype=bool)
    for now in chain([shuffles[:, startup:]], parts):
        for start in range(0, now.shape[1], BLOCK):
            block = runner.run(now[:, start : start + BLOCK].T - bias)
            for one in block.lost:
                lost[one.lane] |= one.reason == "runaway"
    return Copies(block.alpha[-1].copy(), block.f[-1].copy(), lost | ~block.valid[-1])


def _parts(y: Array, copies: range, seed: int, startup: int, variant: str) -> Iterator[Array]:
    """Yield the samples of the copies, (copies, n), block by block; the first holds the start-up window."""
    rngs = [np.random.default_rng((seed, number)) for number in copies]
    if len(y) <= LONGEST:
        shuffles = np.empty(
            (len(copies), len(y))
        )  # fill one copy after the other, since writing columns is slow
        for row, rng in zip(shuffles, rngs, strict=True):
            row[:] = rng.permutation(y)
        yield shuffles
        return
    left = LONGEST if variant == "joint" else len(y)
    size = startup + DRAWN
    while left > 0:
        yield np.stack([rng.choice(y, min(size, left)) for rng in rngs])
        left -= size
        size = DRAWN


def shuffled_band(parts: Sequence[Copies], alpha: float | None, f: float | None) -> ShuffledBand:
    """Join groups of copies. `alpha`, `f`: the estimates for the data themselves with the same settings."""
    lost = np.concatenate([part.lost for part in parts])
    alphas = np.concatenate([part.alpha for part in parts])[~lost]
    fs = np.concatenate([part.f for part in parts])[~lost]
    return ShuffledBand(
        len(lost), int(lost.sum()), _quantiles(alphas), _quantiles(fs), _rank(alphas, alpha), _rank(fs, f)
    )


def _quantiles(values: Array) -> tuple[float, float, float] | None:
    """Return quantiles at Weibull's plotting positions.

    One more copy would be below such a quantile with exactly the nominal probability.
    """
    if not values.size:
        return None
    positions = np.array(PROBABILITIES) * (values.size + 1) - 1
    low, middle, high = np.interp(positions, np.arange(values.size), np.sort(values)).tolist()
    return low, middle, high


def _rank(values: Array, value: float | None) -> float | None:
    if value is None or not math.isfinite(value) or not values.size:
        return None
    return float((values < value).mean() + (values == value).mean() / 2)
