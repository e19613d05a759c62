"""What FLTEA gives for shuffled copies of the same samples, which are white whatever they were before.

Copies are lanes of an engine, each with a start-up window, a bias and an R of its own, as the daemon would
have them.
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
"""Samples of all lanes that the engine takes at once: what it returns has to fit the caches."""
GROUP_BYTES = 64_000_000
"""The memory of the samples of a group of copies."""
LEAST_LANES, MOST_LANES = 8, 40
"""Lanes of a group: fewer leave wide instructions idle, more keep other processes idle at the end."""
LONGEST = 1 << 17
"""Samples; copies of a longer record are drawn from it, part by part, so that they need no memory. Those of
the joint filter end here: it forgets, and the quantiles of its last α move by 0.003 up to a million samples.
The triple's go on falling for as long (from 0.13 to 0.11), so its copies are as long as the record."""
DRAWN = 1 << 13
"""Samples of a part."""
ACCURACY = 3
"""Digits of the compressed memory: cost 1e-6 in α, where copies differ by 1e-2; a sixth of the time."""


class ShuffledBand(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """5, 50 and 95 % of the copies' last estimates; None where no copy has one."""

    copies: int
    lost: int
    """Copies that ran away (only without a guard), or are not valid at the end; left out."""
    alpha: tuple[float, float, float] | None
    f: tuple[float, float, float] | None
    """The parameter f in s^-α."""
    alpha_rank: float | None
    """Share of the copies whose α is below that of the data: 0.05 to 0.95 is what white noise gives."""
    f_rank: float | None


class Copies(msgspec.Struct, frozen=True):
    """Last estimates of some of the copies, (copies,); α and f are finite where they are not lost."""

    alpha: Array
    f: Array
    lost: NDArray[np.bool_]


def groups(samples: int, copies: int) -> list[range]:
    """Return the numbers of the copies, in groups of as many as may be in memory at a time.

    They depend on the record only, and not on who estimates them.
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
    """Estimate shuffled copies of one axis y (n,) with the settings of `config`, period h in s.

    copies: their numbers. Each is shuffled by (seed, number), and comes out the same beside whatever others.
    Of records of more than LONGEST samples they are drawn. part: begin and end of the samples that are meant,
    if not all: those that FLTEA was run over.
    Memory is compressed whatever `config.memory` says.

    Raises:
        ValueError: settings that no filter can work with.
    """
    if part is not None:
        y = y[slice(*part)]
    lanes, startup = len(copies), config.startup_needed
    parts = _parts(np.asarray(y), copies, seed, startup, config.variant)
    shuffles = next(parts)
    bias, R = lane_baselines(shuffles[:, :startup].T, config, lsb)
    if config.R == "auto":
        # A copy that happens to be constant in its window, of data that hardly ever change.
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
    """Yield the samples of the copies, (copies, n), part after part; the first holds the start-up window."""
    rngs = [np.random.default_rng((seed, number)) for number in copies]
    if len(y) <= LONGEST:
        shuffles = np.empty(
            (len(copies), len(y))
        )  # whole copies one after the other: columns are slow to write
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
    """Put groups of copies together; alpha, f: what the same settings gave for the data themselves."""
    lost = np.concatenate([part.lost for part in parts])
    alphas = np.concatenate([part.alpha for part in parts])[~lost]
    fs = np.concatenate([part.f for part in parts])[~lost]
    return ShuffledBand(
        len(lost), int(lost.sum()), _quantiles(alphas), _quantiles(fs), _rank(alphas, alpha), _rank(fs, f)
    )


def _quantiles(values: Array) -> tuple[float, float, float] | None:
    """Return quantiles at Weibull's positions: one more copy falls between two of them with their share."""
    if not values.size:
        return None
    places = np.array(PROBABILITIES) * (values.size + 1) - 1
    low, middle, high = np.interp(places, np.arange(values.size), np.sort(values)).tolist()
    return low, middle, high


def _rank(values: Array, value: float | None) -> float | None:
    if value is None or not math.isfinite(value) or not values.size:
        return None
    return float((values < value).mean() + (values == value).mean() / 2)
