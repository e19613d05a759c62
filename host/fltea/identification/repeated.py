"""Samples that were delivered twice, distinguished from neighbours that rounding makes equal (pure).

Rounding makes neighbours equal on each axis by itself, the more often the coarser the counts and the slower
the noise. A sample that is delivered twice is equal to the one before on all axes at once. With m_i the share
of equal neighbours on axis i and J that of those equal on all axes, the share q of repeats is the root of

    J = q + (1 - q) Π (m_i - q) / (1 - q)

which asks nothing of distribution or autocorrelation. Two things make axes alike without a repeat: a power
that changes, and steps that are correlated (vibration). Samples two apart are alike then too, and the excess
of J over Π m_i, times what the correlation allows, is small within each part of the record.

Of a single axis, steps of one and of two counts tell how many of none there should be.
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
"""Parts of the record whose spread gives the error, whatever the autocorrelation."""
SIGNIFICANT = 5.5
"""Student's t with PARTS - 1 degrees of freedom that chance exceeds once in 400,000."""
LEAST_DETERMINANT = 1e-3
"""The least determinant of the steps' correlation: axes that are more alike are one axis."""
HALVINGS = 40
FINE_COUNTS = 3.0
"""Spread of the steps in LSB from which on their density is that of steps without rounding."""
UNIFORM_LSB = 0.7
"""σ from which on the signal lies anywhere between two counts, also with heavy tails."""
LONG = 1 << 20
"""Steps from which on the correlation is that of some of them, spread evenly."""
DIFFERENT = 0.9
"""Share of samples of different values from which on they are not rounded, or too finely to matter."""
IN_STEP, AT_ONCE = 0.6, 200
"""Changes at a steady rate are within one sample of a straight line over so many, 0.29 by their deviation."""
TAILS = 1.15
"""Times as many equal neighbours as of Gaussian steps are allowed for other distributions."""
_STEPS = np.geomspace(0.6, 2 * FINE_COUNTS, 400)
"""Spreads of steps before rounding, in LSB; of finer ones heavy tails alone decide how many are of two."""


class Repeats(NamedTuple):
    """Samples that are equal to the one before on every axis."""

    same: int
    pairs: int
    """The number of pairs that were compared."""
    expected: float
    """How many chance makes equal."""
    found: bool
    """Whether there are more."""
    change_every: float | None = None
    """Samples from one change of the values to the next, if they change at a steady rate."""


def repeats(axes: Iterable[tuple[ArrayLike, float | None]]) -> Repeats | None:
    """Compare neighbours on the axes; None if none of them moves.

    axes: the samples (n,) of each, and what one count is in their unit; None: they are not rounded.
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
    # Of fine counts hardly any neighbours are equal, and a few on all axes are proof enough.
    chance = max(alike * float(near.mean(axis=1).prod()) * pairs, float(all_far.sum()))
    few = same > 3 + 1.5 * chance + 6 * math.sqrt(chance)
    repeated = (share - max(share_far, 0.0) if share_far < share / 2 else share) * pairs
    return Repeats(same, pairs, max(same - max(repeated, 0.0), 0.0), sure or few, _change_every(all_near))


def _alike(steps: list[NDArray[np.float32]], moved: Equal) -> float:
    """Return how many times as often axes are equal at once as independent ones, for correlated steps."""
    if int(moved.sum()) < PARTS or not all(one[moved].var(dtype=np.float64) > 0 for one in steps):
        return 1.0  # of numbers too small to be squared nothing is known
    correlation = np.atleast_2d(np.corrcoef([one[moved] for one in steps]))
    return float(1 / math.sqrt(max(float(np.linalg.det(correlation)), LEAST_DETERMINANT)))


def _repeated(each: NDArray[np.bool_], together: Equal) -> tuple[float, Array]:
    """Return the share of repeats, and (PARTS,) what it is without each part of the record."""
    own, all_of_them = _shares(each), _shares(together)
    others = (PARTS * own.mean(axis=1)[:, np.newaxis] - own) / (PARTS - 1)
    left_out = _root((PARTS * all_of_them.mean() - all_of_them) / (PARTS - 1), others)
    return float(_root(all_of_them.mean(keepdims=True), own.mean(axis=1, keepdims=True))[0]), left_out


def _shares(equal: NDArray[np.bool_]) -> Array:
    """Return the values (..., n) in parts (..., PARTS); the last few samples are in none."""
    size = equal.shape[-1] // PARTS
    parts = equal[..., : size * PARTS].reshape(*equal.shape[:-1], PARTS, size)
    return np.asarray(parts.mean(axis=-1), dtype=np.float64)


def _root(together: Array, each: Array) -> Array:
    """Return the q of the equation above for J (k,) and m (axes, k); negative where J is less than chance."""
    low, high = np.full(together.shape, -1.0), each.min(axis=0)
    for _ in range(HALVINGS):
        q = (low + high) / 2
        left = np.maximum(1 - q, 1e-9)
        less = q + left * ((each - q) / left).prod(axis=0) < together
        low, high = np.where(less, q, low), np.where(less, high, q)
    return np.asarray((low + high) / 2)


def _change_every(equal: Equal) -> float | None:
    """Return the samples from one change to the next; None where changes come at no steady rate."""
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
    """Return the usual distance of two values that were rounded to uneven steps; None: they were not."""
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
    if float(samples.std()) < UNIFORM_LSB * count:
        return Repeats(same, pairs, float(same), False, every)
    none, one, two = (_shares(sizes == k) for k in (0, 1, 2))
    over = none.mean() - TAILS * _none(one.mean(), two.mean())
    rest = [(PARTS * part.mean() - part) / (PARTS - 1) for part in (none, one, two)]
    error = _jackknife(rest[0] - TAILS * _none(rest[1], rest[2]))
    expected = min(float(_none(one.mean(), two.mean())) * pairs, float(same))
    return Repeats(same, pairs, expected, bool(over > SIGNIFICANT * error), every)


def _none(one: Array, two: Array) -> Array:
    """Return the share of steps of no count, from those of one and two counts, if steps are Gaussian."""
    chance = [_rounded_step(k) for k in range(3)]
    # Where steps of two are rarer than the finest of these has them, nothing can be told: take all.
    known = two > one * (chance[2] / chance[1])[0]
    ratio = np.interp(two / np.maximum(one, 1e-12), chance[2] / chance[1], chance[0] / chance[1] / 2)
    return np.where(known, one * ratio, 1.0)


def _rounded_step(k: int) -> Array:
    """Return the share of steps of k counts up or down alike, for the spreads in _STEPS."""

    def integral(x: float) -> Array:
        z = x / _STEPS
        erf = np.array([math.erf(one / math.sqrt(2)) for one in z.tolist()])
        return np.asarray(x * (1 + erf) / 2 + _STEPS * np.exp(-(z**2) / 2) / math.sqrt(2 * math.pi))

    return integral(k + 1.0) - 2 * integral(float(k)) + integral(k - 1.0)


def _jackknife(left_out: Array) -> float:
    away = left_out - left_out.mean()
    return math.sqrt((PARTS - 1) / PARTS * float(away @ away))
