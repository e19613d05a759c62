"""Overlapping Allan deviation of one axis of a recording, and what is read from it: N, B and K.

Intervals and coefficients are those of the live curve (`fltea.spectrum.allan_curve`,
`fltea.spectrum.allan_coefficients`); here the averaging times are closer, and every sample begins a block.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fltea.identification.axis import Looked
from fltea.records.arrays import Array
from fltea.records.quantity import factor
from fltea.spectrum.allan_curve import Allan, checked, points
from fltea.spectrum.allan_dof import FULL_PARTS, degrees_of_freedom, full_overlap

PER_DECADE = 10
"""Averaging times."""
LONGEST_SHARE = 0.25
"""Longest averaging time over the record."""
BLOCK = 1 << 13
"""Samples that are looked at at a time."""


class Scale(NamedTuple):
    """A unit in which N, B or K is shown, and how many of it one of the curve's is."""

    unit: str
    factor: float


class Scales(NamedTuple):
    """The scales of N, B and K for one sensor."""

    N: Scale
    B: Scale
    K: Scale


def scales(unit: str) -> Scales:
    """Return the units of data sheets for a curve in deg/s; of another unit its own."""
    if unit == "deg/s":
        of = {"deg/√h": f"{unit}/√Hz", "deg/h": unit, "deg/h/√h": f"{unit}/√s"}
        return Scales(*(Scale(shown, factor(own, shown)) for shown, own in of.items()))
    return Scales(Scale(f"{unit}/√Hz", 1.0), Scale(unit, 1.0), Scale(f"{unit}/√s", 1.0))


def allan(stretches: Sequence[Array], h: float, unit: str = "deg/s") -> Allan:
    """Return the Allan deviation of stretches (n,) in `unit`, each of which overlaps in itself.

    It goes as far as a quarter of the longest; h is the period in s.

    Raises:
        ValueError: they are not finite, constant, or all shorter than SHORTEST_RECORD, or h is not positive.
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


def allan_of(looked: Looked, unit: str) -> Allan:
    """Return the Allan deviation of an axis that was looked at, beside the model that stands for its noise.

    It is the one of the command, of Python and of the file of `--allan-csv`.

    Raises:
        ValueError: the axis is constant, or all its stretches are too short.
    """
    stretches = [np.asarray(one.y, dtype=np.float64) for one in looked.stretches]
    found, figures = allan(stretches, looked.h, unit), looked.figures
    return found.with_model(looked.summed.seen.evidence.candidates, figures.sentence, figures.level, unit)


def _degrees(power: ArrayLike, factors: NDArray[np.int64], lengths: Sequence[int]) -> Array:
    """Return degrees of freedom of all stretches together, by their number of terms."""
    if len(lengths) == 1:
        return full_overlap(power, factors, lengths[0])
    m = np.asarray(factors, dtype=np.float64)
    terms = np.zeros(len(m))
    for length, count in zip(*np.unique(lengths, return_counts=True), strict=True):
        use = 2 * m <= length
        terms[use] += count * (1 + np.floor(np.minimum(m, FULL_PARTS) * (length - 2 * m) / m))[use]
    return degrees_of_freedom(power, m, terms, FULL_PARTS)


def differences(factors: NDArray[np.int64], lengths: Sequence[int]) -> Array:
    """Return how many differences of neighbouring means stretches of these lengths have for each factor."""
    each = np.asarray(lengths)[:, np.newaxis] - 2 * factors + 1
    return np.asarray(np.maximum(each, 0).sum(axis=0), dtype=np.float64)


def averaging_factors(samples: int) -> NDArray[np.int64]:
    """Return samples that are averaged for each point of the curve, PER_DECADE a decade."""
    longest = max(int(samples * LONGEST_SHARE), 1)
    count = 1 + math.ceil(PER_DECADE * math.log10(longest))
    return np.unique(np.rint(np.geomspace(1, longest, count)).astype(np.int64))


def overlapping(stretches: Sequence[Array], factors: NDArray[np.int64]) -> Array:
    """Return the overlapping Allan deviation for each factor, as allantools' `oadev` has it.

    Stretches are averaged by their number of terms. Blocks stay in the cache and memory is one array more,
    also for a day at 100 Hz.
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
