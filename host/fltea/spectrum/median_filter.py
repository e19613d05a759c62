"""Detect a median filter, which no part of the noise model describes.

The median of the last w samples is one of these samples. It often equals the previous median, or a median up
to w - 1 samples ago with other values in between. White noise through a linear filter never repeats values
so, if its numbers are not rounded. If they are rounded, a difference of 0 is about as frequent as a
difference of one step, since the differences have a smooth distribution.
"""

from typing import NamedTuple

import numpy as np

from fltea.records.arrays import Array

GLIMPSE, LEAST_SHARE = 8192, 0.01
"""The first GLIMPSE samples are examined first; at least LEAST_SHARE of them must equal their predecessor."""
MOST = 1 << 17
"""Largest number of samples that are examined."""
LONGEST = 31
"""The longest window that can be detected, in samples."""
SURE = 6.0
"""The excess of repeated values over those by rounding is significant from this many standard deviations
on."""
ROUNDED, ROUNDED_BETWEEN = 1.5, 1.25
"""For a smooth distribution, the largest ratio of the number of differences of 0 to the number of differences
of one step on either side: ROUNDED in general, ROUNDED_BETWEEN with another value in between, which makes a
difference of 0 less likely."""
FINE = 1.5
"""Steps that half of all differences have at least: coarser numbers are the same for no other reason."""
ONE_VALUE = 0.5
"""If the commonest value has this share of the repeats, the cause is a dead band or a stuck value."""
REPLACES = 0.2
"""If fewer values than this share equal their predecessor, the filter replaced only outliers."""

SHAPED, ENOUGH = 0.1, 128
"""SHAPED: frequency times window length up to which the filter lowers the power by at most a twentieth.
ENOUGH: ordinates below that frequency; only these are fitted if the record is long enough to have ENOUGH."""


class MedianFilter(NamedTuple):
    """A median filter that was detected in samples."""

    samples: int
    """The length of the filter's window in samples, approximately."""
    share: float
    """Share of samples that equal their predecessor, beyond what rounding explains."""

    @property
    def replaces_outliers(self) -> bool:
        """Whether the filter replaced only some samples by medians, as a Hampel filter does."""
        return self.share < REPLACES

    def shaped_hz(self, h: float, duration_s: float) -> tuple[float, float]:
        """Return the band (low, high) [Hz] where the filter shapes the spectrum; `h`: sampling period [s]."""
        return max(SHAPED / (self.samples * h), ENOUGH / duration_s), 1 / h

    @property
    def words(self) -> str:
        """Words for the filter, as a part of a sentence."""
        if self.replaces_outliers:
            return f"a filter that replaces outliers by the median of about {self.samples} samples (Hampel's)"
        return f"a median filter of about {self.samples} samples"


def find_median_filter(y: Array) -> MedianFilter | None:
    """Return the median filter that `y` (n,) has passed through, or None."""
    y = np.asarray(y, dtype=np.float64)
    some = y[:GLIMPSE]
    if len(some) < 2 * LONGEST or np.count_nonzero(some[1:] == some[:-1]) < LEAST_SHARE * len(some):
        return None
    quantum = _smallest(np.abs(np.diff(some)))
    if not (_excess(some, 1, quantum)[1] or _excess(some, 2, quantum)[1]) or _of_one_value(some):
        return None
    values = y[:MOST]
    quantum = _smallest(np.abs(np.diff(values)))
    if not _returns(values, quantum):
        return None
    excess = [_excess(values, lag, quantum) for lag in range(1, LONGEST)]
    # Values repeat at all lags up to the length of the filter's window.
    longest = 0
    while longest < len(excess) and (excess[longest][1] or longest == 0):
        longest += 1
    if longest == len(excess):
        return None  # rounded values shifted later by two offsets repeat at any lag
    return MedianFilter((longest + 1) | 1, excess[0][0])


def _smallest(apart: Array) -> float:
    """Return the smallest difference other than 0, which is the step of rounded numbers."""
    return float(np.min(apart, where=apart > 0, initial=np.inf))


def _of_one_value(y: Array) -> bool:
    repeated = y[1:][y[1:] == y[:-1]]
    return bool(np.unique(repeated, return_counts=True)[1].max(initial=0) > ONE_VALUE * len(repeated))


def _excess(y: Array, lag: int, quantum: float) -> tuple[float, bool]:
    """Return the share of values that repeat after `lag` samples beyond what rounding causes.

    Also return whether that share is significant.
    """
    apart = np.abs(y[lag:] - y[:-lag])
    same = apart == 0
    others = apart[~same]
    near = int(np.count_nonzero(others < FINE * quantum))
    if 2 * near > len(others):
        return 0.0, False
    return _over(len(apart) - len(others), ROUNDED * near / 2, len(apart))


def _over(same: int, by_rounding: float, count: int) -> tuple[float, bool]:
    over = same - by_rounding
    return over / count, over > SURE * max(same + by_rounding, SURE**2) ** 0.5


def _returns(y: Array, quantum: float) -> bool:
    """Return whether values repeat with a different value in between; held samples never do that."""
    between = y[1:-1] != y[2:]
    apart = np.abs(y[2:] - y[:-2])[between]
    same = int(np.count_nonzero(apart == 0))
    near = int(np.count_nonzero(apart < FINE * quantum)) - same
    return _over(same, ROUNDED_BETWEEN * near / 2, len(apart))[1]
