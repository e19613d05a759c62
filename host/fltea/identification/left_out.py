"""Leave samples in motion out of the spectral analysis, and break the record at steps of the bias.

Both act as gaps: samples in motion count as lost, and nothing is computed across a step.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fltea.identification.gaps import Gaps
from fltea.identification.load import Series

SAME = 256
"""After an analysis, the tracker finds steps and motion. If one of them lies more than this number of samples
from where the analysis left it out, the axis is analysed anew.

The times of steps and motion are not known any better than this.
"""


class LeftOut(NamedTuple):
    """What an analysis leaves out: samples in motion, and steps of the bias, in order of time.

    Motion is given as spans of samples begin … end - 1, steps as the first sample after each step.
    """

    moved: tuple[tuple[int, int], ...] = ()
    steps: tuple[int, ...] = ()

    def is_like(self, other: "LeftOut") -> bool:
        """Whether leaving out `self` gives the same result of the analysis as leaving out `other`."""
        mine, its = ([*one.steps, *(edge for span in one.moved for edge in span)] for one in (self, other))
        same = len(self.steps) == len(other.steps) and len(self.moved) == len(other.moved)
        return same and all(abs(a - b) <= SAME for a, b in zip(mine, its, strict=True))


NOTHING = LeftOut()


def without(series: Series, out: LeftOut) -> Series:
    """Return the samples to analyse. They have gaps where samples were left out, and at steps."""
    if out == NOTHING:
        return series
    rest = np.ones(len(series.y), dtype=bool)
    for begin, end in out.moved:
        rest[begin:end] = False
    y, kept = series.y[rest], np.cumsum(rest)
    # For each index among the remaining samples: the number of samples lost or left out just before it. In
    # `Gaps`, this number becomes 0 at steps and where it is not known.
    lost: dict[int, int] = {}
    breaks = {_place(kept, at) for at in out.steps}
    for at, missing in zip(series.gaps.at.tolist(), series.gaps.missing.tolist(), strict=True):
        index = _place(kept, at)
        lost[index] = lost.get(index, 0) + missing
        if missing == 0:
            breaks.add(index)
    for begin, end in _joined(out.moved):
        index = _place(kept, begin)
        lost[index] = lost.get(index, 0) + end - begin
    at = np.array(sorted(one for one in {*lost, *breaks} if 0 < one < len(y)), dtype=np.int64)
    missing = np.array([0 if one in breaks else lost[one] for one in at.tolist()], dtype=np.int64)
    return series._replace(y=y, gaps=Gaps(at, missing))


def _place(kept: NDArray[np.int64], at: int) -> int:
    """Return the index of sample `at` among the kept samples; that of the next kept one if it is left out."""
    return int(kept[at - 1]) if at else 0


def _joined(spans: Sequence[tuple[int, int]]) -> list[tuple[int, int]]:
    """Return the spans in rising order without overlaps: each begins no earlier than the last one ends."""
    found: list[tuple[int, int]] = []
    for begin, end in sorted(spans):
        low = max(begin, found[-1][1]) if found else begin
        if low < end:
            found.append((low, end))
    return found
