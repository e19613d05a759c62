"""Find values that are too frequent for a sensor's noise: a dead band, a replacement value, clipping.

A record is divided into parts, which are checked separately. The distinct values of a part are sorted and
counted. In noise, rounded or not, neighbouring values are about equally frequent. Coarse rounding is an
exception, since it leaves only a few values. But then most samples are within a few counts of the most
frequent value. A replacement value differs from that: most samples are farther from it.
"""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fltea.identification.data_checks import DataCheck
from fltea.identification.resolution import LONG
from fltea.records.arrays import Array

PARTS, MOST_PARTS = 8, 5
"""The record is divided into at most PARTS parts. A fault is reported if at least the proportion MOST_PARTS /
PARTS of the parts shows it.

Not all parts have to show the fault, but one part is not enough: a record with rest and motion has values
that are frequent in one part only.
"""
LEAST, LEAST_OF_ALL = 500, 100
"""LEAST: least number of samples in each of the parts into which a record is divided. LEAST_OF_ALL: a record
with fewer samples is not searched for frequent or clipped values.
"""
NEIGHBOURS = 3
"""Number of distinct values on either side of a suspicious value from which the usual distance between values
is computed.
"""
OFTEN = 20
"""A value is reported if samples arrive at it from another value at least this often.

A sensor that is stuck at one value arrives there only once. Another data check finds such a sensor.
"""
TOO_OFTEN, BESIDE_A_GAP = 3.0, 2.0
"""A value is too frequent if it occurs at least TOO_OFTEN times as often as each of its two neighbouring
values. If the distances to both neighbouring values are unusually wide (GAP), BESIDE_A_GAP is used instead.
"""
GAP = 1.75
"""The distance between two neighbouring values is a gap if it is at least this many times the usual distance.
"""
AWAY = 3.0
"""A value that replaces others is far from most samples. So the median distance of the other samples from it
has to be at least AWAY times the distance to its nearest neighbouring value.
"""
LEAST_SHARE, BAD_SHARE = 0.002, 0.05
"""The surplus of a value is the number of samples with this value less the number with its more frequent
neighbouring value, as a proportion of all samples. The value is reported if its surplus is at least
LEAST_SHARE. N is called wrong if the surplus of a value without a dead band is at least BAD_SHARE.
"""
BAD_POWER = 0.01
"""N is wrong if a dead band has removed more than this proportion of the noise's power."""
CLIPPED = 2.0
"""Samples are clipped if the outermost value has at least this many times the number of samples that is
expected from the two values before it.
"""
SURELY, BAD_CLIPPED = 6.0, 0.01
"""SURELY: the number of samples at the outermost value has to exceed the expected number by at least this
many standard deviations. BAD_CLIPPED: N is wrong if at least this proportion of samples is clipped.
"""
SHORTEST_STAY = 10.0
"""Values count as levels if samples stay at each value for at least this many successive samples in the mean.

Shorter stays come from rounding or from alternating sensors.
"""
FEW_VALUES, BEGIN = 3, 1000
"""FEW_VALUES is the largest number of distinct values that counts as few. BEGIN is the number of samples at
the beginning of a record that are tested first, to save time.

In an ordinary record, these first samples already have more distinct values than FEW_VALUES.
"""
REMEDY = (
    "A driver, a filter or the sensor itself puts one value in place of others (a dead band, zero for a "
    "failed read): switch that off and record again. Nothing can be said about the noise that it hides."
)


HIDE = "dead band", "common value", "few values"
"""Kinds of data checks that explain why neighbouring samples are equal so often."""


class _Values(NamedTuple):
    """The distinct values of a part of the record in rising order, and the number of samples with each."""

    values: Array
    counts: NDArray[np.int64]


class _Common(NamedTuple):
    """A value that is too frequent.

    `gap`: distance from this value to the nearest other value if the distance is unusually large, else 0.
    """

    value: float
    share: float
    gap: float
    is_bad: bool


def value_data_checks(y: Array, unit: str) -> Iterator[DataCheck]:
    """Yield the data checks on the values of samples y (n,), which are in `unit`."""
    samples = np.asarray(y, dtype=np.float64)[:LONG]
    few = few_values(samples, unit)
    if few is not None:
        yield few
        return
    if len(samples) < LEAST_OF_ALL:
        return
    parts = np.array_split(samples, max(min(PARTS, len(samples) // LEAST), 1))
    values = [_Values(*np.unique(part, return_counts=True)) for part in parts]
    need = -(-len(parts) * MOST_PARTS // PARTS)
    common = [one for part, its in zip(parts, values, strict=True) if (one := _common(part, its))]
    if len(common) >= need:
        yield from _too_frequent(common, unit)
    ends = [(_at_end(part, its, -1), _at_end(part, its, 1)) for part, its in zip(parts, values, strict=True)]
    yield from _clipped(ends, [one.values for one in values], need, len(samples), unit)


def few_values(y: Array, unit: str) -> DataCheck | None:
    """Return a data check if samples (n,) have only a few values and stay long at each, else None."""
    if len(np.unique(y[:BEGIN])) > FEW_VALUES or not 2 <= len(values := np.unique(y)) <= FEW_VALUES:
        return None
    at = np.searchsorted(values, y)
    stays = np.bincount(at[np.concatenate([[True], np.diff(at) != 0])], minlength=len(values))
    counts = np.bincount(at, minlength=len(values))
    if (counts < SHORTEST_STAY * stays).any():
        return None
    names = ", ".join(f"{one:.4g}" for one in values.tolist())
    return DataCheck(
        "few values",
        "bad",
        f"There are only {len(values)} values, {names} {unit}, and each of them stays for "
        f"{len(y) / int(stays.sum()):.3g} samples in the mean: steps between levels (telegraph noise), or "
        "counts that are too coarse. Noise about them cannot be seen.",
        "Choose a smaller range of the sensor, and write all its decimals. If it does step between levels, "
        "it is defective.",
    )


def _common(part: Array, of: _Values) -> _Common | None:
    """Return the most frequent value of a part of the record if it is too frequent, else None."""
    values, counts = of
    at = int(counts.argmax())
    if not 2 <= at < len(values) - 2:
        return None
    beside = int(max(counts[at - 1], counts[at + 1]))
    is_it = part == values[at]
    share = float(counts[at] - beside) / len(part)
    if _came(is_it) < OFTEN or share < LEAST_SHARE or counts[at] < BESIDE_A_GAP * beside:
        return None
    low, high = values[max(at - 1 - NEIGHBOURS, 0) : at], values[at + 1 : at + 2 + NEIGHBOURS]
    usual = float(np.median(np.concatenate([np.diff(low), np.diff(high)])))
    gap = float(min(values[at] - low[-1], high[0] - values[at]))
    if gap >= GAP * usual:
        # In a dead band, one value replaces all samples within ± `gap` of it. Before, these samples were
        # spread evenly over the band, with a mean square of gap²/3. This is the power that the noise has
        # lost.
        return _Common(float(values[at]), share, gap, share * gap**2 / 3 >= BAD_POWER * float(part.var()))
    away = float(np.median(np.abs(part[~is_it] - values[at])))
    if counts[at] >= TOO_OFTEN * beside and away >= AWAY * gap:
        return _Common(float(values[at]), share, 0.0, share >= BAD_SHARE)
    return None


def _came(is_it: NDArray[np.bool_]) -> int:
    """Return how often the samples change to a certain value from another value.

    `is_it`: mask of samples with this value.
    """
    return int(np.count_nonzero(is_it[1:] & ~is_it[:-1]))


def _too_frequent(common: list[_Common], unit: str) -> Iterator[DataCheck]:
    share = float(np.mean([one.share for one in common]))
    value, gap = common[0].value, float(np.median([one.gap for one in common]))
    if gap:
        kind, what = "dead band", f", and none is nearer to it than {gap:.3g} {unit}: a dead band"
    else:
        kind, what = "common value", ", far more than have the neighbouring values"
    yield DataCheck(
        kind,
        "bad" if 2 * sum(one.is_bad for one in common) > len(common) else "warning",
        f"{share:.2%} of the samples are exactly {value:.4g} {unit}{what}."
        if share < 0.01
        else f"{share:.0%} of the samples are exactly {value:.4g} {unit}{what}.",
        REMEDY,
    )


def _at_end(part: Array, of: _Values, end: int) -> int:
    """Return how many samples of a part are clipped at `end`, its highest (1) or lowest (-1) value."""
    counts = of.counts[::-end] if end > 0 else of.counts
    if len(counts) < 4:
        return 0
    last, before, third = counts[:3].tolist()
    # In the tails of noise, the number of samples with a value falls at least as fast as an exponential. So
    # the number that is expected at the outermost value is extrapolated exponentially from the two values
    # before it.
    most = max(before, before * before / third)
    if last < OFTEN or last <= CLIPPED * most or last <= most + SURELY * math.sqrt(most + last):
        return 0
    return int(last) if _came(part == of.values[-1 if end > 0 else 0]) >= OFTEN else 0


def _clipped(
    ends: list[tuple[int, int]], values: list[Array], need: int, n: int, unit: str
) -> Iterator[DataCheck]:
    """Yield a data check if values are clipped at the lowest or highest value.

    Args:
        ends: numbers of clipped samples at the lowest and the highest value of each part.
        values: the distinct values of each part.
        need: number of parts that have to show the clipping.
        n: number of samples in all parts.
        unit: unit of the samples.
    """
    shown = []
    total = 0
    for end, index in ((0, 0), (1, -1)):
        counts = [one[end] for one in ends]
        at = {float(one[index]) for one in values}
        if sum(count > 0 for count in counts) >= need and len(at) == 1:
            shown.append(f"{at.pop():.4g} {unit}")
            total += sum(counts)
    if shown:
        share = total / n
        yield DataCheck(
            "clipped",
            "bad" if share >= BAD_CLIPPED else "warning",
            f"{share:.2%} of the samples are exactly {' or '.join(shown)}, and none is beyond: the values "
            "are clipped there.",
            "Something limits the values: a setting, a filter or the number format. Take the limit off, or "
            "choose a larger range, and record again.",
        )
