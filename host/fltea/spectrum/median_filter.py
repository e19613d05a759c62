"""Detect that samples have passed through a median filter, which no part of a noise model describes.

The median of the last w samples is one of these samples. It often equals the previous median. It may also
equal a median up to w - 1 samples earlier, with other values in between. White noise that has passed through
a linear filter never repeats values in this way if its numbers are not rounded. Rounded numbers do repeat
values by chance, but this can be allowed for: the second of two samples equals the first about as often as it
is one rounding step higher.
"""

from typing import NamedTuple

import numpy as np

from fltea.records.arrays import Array

GLIMPSE, LEAST_SHARE = 8192, 0.01
"""The first GLIMPSE samples are examined first. If the proportion of them that equal the sample before is
less than LEAST_SHARE, there is no median filter.
"""
MOST = 1 << 17
"""Largest number of samples that are examined."""
LONGEST = 31
"""The longest window of a median filter that can be detected, in samples."""
SURE = 6.0
"""Repeated values are significant if their number minus the number that rounding explains exceeds this many
standard deviations.
"""
ROUNDED, ROUNDED_BETWEEN = 1.5, 1.25
"""Rounded samples also equal each other by chance. That is at most this many times as frequent as a
difference of one rounding step upwards. ROUNDED holds for any two samples. ROUNDED_BETWEEN holds for two
samples with another value in between, which are equal less often.
"""
FINE = 1.5
"""A difference of fewer rounding steps than this counts as a difference of one step. If most differences
other than 0 are that small, the numbers are so coarsely rounded that repeated values say nothing.
"""
ONE_VALUE = 0.5
"""If more than this proportion of the repeats are repeats of the same value, their cause is a dead band or a
stuck value, and not a median filter.
"""
REPLACES = 0.2
"""If a smaller proportion of samples than this equals the sample before, the filter replaced only outliers by
medians.
"""

SHAPED, ENOUGH = 0.1, 128
"""SHAPED: frequencies are fitted if their product with the length of the filter's window is at most this.
There the filter lowers the power by at most a twentieth. ENOUGH: at least this many ordinates are fitted,
even if the limit of some of them is exceeded.
"""


class MedianFilter(NamedTuple):
    """A median filter that was detected in samples."""

    samples: int
    """Approximate length of the filter's window, in samples."""
    share: float
    """Proportion of samples that equal the sample before, minus the proportion that rounding explains."""

    @property
    def replaces_outliers(self) -> bool:
        """Whether the filter replaced only some samples by medians, as a Hampel filter does."""
        return self.share < REPLACES

    def shaped_hz(self, h: float, duration_s: float) -> tuple[float, float]:
        """Return the band (low, high) [Hz] in which the filter shapes the spectrum.

        `h`: sampling period [s].
        """
        return max(SHAPED / (self.samples * h), ENOUGH / duration_s), 1 / h

    @property
    def words(self) -> str:
        """Words that describe the filter, as part of a sentence of the verdict."""
        if self.replaces_outliers:
            return f"a filter that replaces outliers by the median of about {self.samples} samples (Hampel's)"
        return f"a median filter of about {self.samples} samples"


def find_median_filter(y: Array) -> MedianFilter | None:
    """Return the median filter through which the samples `y` (n,) have passed; None if none was found."""
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
        # If values repeat at every lag, no filter is the cause. The values were rounded coarsely, and two
        # different offsets were added after that. So the smallest difference of values, which is `quantum`,
        # is smaller than the rounding step.
        return None
    return MedianFilter((longest + 1) | 1, excess[0][0])


def _smallest(apart: Array) -> float:
    """Return the rounding step of numbers: the smallest of their differences `apart` other than 0."""
    return float(np.min(apart, where=apart > 0, initial=np.inf))


def _of_one_value(y: Array) -> bool:
    repeated = y[1:][y[1:] == y[:-1]]
    return bool(np.unique(repeated, return_counts=True)[1].max(initial=0) > ONE_VALUE * len(repeated))


def _excess(y: Array, lag: int, quantum: float) -> tuple[float, bool]:
    """Return the proportion of values that repeat after `lag` samples and that rounding does not explain.

    Also return whether this proportion is significant. `quantum`: the rounding step.
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
    """Return whether values return after exactly one other value significantly often.

    In samples that a sensor merely repeats, values never return in this way.
    """
    between = y[1:-1] != y[2:]
    apart = np.abs(y[2:] - y[:-2])[between]
    same = int(np.count_nonzero(apart == 0))
    near = int(np.count_nonzero(apart < FINE * quantum)) - same
    return _over(same, ROUNDED_BETWEEN * near / 2, len(apart))[1]
