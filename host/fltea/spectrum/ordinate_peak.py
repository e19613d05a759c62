"""Search the ordinates of a periodogram for the most significant peak.

A peak is a range of neighbouring ordinates whose mean is far above the means of its flanks, the ordinates on
both sides. Where the spectrum is flat, the ratio of a range's mean to that of a flank has an F distribution,
whatever the level of the spectrum is. Ranges of 1, 2, 4, ... ordinates are tried. The rate of false alarms is
divided by the number of trials (Bonferroni).

At the ends of the band, a flank is short (near 0 Hz) or missing (at the Nyquist frequency). There the search
finds only narrow lines, and humps at the Nyquist frequency itself. For a line near the Nyquist frequency, the
level follows from the lower flank alone. If the spectrum rises within this flank, the level is extrapolated:
that of the flank's upper half is multiplied by the ratio of the upper half to the lower half.

host/native/octave_peak.hpp does the same for values that are averages of different numbers of ordinates.
There are two programs, since their tasks differ. A file of a day has millions of ordinates. They are searched
here, in blocks, with the exact F distribution. A live spectrum has a few hundred values, which are searched
every second.
"""

import functools
import math

import numpy as np
from numpy.typing import NDArray

from fltea.noise.distributions import f_log_tail
from fltea.records.arrays import Array
from fltea.spectrum.periodogram import AT_ONCE

FLANK = 48
"""A flank is the ordinates on one side of a range that may be a peak. This is the number of ordinates in the
shortest flank. The flanks of a wide range are twice as long as the range.
"""
SHORTEST_FLANK = 4
"""Near frequency 0, the lower flank has at least this many ordinates."""
END_WIDTHS = (1, 2, 4)
"""At the ends of the band, ranges of these widths [ordinates] are searched for a peak."""
SURELY_NOT = 4.0
"""A quick test comes before the exact one. It computes how probable so high a range is by chance, as if the
level around the range were exactly known. The logarithm of this probability differs by at most SURELY_NOT
from the exact one. So only ranges that are certainly not significant are left out before the exact test.
"""
WIDEST_SHARE = 0.08
"""The widest range that is tried has this proportion of all ordinates."""
FOLDED_SHARE, FOLDED_HEIGHT, FLAT = 0.04, 5.0, 1.3
"""Limits for a hump (a wide peak) at the Nyquist frequency. FOLDED_SHARE: its width is at most this
proportion of all ordinates. FOLDED_HEIGHT: its mean is at least this many times the level of its flank, the
ordinates below it. FLAT: the level in the flank's upper half is at most this many times that in its lower
half. So noise that alternates in sign is no hump: its spectrum rises slowly towards the Nyquist frequency.
"""
LEAST_LEVEL = 1e-12
"""The level around a peak is at least this many times the mean of all ordinates. A smaller level, such as 0
in simulated noise, is replaced by this limit.
"""


def strongest_ordinates(power: Array, false_alarm: float) -> tuple[int, int, float] | None:
    """Return begin and end of the most significant peak, and the level around it.

    Return None if no peak is significant.
    """
    m = len(power)
    sums = np.zeros(m + 1)
    np.cumsum(power, out=sums[1:])
    widths = [1 << i for i in range(int(math.log2(max(WIDEST_SHARE * m, 1))) + 1)]
    best = _at_the_ends(sums, false_alarm / 2)
    folded = _at_nyquist(sums, false_alarm / 4)
    if folded is not None and (best is None or folded[0] > best[0]):
        best = folded
    false_alarm /= 4
    for width in widths:
        flank, guard = max(FLANK, 2 * width), width
        first, last = flank + guard, m - flank - guard - width
        if last <= first:
            break
        step = max(1, width // 4)
        top: tuple[float, int, float] = (-math.inf, 0, 0.0)
        for begin in range(first, last, step * AT_ONCE):
            at = np.arange(begin, min(last, begin + step * AT_ONCE), step)
            mean = (sums[at + width] - sums[at]) / width
            before = (sums[at - guard] - sums[at - guard - flank]) / flank
            after = (sums[at + width + guard + flank] - sums[at + width + guard]) / flank
            level = np.maximum(before, after)
            ratio = mean / np.maximum(level, LEAST_LEVEL * sums[-1] / m)
            i = int(ratio.argmax())
            if ratio[i] > top[0]:
                top = float(ratio[i]), int(at[i]), float(level[i])
        highest, place, around = top
        tried = len(range(first, last, step))
        log_p = f_log_tail(highest, 2 * width, 2 * flank) + math.log(len(widths) * tried)
        # Of all significant ranges, the one with the highest likelihood as a peak (`gain`) is chosen. The
        # likelihood is computed as if the level around the range were exactly known. Their `log_p` is not
        # compared: it is lower for wide ranges, since these have longer flanks.
        gain = width * (highest - 1 - math.log(highest)) if highest > 0 else -math.inf
        if log_p < math.log(false_alarm) and (best is None or gain > best[0]):
            best = gain, place, place + width, around
    return None if best is None else best[1:]


def _at_the_ends(sums: Array, false_alarm: float) -> tuple[float, int, int, float] | None:
    """Return the most likely spectral line at an end of the band, where a flank is too short or missing.

    The result is its gain in log likelihood, its begin and end, and the level around it.
    """
    m = len(sums) - 1
    at, width = _end_tries(m)
    if not len(at):
        return None
    least = LEAST_LEVEL * sums[-1] / m
    one_sided = at >= m - FLANK - 2 * width
    half = np.where(one_sided, FLANK // 2, FLANK)
    begin = np.maximum(at - width - half, 0)
    below = np.maximum((sums[at - width] - sums[begin]) / (at - width - begin), least)
    further = np.where(one_sided, (sums[begin] - sums[np.maximum(begin - half, 0)]) / half, 0.0)
    rising = np.where(further > 0, below / np.where(further > 0, further, 1.0), 1.0)
    next_ = np.minimum(at + 2 * width, m)
    above = np.maximum((sums[np.minimum(next_ + FLANK, m)] - sums[next_]) / FLANK, least)
    above[one_sided] = 0.0
    below *= np.maximum(rising, 1.0)
    level = np.maximum(below, above)
    ratio = np.maximum((sums[at + width] - sums[at]) / width / level, 1.0)
    gain = width * (ratio - 1 - np.log(ratio))
    needed = math.log(len(at) / false_alarm)
    for i in np.argsort(-gain)[: np.count_nonzero(gain > needed - SURELY_NOT)].tolist():
        mean, wide = float(ratio[i] * level[i]), int(width[i])
        # The range is compared with each flank separately, since a short flank is more often low by chance.
        flanks = [(float(below[i]), int(at[i] - width[i] - begin[i])), (float(above[i]), FLANK)]
        log_p = max(f_log_tail(mean / one, 2 * wide, 2 * many) for one, many in flanks if one > 0)
        if log_p < -needed:
            return float(gain[i]), int(at[i]), int(at[i]) + wide, float(level[i])
    return None


def _at_nyquist(sums: Array, false_alarm: float) -> tuple[float, int, int, float] | None:
    """Return the most likely hump at the Nyquist frequency, as `_at_the_ends` returns a line.

    Mains hum of 50 Hz makes such a hump if the sample rate is 100 Hz. Noise whose spectrum rises towards the
    Nyquist frequency rises by far less within so few ordinates.
    """
    m, best = len(sums) - 1, None
    widths = [1 << i for i in range(2, int(math.log2(max(FOLDED_SHARE * m, 1))) + 1)]
    for width in widths:
        flank, begin = max(FLANK, 2 * width), m - width
        end = begin - width
        if end - flank < FLANK:
            break
        level = max(float(sums[end] - sums[end - flank]) / flank, LEAST_LEVEL * sums[-1] / m)
        further = float(sums[end - flank // 2] - sums[end - flank]) / (flank // 2)
        ratio = float(sums[m] - sums[begin]) / width / level
        if ratio < FOLDED_HEIGHT or 2 * level - further > FLAT * further:
            continue
        gain = width * (ratio - 1 - math.log(ratio))
        log_p = f_log_tail(ratio, 2 * width, 2 * flank) + math.log(len(widths))
        if log_p < math.log(false_alarm) and (best is None or gain > best[0]):
            best = gain, begin, m, level
    return best


@functools.lru_cache(maxsize=8)
def _end_tries(m: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the ranges of ordinates near the ends of the band that may be peaks.

    The band has m ordinates. The result is the index of each range's first ordinate, and its width in
    ordinates.
    """
    tries = [
        (at, width)
        for width in END_WIDTHS
        for at in (
            *range(SHORTEST_FLANK + width, min(FLANK + width, m - FLANK - 2 * width)),
            *range(max(m - FLANK - 2 * width, FLANK + width), m - width + 1),
        )
    ]
    at, width = np.array(tries, dtype=np.intp).reshape(-1, 2).T
    return at, width
