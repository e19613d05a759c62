"""Compute the overlapping Allan deviation of one axis of a recording, and read N, B and K from it.

Intervals and coefficients are computed as for the live curve (`fltea.spectrum.allan_curve`,
`fltea.spectrum.allan_coefficients`). Two things differ from the live curve: the averaging times are closer
together, and a mean begins at every sample, so that the means overlap.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fltea.identification.axis import AxisAnalysis
from fltea.records.arrays import Array
from fltea.spectrum.allan_curve import Allan, checked, points
from fltea.spectrum.allan_dof import FULL_PARTS, degrees_of_freedom, full_overlap

PER_DECADE = 10
"""Number of averaging times in each decade."""
LONGEST_SHARE = 0.25
"""The longest averaging time is this fraction of the record's length."""
BLOCK = 1 << 13
"""Number of samples that are processed together; so many fit into the processor's cache."""


def allan(stretches: Sequence[Array], h: float, unit: str = "deg/s") -> Allan:
    """Return the Allan deviation of a record with breaks, averaged over its stretches.

    No difference of means is taken across a break.

    The longest averaging time is a quarter of the longest stretch.

    Args:
        stretches: samples of each stretch, (n,), in `unit`.
        h: sampling period [s].
        unit: unit of the samples.

    Raises:
        ValueError: the samples are not finite or constant, all stretches are shorter than SHORTEST_RECORD, or
            h is not positive.
    """
    if any(y.ndim != 1 or not np.isfinite(y).all() for y in stretches):
        raise ValueError("y must be finite numbers, of shape (n,)")
    longest = max(map(len, stretches))
    checked(longest, h)
    if all(np.ptp(y) == 0 for y in stretches):
        raise ValueError("the axis is constant: there is no noise to analyse")
    factors = averaging_factors(longest)
    lengths = [len(y) for y in stretches]
    found = points(
        factors, overlapping(stretches, factors), h, lambda power: _degrees(power, factors, lengths)
    )
    return Allan.of(found, differences(factors, lengths), h, unit)


def allan_of(analysis: AxisAnalysis, unit: str) -> Allan:
    """Return the Allan deviation of an analysed axis, together with that of its chosen model.

    The command, the Python interface and `--allan-csv` all show this curve.

    Raises:
        ValueError: the axis is constant, or all its stretches are too short.
    """
    stretches = [np.asarray(one.y, dtype=np.float64) for one in analysis.stretches]
    found, figures = allan(stretches, analysis.h, unit), analysis.figures
    return found.with_model(analysis.summed.seen.evidence.candidates, figures.model, figures.level, unit)


def _degrees(power: ArrayLike, factors: NDArray[np.int64], lengths: Sequence[int]) -> Array:
    """Return the degrees of freedom of the Allan variance that is averaged over stretches without gaps.

    Each stretch is weighted by its number of differences.
    """
    if len(lengths) == 1:
        return full_overlap(power, factors, lengths[0])
    m = np.asarray(factors, dtype=np.float64)
    terms = np.zeros(len(m))
    for length, count in zip(*np.unique(lengths, return_counts=True), strict=True):
        use = 2 * m <= length
        terms[use] += count * (1 + np.floor(np.minimum(m, FULL_PARTS) * (length - 2 * m) / m))[use]
    return degrees_of_freedom(power, m, terms, FULL_PARTS)


def differences(factors: NDArray[np.int64], lengths: Sequence[int]) -> Array:
    """Return for each averaging time the number of pairs of neighbouring means over that time.

    `factors`: averaging times in samples. `lengths`: number of samples of each stretch.
    """
    each = np.asarray(lengths)[:, np.newaxis] - 2 * factors + 1
    return np.asarray(np.maximum(each, 0).sum(axis=0), dtype=np.float64)


def averaging_factors(samples: int) -> NDArray[np.int64]:
    """Return the averaging times in samples, about PER_DECADE in each decade."""
    longest = max(int(samples * LONGEST_SHARE), 1)
    count = 1 + math.ceil(PER_DECADE * math.log10(longest))
    return np.unique(np.rint(np.geomspace(1, longest, count)).astype(np.int64))


def overlapping(stretches: Sequence[Array], factors: NDArray[np.int64]) -> Array:
    """Return the overlapping Allan deviation, computed as `oadev` of allantools does.

    `factors`: averaging times in samples.

    Each stretch is weighted by its number of differences. Samples are processed in blocks that fit the cache.
    So the computation needs only one more array of the record's length, even for a day at 100 Hz.
    """
    squares, terms = np.zeros(len(factors)), np.zeros(len(factors))
    for y in stretches:
        phase = np.empty(len(y) + 1)
        phase[0] = 0.0
        np.subtract(y, y.mean(), out=phase[1:])
        np.cumsum(phase, out=phase)
        for i, m in enumerate(factors.tolist()):
            n = len(phase) - 2 * m
            if n < 1:
                break
            terms[i] += n
            for begin in range(0, n, BLOCK):
                end = min(begin + BLOCK, n)
                steps = phase[begin + 2 * m : end + 2 * m] - 2 * phase[begin + m : end + m] + phase[begin:end]
                squares[i] += float(steps @ steps)
    return np.asarray(np.sqrt(squares / (2 * terms)) / factors)
