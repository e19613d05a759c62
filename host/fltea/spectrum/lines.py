"""Narrow lines and broad resonances in a periodogram, with a known rate of false alarms (pure).

A peak is a stretch of ordinates whose mean is too far above the means of the flanks on both sides of it.
Where the spectrum is flat the ratio to one flank has an F distribution, whatever its level, and where it
slopes one of the flanks is higher. Stretches of 1, 2, 4, ... ordinates are tried; the rate of false alarms is
shared out among all that are tried (Bonferroni).

At the ends of the band only lines are searched for. Near 0 the lower flank is as short as it has to be. At
Nyquist's frequency there is a lower one only: its level is continued as it rises from one half to the other.
"""

import math

import msgspec
import numpy as np

from fltea.noise.distributions import f_log_tail
from fltea.records.arrays import Array
from fltea.spectrum.periodogram import AT_ONCE, Periodogram
from fltea.spectrum.side_lobes import TELLING, lines_among_lobes, notch_below

FALSE_ALARM = 3e-3
"""Probability to find anything in noise without lines, of a record that is looked at once."""
FLANK = 48
"""Ordinates in the shortest flank; the flanks of wide stretches are twice as long as these."""
MOST = 12
"""Peaks after which the search ends: a record with more has other troubles."""
SMOOTHEST = 9
"""Ordinates that are averaged at least to see whether a hump is a side lobe."""
LINE_SKIRT = 3
"""Ordinates on both sides of a line among side lobes that are left out with it."""
SHORTEST_FLANK = 4
"""Near frequency 0."""
END_WIDTHS = (1, 2, 4)
"""Widths of stretches at the ends of the band."""
WIDEST_SHARE = 0.08
"""The widest stretch, as a share of all ordinates."""
LEAST_LEVEL = 1e-12
"""The least level over the mean, which stands for a level of 0, as made-up noise may have it."""
LINE_ORDINATES = 6
"""What has nearly all its power in so many is a line: an oscillation that stays in phase over the record."""
IN_A_LINE = 0.7
"""Share of the power: the rest is the noise about it."""


class Peak(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A line, or a resonance."""

    kind: str
    """Line or resonance; peak, where the resolution cannot tell."""
    frequency_hz: float
    """Where it is highest, the resonance after smoothing."""
    width_hz: float
    """The width at half its height above the surroundings."""
    power_share: float
    """Its share of all power in the ordinates used."""
    height: float
    """Its mean over the level around it."""
    notch_hz: tuple[float, float]
    """The band to leave out to be rid of it."""


def find_peaks(p: Periodogram, false_alarm: float = FALSE_ALARM) -> tuple[Peak, ...]:
    """Find the peaks of one series, strongest first; each is taken out before the next is searched for."""
    return _search(p, float(p.power.sum()), false_alarm)


def _search(p: Periodogram, total: float, false_alarm: float) -> tuple[Peak, ...]:
    """Return the peaks of the ordinates of p; total: power of all that there were."""
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
    """Return where the most striking stretch begins and ends, and the level around it; None if none is."""
    m = len(power)
    sums = np.zeros(m + 1)
    np.cumsum(power, out=sums[1:])
    widths = [1 << i for i in range(int(math.log2(max(WIDEST_SHARE * m, 1))) + 1)]
    best = _at_the_ends(sums, false_alarm / 2)
    false_alarm /= 2
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
        # Of stretches that pass the likeliest is taken, as if the level were known: probabilities would
        # favour the wide ones, whose flanks are longer.
        gain = width * (highest - 1 - math.log(highest)) if highest > 0 else -math.inf
        if log_p < math.log(false_alarm) and (best is None or gain > best[0]):
            best = gain, place, place + width, around
    return None if best is None else best[1:]


def _at_the_ends(sums: Array, false_alarm: float) -> tuple[float, int, int, float] | None:
    """Return gain, begin, end and surrounding level of the likeliest line that is too near to an end."""
    m = len(sums) - 1
    tries = [
        (at, width)
        for width in END_WIDTHS
        for at in (
            *range(SHORTEST_FLANK + width, min(FLANK + width, m - FLANK - 2 * width)),
            *range(max(m - FLANK - 2 * width, FLANK + width), m - width + 1),
        )
    ]
    best = None
    for at, width in tries:
        mean = float(sums[at + width] - sums[at]) / width
        one_sided = at >= m - FLANK - 2 * width
        half = FLANK // 2 if one_sided else FLANK
        flanks = [(max(at - width - half, 0), at - width)]
        if not one_sided:
            flanks.append((at + 2 * width, at + 2 * width + FLANK))
        levels = [max(float(sums[b] - sums[a]) / (b - a), LEAST_LEVEL * sums[-1] / m) for a, b in flanks]
        if one_sided:
            begin = flanks[0][0]
            levels = [continued(levels[0], float(sums[begin] - sums[begin - half]) / half)]
        ratio = mean / max(levels)
        gain = width * (ratio - 1 - math.log(ratio)) if ratio > 1 else -math.inf
        if ratio <= 1 or (best is not None and gain <= best[0]):
            continue
        # Each of them by itself: a short one is low by luck more often.
        log_p = max(
            f_log_tail(mean / level, 2 * width, 2 * (b - a))
            for (a, b), level in zip(flanks, levels, strict=True)
        )
        if log_p + math.log(len(tries)) < math.log(false_alarm):
            best = gain, at, at + width, max(levels)
    return best


def continued(near: float, far: float) -> float:
    """Return the level that goes on to rise as it does from far to near."""
    return near * max(near / far, 1.0) if far > 0 else near


def _extent(power: Array, start: int, stop: int, level: float) -> tuple[int, int]:
    """Return the stretch with its skirts: as far as pieces of half its width are above the level."""
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
    if _in_few_ordinates(part - level, sharp):  # smoothing would widen it
        top, wide = sharp, min(wide, LINE_ORDINATES)
    return Peak(
        kind="line" if wide <= LINE_ORDINATES else "resonance",
        frequency_hz=float(lam[left + top] * to_hz),
        width_hz=wide / (p.n * p.h),
        power_share=float((part - level).sum() / total),
        height=float(power[core[0] : core[1]].mean() / level),
        notch_hz=(float(lam[left] * to_hz), float(lam[right - 1] * to_hz)),
    )


def _in_few_ordinates(excess: Array, top: int) -> bool:
    """Return whether nearly all of a peak's power is about its top."""
    half = LINE_ORDINATES // 2
    near = float(excess[max(top - half, 0) : top + half + 1].sum())
    return near > IN_A_LINE * float(excess.sum())
