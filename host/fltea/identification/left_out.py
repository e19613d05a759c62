"""What a look at the spectrum leaves out: samples in motion; and where it breaks off: at steps of the bias.

To the look both are gaps: what was left out counts as lost, and nothing is computed across a step.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fltea.identification.gaps import Gaps
from fltea.identification.load import Series

SAME = 256
"""Samples by which steps and motion may be elsewhere without another look: they are not known better."""


class LeftOut(NamedTuple):
    """Samples begin … end - 1 of each motion, and the first sample after each step, in the order of time."""

    moved: tuple[tuple[int, int], ...] = ()
    steps: tuple[int, ...] = ()

    def is_like(self, other: "LeftOut") -> bool:
        """Whether a look that leaves this out says the same as one that leaves out the other."""
        mine, its = ([*one.steps, *(edge for span in one.moved for edge in span)] for one in (self, other))
        same = len(self.steps) == len(other.steps) and len(self.moved) == len(other.moved)
        return same and all(abs(a - b) <= SAME for a, b in zip(mine, its, strict=True))


NOTHING = LeftOut()


def without(series: Series, out: LeftOut) -> Series:
    """Return the samples that a look takes, with gaps where it leaves samples out or breaks off."""
    if out == NOTHING:
        return series
    rest = np.ones(len(series.y), dtype=bool)
    for begin, end in out.moved:
        rest[begin:end] = False
    y, kept = series.y[rest], np.cumsum(rest)
    # Between the samples that are kept: how many lost or moved; 0 where nobody knows, or at a step.
    lost: dict[int, int] = {}
    breaks = {_place(kept, at) for at in out.steps}
    for at, missing in zip(series.gaps.at.tolist(), series.gaps.missing.tolist(), strict=True):
        place = _place(kept, at)
        lost[place] = lost.get(place, 0) + missing
        if missing == 0:
            breaks.add(place)
    for begin, end in _joined(out.moved):
        place = _place(kept, begin)
        lost[place] = lost.get(place, 0) + end - begin
    at = np.array(sorted(one for one in {*lost, *breaks} if 0 < one < len(y)), dtype=np.int64)
    missing = np.array([0 if one in breaks else lost[one] for one in at.tolist()], dtype=np.int64)
    return series._replace(y=y, gaps=Gaps(at, missing))


def _place(kept: NDArray[np.int64], at: int) -> int:
    """Return the number of samples that are kept before the sample `at`."""
    return int(kept[at - 1]) if at else 0


def _joined(spans: Sequence[tuple[int, int]]) -> list[tuple[int, int]]:
    """Return spans in order, of which none overlaps another."""
    found: list[tuple[int, int]] = []
    for begin, end in sorted(spans):
        low = max(begin, found[-1][1]) if found else begin
        if low < end:
            found.append((low, end))
    return found
