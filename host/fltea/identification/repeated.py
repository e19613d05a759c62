"""Find samples that were delivered twice, as opposed to neighbours that rounding makes equal.

Rounding makes neighbours equal on each axis independently. This happens more often if the counts are coarser
or the noise is slower. A sample that is delivered twice equals the sample before on all axes at once. Let m_i
be the proportion of neighbours that are equal on axis i, and J the proportion that are equal on all axes.
Then the proportion q of repeated samples is the root of

    J = q + (1 - q) Π (m_i - q) / (1 - q)

No assumption on distribution or autocorrelation is needed. Two things make axes agree without a repeat. The
first is noise whose power changes: in quiet times, all axes have many equal neighbours. But then samples two
apart are often equal on all axes, too. And within each of 32 short parts of the record, where the power
hardly changes, J is hardly above the product Π m_i. The second is vibration, which correlates the steps of
the axes. Then J may exceed Π m_i by a factor that follows from the correlation matrix of the steps
(`_alike`).

For a single axis, the expected proportion of equal neighbours follows from the proportions of steps of one
and two counts.
"""

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fltea.identification.resolution import thin
from fltea.records.arrays import Array

Equal = NDArray[np.bool_]

PARTS = 32
"""Number of parts of the record. Proportions of equal neighbours are computed for each part. The scatter over
the parts gives the error of such a proportion, whatever the autocorrelation of the samples is.
"""
SIGNIFICANT = 5.5
"""Threshold for Student's t with PARTS - 1 degrees of freedom; chance exceeds it once in 400,000 cases."""
LEAST_DETERMINANT = 1e-3
"""The determinant of the correlation matrix of the axes' steps is taken to be at least this. Axes that are
even more alike count as one axis.
"""
HALVINGS = 40
FINE_COUNTS = 3.0
"""If the standard deviation of the steps between samples is above this [LSB], the proportion of equal
neighbours is one count times the density of the steps at 0, as if samples were not rounded.
"""
UNIFORM_LSB = 0.7
"""The number of neighbours that are equal by chance can be computed only if the values before rounding are
spread evenly within a count. They are if their σ is above this [LSB], even with heavy tails.

The sums of two neighbouring samples have to be spread evenly, too. Such a sum divided by √2 has the σ of a
sample in white noise, so it is compared with the same limit.
"""
LONG = 1 << 20
"""If there are more steps (differences of successive samples) than this, the correlation between axes is
computed from evenly spaced steps only.
"""
DIFFERENT = 0.9
"""Rounding does not matter if the number of distinct values is more than this fraction of the number of
samples.
"""
IN_STEP, AT_ONCE = 0.6, 200
"""The values change at a steady rate if the sample numbers of AT_ONCE successive changes lie near a straight
line: their standard deviation from it is less than IN_STEP [samples].

Changes at an exactly steady rate are rounded to whole samples, with a standard deviation of 0.29 samples.
"""
TAILS = 1.15
"""The expected number of equal neighbours on a single axis is that of Gaussian steps. With other
distributions of the steps, equal neighbours are at most this many times as frequent.
"""
_STEPS = np.geomspace(0.6, 2 * FINE_COUNTS, 400)
"""Standard deviations of Gaussian steps [LSB]. For each, the proportions of steps are computed that are 0, 1
and 2 counts long after rounding.

With standard deviations below the first, only heavy tails would produce steps of two counts.
"""


class Repeats(NamedTuple):
    """How many samples equal the sample before on every axis."""

    same: int
    pairs: int
    """Number of pairs that were compared."""
    expected: float
    """Number of equal pairs that chance would give."""
    found: bool
    """Whether there are more equal pairs than chance explains."""
    change_every: float | None = None
    """Number of samples from one change of the values to the next, if they change at a steady rate."""


def repeats(axes: Iterable[tuple[ArrayLike, float | None]]) -> Repeats | None:
    """Compare neighbouring samples on all axes; None if all axes are constant.

    `axes`: the samples (n,) of each axis, and one count in their unit; None if they are not rounded.
    """
    near: list[Equal] = []
    far: list[Equal] = []
    steps: list[NDArray[np.float32]] = []
    alone: Repeats | None = None
    for axis, count in axes:
        samples = np.asarray(axis, dtype=np.float64)
        if len(samples) <= 2 * PARTS or not np.ptp(samples) > 0:
            continue
        near.append(samples[1:] == samples[:-1])
        far.append(samples[2:] == samples[:-2])
        alone = _of_one_axis(samples, count) if not steps else None
        steps.append(np.diff(samples)[:: -(-len(samples) // LONG)].astype(np.float32))
    if len(near) < 2:
        return alone
    return _of_several(np.array(near), np.array(far), steps)


def _of_several(near: NDArray[np.bool_], far: NDArray[np.bool_], steps: list[NDArray[np.float32]]) -> Repeats:
    all_near: Equal = np.asarray(near.all(axis=0))
    same, pairs = int(all_near.sum()), len(all_near)
    alike = _alike(steps, ~all_near[:: -(-(pairs + 1) // LONG)])
    share, left_out = _repeated(near, all_near)
    all_far: Equal = np.asarray(far.all(axis=0))
    share_far, left_out_far = _repeated(far, all_far)
    error = _jackknife(left_out - left_out_far)
    each, together = _shares(near), _shares(all_near)
    over = together - np.minimum(alike * each.prod(axis=0), each.min(axis=0))
    spread = float(over.std(ddof=1)) / math.sqrt(PARTS)
    sure = share - share_far > SIGNIFICANT * error and float(over.mean()) > SIGNIFICANT * spread
    # If the counts are much finer than the noise, hardly any neighbours are equal on all axes by chance. Then
    # a few such neighbours prove repeats, and the tests above are not needed.
    chance = max(alike * float(near.mean(axis=1).prod()) * pairs, float(all_far.sum()))
    few = same > 3 + 1.5 * chance + 6 * math.sqrt(chance)
    repeated = (share - max(share_far, 0.0) if share_far < share / 2 else share) * pairs
    return Repeats(same, pairs, max(same - max(repeated, 0.0), 0.0), sure or few, _change_every(all_near))


def _alike(steps: list[NDArray[np.float32]], moved: Equal) -> float:
    """Return how many times as often all axes have equal neighbours at once as with independent steps."""
    if int(moved.sum()) < PARTS or not all(one[moved].var(dtype=np.float64) > 0 for one in steps):
        return 1.0  # the steps are so small that their squares are 0
    correlation = np.atleast_2d(np.corrcoef([one[moved] for one in steps]))
    return float(1 / math.sqrt(max(float(np.linalg.det(correlation)), LEAST_DETERMINANT)))


def _repeated(each: NDArray[np.bool_], together: Equal) -> tuple[float, Array]:
    """Return the proportion q of repeated samples, and q of the record without each of PARTS parts."""
    own, all_of_them = _shares(each), _shares(together)
    others = (PARTS * own.mean(axis=1)[:, np.newaxis] - own) / (PARTS - 1)
    left_out = _root((PARTS * all_of_them.mean() - all_of_them) / (PARTS - 1), others)
    return float(_root(all_of_them.mean(keepdims=True), own.mean(axis=1, keepdims=True))[0]), left_out


def _shares(equal: NDArray[np.bool_]) -> Array:
    """Return the mean of the values (..., n) in each of PARTS equal parts of the record, (..., PARTS).

    A few values at the end are ignored.
    """
    size = equal.shape[-1] // PARTS
    parts = equal[..., : size * PARTS].reshape(*equal.shape[:-1], PARTS, size)
    return np.asarray(parts.mean(axis=-1), dtype=np.float64)


def _root(together: Array, each: Array) -> Array:
    """Return the proportion q of repeated samples, (k,), by the equation in the module's docstring.

    `together`: J, the proportion of neighbours that are equal on all axes, (k,). `each`: m_i, the proportion
    on each axis, (axes, k). q is negative if J is less than the product of the m_i.
    """
    low, high = np.full(together.shape, -1.0), each.min(axis=0)
    for _ in range(HALVINGS):
        q = (low + high) / 2
        left = np.maximum(1 - q, 1e-9)
        less = q + left * ((each - q) / left).prod(axis=0) < together
        low, high = np.where(less, q, low), np.where(less, high, q)
    return np.asarray((low + high) / 2)


def _change_every(equal: Equal) -> float | None:
    """Return the number of samples between changes of the values; None if the changes have no steady rate."""
    at = np.flatnonzero(~equal[:LONG])
    rows = len(at) // AT_ONCE
    if not rows:
        return None
    parts = at[: rows * AT_ONCE].reshape(rows, AT_ONCE).astype(np.float64)
    k = np.arange(AT_ONCE) - (AT_ONCE - 1) / 2
    slopes = parts @ k / (k @ k)
    away = parts - parts.mean(axis=1, keepdims=True) - slopes[:, np.newaxis] * k
    return float((at[-1] - at[0]) / (len(at) - 1)) if np.median(away.std(axis=1)) < IN_STEP else None


def _usual_gap(samples: Array) -> float | None:
    """Return the usual distance between neighbouring values of rounded samples; None if they are not rounded.

    Unlike `resolution.step`, this works with values at uneven distances, too.
    """
    some = thin(samples)
    values = np.unique(some)
    if len(values) > DIFFERENT * len(some):
        return None
    return float(np.median(np.diff(values[len(values) // 4 : -(len(values) // 4) or None])))


def _of_one_axis(samples: Array, count: float | None) -> Repeats:
    moves = np.diff(samples)
    same, pairs = int((moves == 0).sum()), len(moves)
    every = _change_every(moves == 0)
    count = count or _usual_gap(samples)
    if count is None:
        return Repeats(same, pairs, 0.0, same > 3, every)
    sizes = np.rint(np.abs(moves) / count)
    moved = moves[sizes > 0]
    spread = float(moved.std()) / count if len(moved) else 0.0
    if spread >= FINE_COUNTS:
        expected = pairs / (spread * math.sqrt(2 * math.pi))
        return Repeats(same, pairs, expected, same > 3 + 1.5 * expected + 6 * math.sqrt(expected), every)
    # If samples alternate about a value, two neighbours may be rounded to the same count although the step
    # between them is large. The sums of such neighbours hardly vary, so their spread is tested, too.
    sums = samples[1:] + samples[:-1]
    if min(float(samples.std()), float(sums.std()) / math.sqrt(2)) < UNIFORM_LSB * count:
        return Repeats(same, pairs, float(same), False, every)
    none, one, two = (_shares(sizes == k) for k in (0, 1, 2))
    over = none.mean() - TAILS * _none(one.mean(), two.mean())
    rest = [(PARTS * part.mean() - part) / (PARTS - 1) for part in (none, one, two)]
    error = _jackknife(rest[0] - TAILS * _none(rest[1], rest[2]))
    expected = min(float(_none(one.mean(), two.mean())) * pairs, float(same))
    return Repeats(same, pairs, expected, bool(over > SIGNIFICANT * error), every)


def _none(one: Array, two: Array) -> Array:
    """Return the proportion of rounded Gaussian steps that are 0.

    `one`, `two`: proportions of steps that are one and two counts long, up or down.
    """
    chance = [_rounded_step(k) for k in range(3)]
    # If steps of two counts are rarer, in proportion to steps of one count, than for the smallest standard
    # deviation in `_STEPS`, the noise is so small that all equal neighbours count as chance.
    known = two > one * (chance[2] / chance[1])[0]
    ratio = np.interp(two / np.maximum(one, 1e-12), chance[2] / chance[1], chance[0] / chance[1] / 2)
    return np.where(known, one * ratio, 1.0)


def _rounded_step(k: int) -> Array:
    """Return the proportion of steps of k counts, up or down, for each standard deviation in _STEPS."""

    def integral(x: float) -> Array:
        z = x / _STEPS
        erf = np.array([math.erf(one / math.sqrt(2)) for one in z.tolist()])
        return np.asarray(x * (1 + erf) / 2 + _STEPS * np.exp(-(z**2) / 2) / math.sqrt(2 * math.pi))

    return integral(k + 1.0) - 2 * integral(float(k)) + integral(k - 1.0)


def _jackknife(left_out: Array) -> float:
    away = left_out - left_out.mean()
    return math.sqrt((PARTS - 1) / PARTS * float(away @ away))
