"""Find narrow lines and broad resonances in a periodogram, with a known rate of false alarms.

A peak is a range of ordinates whose mean is too far above the means of the flanks on both sides of it. Where
the spectrum is flat, the ratio to a flank has an F distribution at any level. Where the spectrum slopes, one
of the flanks is higher. Ranges of 1, 2, 4, ... ordinates are tried; the rate of false alarms is divided by
the number of trials (Bonferroni).

At the ends of the band, the search finds lines only. Near 0 Hz the lower flank may be short. At the Nyquist
frequency there is only a lower flank: its level is extrapolated by its rise from the first half to the
second.
"""

import functools
import math
from typing import Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from fltea.noise.distributions import f_log_tail
from fltea.records.arrays import Array
from fltea.spectrum.periodogram import AT_ONCE, Periodogram
from fltea.spectrum.side_lobes import TELLING, lines_among_lobes, notch_below

FALSE_ALARM = 3e-3
"""Probability of finding any peak in noise without peaks, in a record that is tested once."""
FLANK = 48
"""Ordinates in the shortest flank; the flanks of a wide range are twice as long as the range."""
MOST = 12
"""The search ends after this many peaks: a record with more has other problems."""
SMOOTHEST = 9
"""Fewest ordinates that are averaged to test whether a hump is a side lobe."""
LINE_SKIRT = 3
"""Number of ordinates on both sides of a line among side lobes that are left out with the line."""
SHORTEST_FLANK = 4
"""Fewest ordinates in the lower flank near frequency 0."""
END_WIDTHS = (1, 2, 4)
"""Widths of the ranges that are tried at the ends of the band."""
SURELY_NOT = 4.0
"""Largest difference between the log of a range's probability and that log for an exactly known level."""
WIDEST_SHARE = 0.08
"""The widest stretch, as a share of all ordinates."""
FOLDED_SHARE, FOLDED_HEIGHT, FLAT = 0.04, 5.0, 1.3
"""Limits for a hump at the Nyquist frequency: FOLDED_SHARE, its largest width as a share of all ordinates;
FOLDED_HEIGHT, its least mean over the level below it; FLAT, the largest ratio of the two halves of that
level. The last one excludes noise that alternates in sign, whose spectrum falls slowly."""
LEAST_LEVEL = 1e-12
"""Least level over the mean; it replaces a level of 0, as simulated noise may have it."""
LINE_ORDINATES = 6
"""A peak with nearly all its power in this many ordinates is a line: its phase is stable over the record."""
IN_A_LINE = 0.7
"""Share of a peak's power that counts as nearly all: the rest is noise around the line."""


class Repeats(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An event that repeats at equal intervals and causes a comb of lines."""

    period_s: float
    harmonics: int
    """Approximate number of lines of the event in the spectrum."""
    shape: Literal["glitch", "wave", "unknown"] = "unknown"
    """A glitch is much shorter than the period. Live sums do not show the shape: it is "unknown"."""
    duration_s: float | None = None
    """The length of a glitch."""
    deviations: float | None = None
    """The largest deviation over the standard deviation of the noise."""


class Peak(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A line, a resonance, or a comb of lines."""

    kind: str
    """Line or resonance; peak, where the resolution cannot distinguish the two; comb, for lines at all
    multiples of one frequency, which is `frequency_hz`."""
    frequency_hz: float
    """Frequency of the maximum; for a resonance, after smoothing."""
    width_hz: float
    """Width at half the peak's height above its surroundings."""
    power_share: float
    """The peak's share of all power in the ordinates in use."""
    height: float
    """The peak's mean power over the level around it."""
    notch_hz: tuple[float, float]
    """The band to leave out in order to remove the peak; for a comb, the band of its lowest line."""
    repeats: Repeats | None = None
    """The repeating event; only for a comb."""


def find_peaks(p: Periodogram, false_alarm: float = FALSE_ALARM) -> tuple[Peak, ...]:
    """Find the peaks of one series, strongest first; each peak is removed before the next search."""
    return _search(p, float(p.power.sum()), false_alarm)


def _search(p: Periodogram, total: float, false_alarm: float) -> tuple[Peak, ...]:
    """Return the peaks of the ordinates `p`; `total`: power of all ordinates before any peak was removed."""
    lam, power = p.lam, p.power
    peaks: list[Peak] = []
    while len(peaks) < MOST:
        found = _strongest(power, false_alarm)
        if found is None:
            break
        start, stop, level = found
        left, right = _extent(power, start, stop, level)
        peak = _describe(lam, power, (start, stop), (left, right), level, total, p)
        if peak.kind == "resonance" or peak.height < TELLING:
            edge = notch_below(lam, power, start, stop, SMOOTHEST)
            if edge is not None:
                return _with_stop_band(p, total, false_alarm, edge)
        peaks.append(peak)
        power = np.concatenate([power[:left], power[right:]])
        lam = np.concatenate([lam[:left], lam[right:]])
    return tuple(peaks)


def _with_stop_band(p: Periodogram, total: float, false_alarm: float, edge: float) -> tuple[Peak, ...]:
    """Return the peaks of a filter's pass band, and the lines of its stop band, which begins at `edge`."""
    begin = int(np.searchsorted(p.lam, edge))
    below, above = slice(0, begin), slice(begin, None)
    peaks = _search(p._replace(lam=p.lam[below], power=p.power[below]), total, false_alarm)
    lam, power = p.lam[above], p.power[above]
    lines = [
        _describe(
            lam, power, (a, b), (max(a - LINE_SKIRT, 0), min(b + LINE_SKIRT, len(lam))), level, total, p
        )
        for a, b, level in lines_among_lobes(power, FLANK)
    ]
    lines.sort(key=lambda line: -line.power_share)
    return (*peaks, *lines)[:MOST]


def _strongest(power: Array, false_alarm: float) -> tuple[int, int, float] | None:
    """Return begin and end of the most striking significant range, and the level around it; or None."""
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
        # Among the significant ranges the likeliest is taken, as if the level were known. A comparison of
        # probabilities would favour wide ranges, whose flanks are longer.
        gain = width * (highest - 1 - math.log(highest)) if highest > 0 else -math.inf
        if log_p < math.log(false_alarm) and (best is None or gain > best[0]):
            best = gain, place, place + width, around
    return None if best is None else best[1:]


def _at_the_ends(sums: Array, false_alarm: float) -> tuple[float, int, int, float] | None:
    """Return gain, begin, end and surrounding level of the likeliest line too close to an end for a flank."""
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
        # The flanks are tested separately, since a short flank is more often low by chance.
        flanks = [(float(below[i]), int(at[i] - width[i] - begin[i])), (float(above[i]), FLANK)]
        log_p = max(f_log_tail(mean / one, 2 * wide, 2 * many) for one, many in flanks if one > 0)
        if log_p < -needed:
            return float(gain[i]), int(at[i]), int(at[i]) + wide, float(level[i])
    return None


def _at_nyquist(sums: Array, false_alarm: float) -> tuple[float, int, int, float] | None:
    """Return gain, begin, end and surrounding level of the likeliest hump that ends at the Nyquist frequency.

    Mains at half of a sample rate of 100 Hz makes such a hump. Noise that rises towards the Nyquist frequency
    changes by less over so few ordinates.
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
    """Return the begins and the widths of the ranges to try near the ends of m ordinates."""
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


def _extent(power: Array, start: int, stop: int, level: float) -> tuple[int, int]:
    """Return the range of the peak with its skirts.

    A skirt ends where a piece of half the peak's width is no longer above the level.
    """
    piece = max(3, (stop - start) // 2)
    above = 1 + 2 / math.sqrt(piece)
    left, right = max(start - 1, 0), min(stop + 1, len(power))
    while left > piece and power[left - piece : left].mean() > above * level:
        left -= piece
    while right < len(power) - piece and power[right : right + piece].mean() > above * level:
        right += piece
    return left, right


def _describe(
    lam: Array,
    power: Array,
    core: tuple[int, int],
    extent: tuple[int, int],
    level: float,
    total: float,
    p: Periodogram,
) -> Peak:
    left, right = extent
    to_hz = 1 / (2 * math.pi * p.h)
    part = power[left:right]
    smooth = max(1, (core[1] - core[0]) // 4)
    smoothed = np.convolve(part, np.ones(smooth) / smooth, mode="same")
    top = int(smoothed.argmax())
    half = level + (smoothed[top] - level) / 2
    wide = int((smoothed > half).sum())
    sharp = int(part.argmax())
    if _in_few_ordinates(part - level, sharp):  # smoothing would widen a sharp peak
        top, wide = sharp, min(wide, LINE_ORDINATES)
    return Peak(
        kind="line" if wide <= LINE_ORDINATES else "resonance",
        frequency_hz=float(lam[left + top] * to_hz),
        width_hz=wide / (p.n * p.h),
        power_share=float((part - level).sum() / total),
        height=height_over(float(power[core[0] : core[1]].mean()), level),
        notch_hz=(float(lam[left] * to_hz), float(lam[right - 1] * to_hz)),
    )


def _in_few_ordinates(excess: Array, top: int) -> bool:
    """Return whether nearly all of a peak's power is close to its top."""
    half = LINE_ORDINATES // 2
    near = float(excess[max(top - half, 0) : top + half + 1].sum())
    return near > IN_A_LINE * float(excess.sum())


def height_over(power: float, level: float) -> float:
    """Return the peak's power over the noise level; infinite without noise, as in exactly periodic counts."""
    return power / level if level > 0 else math.inf
