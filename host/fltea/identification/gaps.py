"""Describe the gaps of a record, and fill short gaps with random samples.

Short gaps are filled ("bridged"): the lost samples are drawn at random, with the mean and the variance that
follow from their neighbours and from the autocovariance of the record. So the spectrum does not change. A
straight line between the neighbours is not good enough: with 1 % of the samples of white noise lost it tilts
the spectrum by 4 %, which a null test sees after ten minutes. A longer gap is not filled: the samples after
it belong to another stretch.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fltea.records.arrays import Array, Mask

LONGEST_BRIDGE = 8
"""Longest gap that is bridged, in lost samples, as for the live sums (firmware/core/engine/gate.hpp)."""
MOST_BRIDGED = 0.1
"""Gaps are filled only if at most this proportion of the record's samples is lost.

If more samples are missing, the sampling rate may be wrong, and no gap is filled.
"""
LONGEST_PREDICTION = 100
"""Longest gap, in lost samples, across which FLTEA predicts, as the setting `link.max_gap`.

FLTEA restarts after a longer gap.
"""
AROUND = 16
"""Number of neighbours on either side on which a filled-in sample depends."""
LEAST_VARIANCE = 1e-9
"""Each eigenvalue of a covariance matrix is made at least this fraction of the largest eigenvalue.

This is necessary since an eigenvalue that is estimated from few pairs of samples may be negative.
"""
SEED = 16
ROUNDED = 5
"""Number of samples per distinct value above which the samples count as rounded.

Filled-in samples are then rounded to values of the record.
"""


class Gaps(NamedTuple):
    """The gaps of a series: before sample `at[i]`, `missing[i]` samples are missing."""

    at: NDArray[np.int64]
    """Index of the first sample after each gap, (k,). All are above 0 and in rising order."""
    missing: NDArray[np.int64]
    """Number of samples lost in each gap, (k,). It is 0 for a gap with an unknown number of lost samples."""

    def within(self, begin: int, end: int) -> "Gaps":
        """Return the gaps between samples begin … end - 1, with indices counted from `begin`."""
        first, last = np.searchsorted(self.at, (begin + 1, end)).tolist()
        return Gaps(self.at[first:last] - begin, self.missing[first:last])

    def lost_up_to(self, longest: int) -> int:
        """Return the total number of samples lost in gaps of at most `longest` samples."""
        return int(self.missing[self.missing <= longest].sum())

    def place(self, number: int) -> int:
        """Return the index that a sample has if lost samples are counted, too."""
        return number + int(self.missing[: np.searchsorted(self.at, number, "right")].sum())


def no_gaps() -> Gaps:
    """Return the gaps of an unbroken series."""
    none = np.empty(0, dtype=np.int64)
    return Gaps(none, none)


class Stretch(NamedTuple):
    """A part of a series without a long gap; short gaps are filled.

    `missing`: number of samples lost before this part, 0 if not known.
    """

    y: Array
    missing: int


def bridge(n: int, gaps: Gaps) -> int:
    """Return the length of the longest gap that is filled in a record of n samples; 0 if no gap is filled."""
    return LONGEST_BRIDGE if gaps.lost_up_to(LONGEST_BRIDGE) <= MOST_BRIDGED * n else 0


def cut(n: int, gaps: Gaps, longest: int) -> list[tuple[int, int, int]]:
    """Return the parts of a record between gaps of more than `longest` samples.

    Each part is given by its begin, its end, and the number of samples missing before it.
    """
    broken = (gaps.missing == 0) | (gaps.missing > longest)
    edges = [0, *gaps.at[broken].tolist(), n]
    return list(zip(edges[:-1], edges[1:], [0, *gaps.missing[broken].tolist()], strict=True))


def longest_epoch(n: int, gaps: Gaps) -> tuple[int, int]:
    """Return begin and end of the longest part of n samples that FLTEA runs over without a restart."""
    begin, end, _ = max(cut(n, gaps, LONGEST_PREDICTION), key=lambda part: part[1] - part[0])
    return begin, end


def spread(y: Array, gaps: Gaps) -> tuple[Array, Mask | None]:
    """Return the series y (n,) with a 0 in place of each lost sample, and a mask of the lost samples.

    The mask is None if no sample is lost.
    """
    lost = int(gaps.missing.sum())
    if not lost:
        return y, None
    missing = np.ones(len(y) + lost, dtype=bool)
    indices = np.arange(len(y))
    indices += np.repeat(np.cumsum([0, *gaps.missing]), np.diff([0, *gaps.at, len(y)]))
    missing[indices] = False
    found = np.zeros(len(missing))
    found[indices] = y
    return found, missing


def bridged(y: Array, gaps: Gaps) -> list[Stretch]:
    """Return the stretches of y (n,), whose numbers have to be finite.

    Without gaps, there is one stretch, which holds y itself and not a copy.
    """
    if not len(gaps.at):
        return [Stretch(y, 0)]
    parts = cut(len(y), gaps, bridge(len(y), gaps))
    inside = [gaps.within(begin, end) for begin, end, _ in parts]
    spaced = [spread(y[begin:end], own) for (begin, end, _), own in zip(parts, inside, strict=True)]
    if all(missing is None for _, missing in spaced):
        return [Stretch(values, part[2]) for (values, _), part in zip(spaced, parts, strict=True)]
    drawn = _Drawn(spaced, _values(y))
    found = []
    for (values, missing), part in zip(spaced, parts, strict=True):
        if missing is not None:
            drawn.fill(values, missing)
        found.append(Stretch(values, part[2]))
    return found


def redrawn(stretches: Sequence[Stretch], masks: Sequence[Mask]) -> list[Stretch]:
    """Return stretches in which the samples marked by `masks` (n,) are replaced by random ones.

    The random samples are drawn as for lost samples.
    """
    spaced: list[tuple[Array, Mask | None]] = [
        (np.where(mask, 0.0, one.y), mask) for one, mask in zip(stretches, masks, strict=True)
    ]
    drawn = _Drawn(spaced, _values(max((one.y for one in stretches), key=len)))
    for (values, _), mask in zip(spaced, masks, strict=True):
        drawn.fill(values, mask)
    return [one._replace(y=values) for one, (values, _) in zip(stretches, spaced, strict=True)]


def _values(y: Array) -> Array | None:
    """Return the distinct values of y in rising order if y was rounded; else None."""
    values = np.unique(y)
    return values if len(values) * ROUNDED <= len(y) else None


class _Drawn:
    """Draw lost samples at random, to match their neighbours and the autocovariance of the record."""

    def __init__(self, parts: Sequence[tuple[Array, Mask | None]], values: Array | None) -> None:
        self._covariance = _covariance(parts)
        self._values = values
        self._rng = np.random.default_rng(SEED)
        self._known: dict[bytes, tuple[Array, Array]] = {}

    def fill(self, y: Array, missing: Mask) -> None:
        """Fill the places of the lost samples of y (n,) with random samples."""
        mean = float(y.sum()) / int((~missing).sum())
        open_ = missing.copy()
        for begin, end in _runs(missing):
            low, high = max(begin - AROUND, 0), min(end + AROUND, len(y))
            seen = ~open_[low:high]
            weights, root = self._rule(seen, begin - low, end - begin)
            near = y[low:high][seen] - mean
            drawn = mean + weights @ near + root @ self._rng.standard_normal(end - begin)
            y[begin:end] = drawn if self._values is None else _nearest(self._values, drawn)
            open_[begin:end] = False

    def _rule(self, seen: Mask, at: int, count: int) -> tuple[Array, Array]:
        """Return what the neighbours say about `count` lost samples; `seen` marks those that are not lost.

        The result has two arrays: the weights of the n neighbours in the mean, (count, n), and a matrix root
        of the covariance about this mean, (count, count).
        """
        key = bytes([at, count]) + seen.tobytes()
        if key not in self._known:
            whole = self._covariance[: len(seen), : len(seen)]
            lost = np.arange(at, at + count)
            known = np.flatnonzero(seen)
            across = whole[np.ix_(lost, known)]
            weights = np.linalg.solve(whole[np.ix_(known, known)], across.T).T
            left = whole[np.ix_(lost, lost)] - weights @ across.T
            size, vectors = np.linalg.eigh((left + left.T) / 2)
            root = np.asarray(vectors * np.sqrt(np.maximum(size, 0.0)), dtype=np.float64)
            self._known[key] = np.asarray(weights, dtype=np.float64), root
        return self._known[key]


def _runs(missing: Mask) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(missing, prepend=False, append=False))
    return [(begin, end) for begin, end in edges.reshape(-1, 2).tolist()]


def _covariance(parts: Sequence[tuple[Array, Mask | None]]) -> Array:
    """Return the autocovariance matrix of successive samples, (lags, lags).

    It covers a longest gap and its neighbours on both sides. Each lag is averaged over all pairs of samples
    that are not lost.
    """
    lags = 2 * AROUND + LONGEST_BRIDGE
    sums, pairs = np.zeros(lags), np.zeros(lags)
    for values, missing in parts:
        there = np.ones(len(values)) if missing is None else (~missing).astype(np.float64)
        centred = (values - float(values.sum()) / float(there.sum())) * there
        for k in range(min(lags, len(values))):
            sums[k] += centred[k:] @ centred[: len(centred) - k]
            pairs[k] += there[k:] @ there[: len(there) - k]
    lag = np.arange(lags)
    whole = (sums / np.maximum(pairs, 1.0))[np.abs(lag[:, np.newaxis] - lag)]
    size, vectors = np.linalg.eigh(whole)
    least = max(LEAST_VARIANCE * float(size[-1]), np.finfo(np.float64).tiny)
    return np.asarray((vectors * np.maximum(size, least)) @ vectors.T)


def _nearest(values: Array, drawn: Array) -> Array:
    above = np.searchsorted(values, drawn).clip(1, len(values) - 1)
    below = above - 1
    nearest = np.where(drawn - values[below] < values[above] - drawn, values[below], values[above])
    return np.asarray(nearest, dtype=np.float64)
