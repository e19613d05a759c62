"""Is it white? A running test of the measurements, cheap enough to stand beside every live α.

FLTEA's own α has almost no power as a test (host/README.md, What α and f are worth). The likelihood ratio of
`fltea identify` has, but costs a fit. This one costs a few products a sample. The samples are summed in
blocks of 1, 4, 16, ... 16,384; of each level the correlations at lags 1 to 8 and the variance ratios over 4
and 8 blocks (sums of these correlations, with falling weights) are kept, each divided by its standard
deviation as it is without correlation, whatever the variance does meanwhile (Lo & MacKinlay, Rev. Financial
Studies 1 (1988) 41): neither heavy tails nor quantisation to a whole deviation change the false alarms, and
that to five deviations adds none. The largest magnitude is the statistic. Variance ratios see memory and
drift, correlations resonances and lines.
It covers all since the epoch began, start-up window included, and forgets nothing: a sensor that was once
moved is not white until the next epoch.

The largest of ten normal figures a level behaves like that of `EFFECTIVE` independent ones, which gives the
p-value at any one moment. It is looked at all the time, so the noise is called not white only below `LEVEL`.
Measured (tools/bench/running_null_tables.py):

- the p-value of white noise is below 5 % in 4.6 to 6.2 % of 1,000 series of 30 s and of 10 minutes, Gaussian,
  one LSB per deviation or t4;
- white noise has been called not white at least once in 1.8 % after 10 minutes and 2.8 % after an hour (of
  500 axes), and 4.7 % after a day (of 150);
- the power at 5 % is near that of the likelihood ratio: 83 % for α 0.3, f 0 in a tenth of the power, 30 s.

"Not white" is not "fractional": drift, resonances, filters and movement are not white either.

The sums are in host/native/running_null.hpp, and a part of `Bank`; here is the test for who has no bank.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fltea import _native
from fltea.records.null_p import LEVEL
from fltea.records.records import Whiteness

Array = NDArray[np.float64]

EFFECTIVE: int = _native.NULL_EFFECTIVE
CHUNK: int = _native.NULL_CHUNK
"""Its answers change with every so many samples."""


class Standing(NamedTuple):
    """p: how often white noise would look at least as unlike white, at one moment; None while not known."""

    p: float | None
    whiteness: Whiteness | None


class RunningNull:
    """The test of several axes that are sampled together.

    A lost sample takes the pairs and blocks that it belongs to with it; nothing is made up for it.
    """

    def __init__(self, axes: int) -> None:
        self._axes = axes
        self._native = _native.RunningNull(max(axes, 1))

    def add(self, y: Sequence[float]) -> None:
        """Take one sample of every axis, in any unit; `standings` change with every 128th."""
        self.add_rows(np.array([y], dtype=np.float64))

    def add_rows(self, y: Array) -> None:
        """Take samples, (n, axes), NaN where lost."""
        if self._axes:
            self._native.add(np.ascontiguousarray(y, dtype=np.float64))

    def skip(self, count: int) -> None:
        """Take note of lost samples."""
        self._native.skip(count)

    @property
    def standings(self) -> tuple[Standing, ...]:
        """What it says of each axis."""
        return tuple(_standing(p) for p in self._native.p()[: self._axes])

    @property
    def depth(self) -> int:
        """Levels that have enough pairs to count; 0 before `FEWEST` samples."""
        return self._native.depth()

    def largest(self) -> Array:
        """The statistic of every axis; NaN where an axis never changed, or nothing is known."""
        return np.array(self._native.largest()[: self._axes])

    def save(self) -> bytes:
        """All of it, for `restore`."""
        return self._native.save()

    @classmethod
    def restore(cls, axes: int, data: bytes) -> "RunningNull":
        """Go on from what `save` returned; ValueError if that is not sound, or had other axes."""
        result = cls(axes)
        result._native.load(data)
        return result


def p_value(largest: float, effective: int) -> float:
    """Probability that the largest magnitude of so many independent normal figures is no smaller."""
    single = math.erfc(largest / math.sqrt(2))
    return -math.expm1(effective * math.log1p(-single)) if single < 1 else 1.0


def _standing(p: float) -> Standing:
    if math.isnan(p):
        return Standing(None, None)
    return Standing(p, "rejected" if p < LEVEL else "not rejected")
