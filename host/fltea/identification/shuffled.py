"""Run FLTEA over shuffled copies of the samples.

Shuffling makes any noise white, so the estimates for the copies show what FLTEA finds in white noise.

FLTEA's engine processes several copies in parallel. It treats each copy as an axis, which is called a lane of
the engine. As in the daemon, each lane has its own start-up window, bias and R.
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
"""Number of samples of each copy that the engine processes at once, so few that the results fit into the
processor's caches.
"""
GROUP_BYTES = 64_000_000
"""Memory for the samples of a group of shuffled copies, over which FLTEA runs together [bytes]."""
LEAST_LANES, MOST_LANES = 8, 40
"""Least and largest number of copies in a group. One process runs FLTEA over a whole group.

Smaller groups do not use vector instructions fully. Larger ones leave other processes idle at the end.
"""
LONGEST = 1 << 17
"""Length of a record in samples above which its copies are not shuffled. The samples of a copy are then drawn
from the record at random, block by block, to save memory.

With `estimator.variant` joint (one filter for α and h^α f), such a copy has only LONGEST samples. This is
enough, since the filter forgets old samples: with a million samples, the quantiles of the last α over the
copies would change by only 0.003. With the variant triple (the paper's three filters), these quantiles depend
on the number of samples (they fall from 0.13 to 0.11), so a copy is as long as the record.
"""
DRAWN = 1 << 13
"""Number of samples in each block that is drawn from a long record."""
ACCURACY = 3
"""Accuracy, in digits, of the filters' memory of past samples. For shuffled copies, this memory is
compressed.

The error in α that comes from this memory is 1e-6, while α of the copies differs by 1e-2. The memory needs a
sixth of the time of an exact one.
"""


class ShuffledBand(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The 5, 50 and 95 % quantiles of FLTEA's last estimates for the shuffled copies.

    They are None if no copy has a valid estimate.
    """

    copies: int
    lost: int
    """Number of copies that were left out, since their estimates diverged or are not valid at the end."""
    alpha: tuple[float, float, float] | None
    f: tuple[float, float, float] | None
    """The parameter f of the fractional model [s^-α]."""
    alpha_rank: float | None
    """Proportion of the shuffled copies whose α is below the α of the recorded samples.

    If the recorded noise is white, this proportion is between 0.05 and 0.95 in nine of ten cases.
    """
    f_rank: float | None


class Copies(msgspec.Struct, frozen=True):
    """FLTEA's last estimates for a group of shuffled copies, one value for each copy.

    α and f are finite for all copies that are not `lost`.
    """

    alpha: Array
    f: Array
    lost: NDArray[np.bool_]


def groups(samples: int, copies: int) -> list[range]:
    """Divide the shuffled copies, numbered from 0, into groups that fit into memory.

    The groups depend on the length of the record and the number of copies, but not on the workers that run
    them.
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

    Each copy is shuffled with the seed (`seed`, number of the copy), so that it is the same in whichever
    group it is. Copies of records longer than LONGEST samples are drawn at random instead. The filters'
    memory of past samples is compressed, whatever `config.memory` says.

    Args:
        y: samples of the axis, (n,).
        h: sampling period [s].
        config: settings of FLTEA.
        lsb: one count in the unit of y, if known.
        copies: numbers of the shuffled copies to process.
        seed: seed of the shuffles.
        part: begin and end of the part of `y` that FLTEA was run over, from which copies are made; None: all
            samples.

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
        # If the samples hardly ever change, a copy may happen to be constant in its start-up window. Then the
        # variance there, from which R comes, is 0.
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
    """Yield the samples of shuffled copies, (copies, n), block by block.

    The first block is long enough for the start-up window.
    """
    rngs = [np.random.default_rng((seed, number)) for number in copies]
    if len(y) <= LONGEST:
        # each copy is a row of the array, since filling columns would be slow
        shuffles = np.empty((len(copies), len(y)))
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
    """Combine the estimates for all groups of copies into one band of quantiles.

    `alpha`, `f`: FLTEA's estimates for the recorded samples, with the settings used for the copies.
    """
    lost = np.concatenate([part.lost for part in parts])
    alphas = np.concatenate([part.alpha for part in parts])[~lost]
    fs = np.concatenate([part.f for part in parts])[~lost]
    return ShuffledBand(
        len(lost), int(lost.sum()), _quantiles(alphas), _quantiles(fs), _rank(alphas, alpha), _rank(fs, f)
    )


def _quantiles(values: Array) -> tuple[float, float, float] | None:
    """Return the 5, 50 and 95 % quantiles of `values`, at Weibull's plotting positions.

    With these positions, a further value of the same distribution lies below the 5 % quantile with a
    probability of exactly 5 % (and likewise for 50 and 95 %).
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
