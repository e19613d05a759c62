"""Values that samples of a sensor do not have so often: a dead band, one value in place of others, clipping.

Each part of a record is looked at by itself. The values that differ are counted in order. Of noise, rounded
or not, neighbours in that order are about as frequent, but for the few values that rounding to coarse counts
leaves: these are told from the middle of the noise by how far most other samples are away from them.
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
"""Parts of the record, and how many of them have to show it: a record of rest and motion has values that
are frequent in one of them."""
LEAST, LEAST_OF_ALL = 500, 100
"""Samples of a part, and of a record that is one part."""
NEIGHBOURS = 3
"""Values on either side that tell how far values are apart."""
OFTEN = 20
"""Least number of times that the samples reach a value. A sensor that is stuck once is another data check."""
TOO_OFTEN, BESIDE_A_GAP = 3.0, 2.0
"""Samples of a value over those of its neighbours, by itself and beside a gap."""
GAP = 1.75
"""Distance to the next values, over what is usual nearby."""
AWAY = 3.0
"""Distances to the next value by which the middle one of all other samples is away."""
LEAST_SHARE, BAD_SHARE = 0.002, 0.05
"""Share of samples that have the value by no chance: of less nobody needs to know, of more N is wrong."""
BAD_POWER = 0.01
"""Share of the power that a dead band takes away, from which on N is wrong."""
CLIPPED = 2.0
"""Samples of the last value over what the values before it let expect."""
SURELY, BAD_CLIPPED = 6.0, 0.01
"""Standard deviations of the count of a last value by which it is too many, and the share of all samples
from which on N is wrong."""
SHORTEST_STAY = 10.0
"""Samples at one value or level, in the mean. What stays for less is rounded, or sensors by turns."""
FEW_VALUES, BEGIN = 3, 1000
"""So many values are few; samples at the beginning of a record that mostly have more."""
REMEDY = (
    "A driver, a filter or the sensor itself puts one value in place of others (a dead band, zero for a "
    "failed read): switch that off and record again. Of the noise that it hides nothing can be said."
)


HIDE = "dead band", "common value", "few values"
"""Kinds of data checks that explain why neighbours are equal so often."""


class _Values(NamedTuple):
    """The values of a part in order, and how many samples have each."""

    values: Array
    counts: NDArray[np.int64]


class _Common(NamedTuple):
    """A value that is too frequent; gap: to the next one, where none is as near as usual, else 0."""

    value: float
    share: float
    gap: float
    is_bad: bool


def value_data_checks(y: Array, unit: str) -> Iterator[DataCheck]:
    """Yield what the values of samples y (n,), in this unit, show."""
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
    """Return the data check of samples (n,) that have a few values only, and stay at each for long."""
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
        f"There are only {len(values)} values, {names} {unit}, one after the other for "
        f"{len(y) / int(stays.sum()):.3g} samples in the mean: steps between levels (telegraph noise), or "
        "counts that are too coarse. Noise about them cannot be seen.",
        "Choose a smaller range of the sensor, and write all its decimals. If it does step between levels, "
        "it is defective.",
    )


def _common(part: Array, of: _Values) -> _Common | None:
    """Return the most frequent value, if it is too frequent."""
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
        # What was in the band had the mean square gap²/3.
        return _Common(float(values[at]), share, gap, share * gap**2 / 3 >= BAD_POWER * float(part.var()))
    away = float(np.median(np.abs(part[~is_it] - values[at])))
    if counts[at] >= TOO_OFTEN * beside and away >= AWAY * gap:
        return _Common(float(values[at]), share, 0.0, share >= BAD_SHARE)
    return None


def _came(is_it: NDArray[np.bool_]) -> int:
    """Return how often samples come to a value; is_it: which samples have it."""
    return int(np.count_nonzero(is_it[1:] & ~is_it[:-1]))


def _too_frequent(common: list[_Common], unit: str) -> Iterator[DataCheck]:
    share = float(np.mean([one.share for one in common]))
    value, gap = common[0].value, float(np.median([one.gap for one in common]))
    if gap:
        kind, what = "dead band", f", and none is nearer to it than {gap:.3g} {unit}: a dead band"
    else:
        kind, what = "common value", ", far more than have values near it"
    yield DataCheck(
        kind,
        "bad" if 2 * sum(one.is_bad for one in common) > len(common) else "warning",
        f"{share:.2%} of the samples are exactly {value:.4g} {unit}{what}."
        if share < 0.01
        else f"{share:.0%} of the samples are exactly {value:.4g} {unit}{what}.",
        REMEDY,
    )


def _at_end(part: Array, of: _Values, end: int) -> int:
    """Return how many samples of a part are clipped at the highest value (1) or the lowest (-1)."""
    counts = of.counts[::-end] if end > 0 else of.counts
    if len(counts) < 4:
        return 0
    last, before, third = counts[:3].tolist()
    # Tails fall at least as fast as an exponential does, so from the two before the last is at most that.
    most = max(before, before * before / third)
    if last < OFTEN or last <= CLIPPED * most or last <= most + SURELY * math.sqrt(most + last):
        return 0
    return int(last) if _came(part == of.values[-1 if end > 0 else 0]) >= OFTEN else 0


def _clipped(
    ends: list[tuple[int, int]], values: list[Array], need: int, n: int, unit: str
) -> Iterator[DataCheck]:
    """Yield the data check of clipped values. ends: of each part, samples at the lowest and the highest.

    need: in how many parts it has to be seen. n: samples of all parts.
    """
    shown = []
    total = 0
    for end, place in ((0, 0), (1, -1)):
        counts = [one[end] for one in ends]
        at = {float(one[place]) for one in values}
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
