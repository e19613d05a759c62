"""Lines and resonances among the lines of octaves, which stand for different numbers of ordinates (pure).

As in `lines`, a peak is a stretch whose mean is too far above the means of the flanks on both sides. But most
lines are averages over blocks under Hann's window: they have more than two degrees of freedom each, and
neighbours are correlated, so that a stretch of a few has more for its width than a long one.
"""

import functools
import math
from bisect import bisect_left, bisect_right
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fltea.noise.distributions import f_deviate
from fltea.records.arrays import Array
from fltea.records.events import Ints
from fltea.spectrum.lines import (
    FALSE_ALARM,
    FLANK,
    LINE_ORDINATES,
    MOST,
    SMOOTHEST,
    WIDEST_SHARE,
    Peak,
    continued,
)
from fltea.spectrum.periodogram import Periodogram
from fltea.spectrum.side_lobes import TELLING, lines_among_lobes, notch_below

NEIGHBOURS = (4 / 9, 1 / 36)
"""Correlation of the power of Hann's lines with that of the next and of the one after."""
LOBE = 2
"""Lines on each side that a sharp line spreads to."""
SHORTEST_FLANK = 12
"""Lines in a flank, however many ordinates each of them stands for."""
LEAST_FLANK = 4
LEAST_IN_FLANK = 16.0
"""Lines and ordinates that a flank must have at the edge of the spectrum."""
END_FLANK = 4
"""Ordinates in the lower flank near frequency 0, of a line."""
END_WIDTHS = (1, 2)
"""Widths of stretches at the ends of the band, where only lines are searched for."""
CONTINUED = 5.0
"""Variance of near²/far, the level that is continued, over that of near; both are of as many averages."""
WIDEST = 8
"""Averaged lines in a stretch: a fifth of an octave's."""
NARROW = 3
"""A peak that is not wider than so many averaged lines may be a line or a resonance."""
HOPELESS = 0.6
"""Share of the gain of a known level that a stretch has to have to be looked at."""
SKIRT = 0.05
"""What is less above the level around it is no part of a peak."""


class _Lines(NamedTuple):
    lam: Array
    power: Array
    weight: Array
    averaged: NDArray[np.bool_]
    """Under Hann's window."""
    spread: Array
    """Rad a sample that each stands for."""

    def without(self, left: int, right: int) -> "_Lines":
        keep = np.r_[0:left, right : len(self.lam)]
        return _Lines(
            self.lam[keep], self.power[keep], self.weight[keep], self.averaged[keep], self.spread[keep]
        )

    def part(self, begin: int, end: int) -> "_Lines":
        part = slice(begin, end)
        return _Lines(
            self.lam[part], self.power[part], self.weight[part], self.averaged[part], self.spread[part]
        )


class _Found(NamedTuple):
    start: int
    stop: int
    level: float


def find_octave_peaks(p: Periodogram, false_alarm: float = FALSE_ALARM) -> tuple[Peak, ...]:
    """Find the peaks of one series, strongest first; each is taken out before the next is searched for."""
    weight = np.ones_like(p.lam) if p.weight is None else p.weight
    lines = _Lines(p.lam, p.power, weight, _averaged(weight), np.gradient(p.lam))
    return _search(lines, float(lines.power @ lines.spread), p.h, false_alarm)


def _search(lines: _Lines, total: float, h: float, false_alarm: float) -> tuple[Peak, ...]:
    """Return the peaks of `lines`; total: power of all that there were."""
    all_of_them = lines
    peaks: list[Peak] = []
    while len(peaks) < MOST:
        found = _strongest(lines, false_alarm)
        if found is None:
            break
        left, right = _extent(lines, found)
        peak = _describe(lines, found, (left, right), total, h)
        if peak.kind == "resonance" or peak.height < TELLING:
            edge = _notch_below(lines, found)
            if edge is not None:
                return _with_stop_band(all_of_them, total, h, false_alarm, edge)
        peaks.append(peak)
        lines = lines.without(left, right)
    return tuple(peaks)


def _notch_below(lines: _Lines, found: _Found) -> float | None:
    """Return where the notch of a side lobe begins, for which single ordinates are not taken."""
    single = np.flatnonzero(~lines.averaged[: found.start])
    begin = int(single[-1]) + 1 if lines.averaged[found.start] and single.size else 0
    least = 1 if lines.averaged[found.start] else SMOOTHEST
    return notch_below(lines.lam[begin:], lines.power[begin:], found.start - begin, found.stop - begin, least)


def _with_stop_band(
    lines: _Lines, total: float, h: float, false_alarm: float, edge: float
) -> tuple[Peak, ...]:
    """Return the peaks of a filter's pass band, and the lines of its stop band, which begins at `edge`."""
    begin = int(np.searchsorted(lines.lam, edge))
    peaks = _search(lines.part(0, begin), total, h, false_alarm)
    beyond = lines.part(begin, len(lines.lam))
    if not len(beyond.lam):
        return peaks
    many = SHORTEST_FLANK if beyond.averaged.any() else FLANK
    described = []
    for start, stop, level in lines_among_lobes(beyond.power, many, float(np.median(beyond.weight))):
        skirts = max(start - LOBE, 0), min(stop + LOBE, len(beyond.lam))
        described.append(_describe(beyond, _Found(start, stop, level), skirts, total, h))
    described.sort(key=lambda line: -line.power_share)
    return (*peaks, *described)[:MOST]


def around(p: Periodogram, bands: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
    """Return the bands (low, high) in Hz, wide enough to be rid of sharp lines within them in p."""
    if p.weight is None:
        return bands
    hz = p.lam / (2 * np.pi * p.h)
    reach = np.where(_averaged(p.weight), (LOBE - 0.5) * np.gradient(hz), 0.0)
    wider = []
    for low, high in bands:
        first, last = np.searchsorted(hz, [low, high]).clip(max=len(hz) - 1)
        wider.append((low - float(reach[first]), high + float(reach[last])))
    return tuple(wider)


def _averaged(weight: Array) -> NDArray[np.bool_]:
    """Return whether lines are averages over blocks; the others are ordinates, or averages of a few alike."""
    return np.asarray(weight != np.rint(weight))


class _Stretches(NamedTuple):
    """All stretches that are tried, and their flanks: [at, end), [low_from, low_to), [high_from, high_to)."""

    at: Ints
    end: Ints
    low_from: Ints
    low_to: Ints
    high_from: Ints
    high_to: Ints
    own: Array
    """Its weight; effective: what it is worth under Hann's window."""
    effective: Array
    low: Array
    high: Array


@functools.lru_cache(maxsize=64)
def _stretches(weight: bytes) -> _Stretches:
    """Return the stretches of lines of these weights: axes, and devices of one age, have them in common."""
    each = np.frombuffer(weight)
    averaging = _averaged(each)
    m = len(each)
    weights = np.concatenate([[0.0], each.cumsum()])
    averaged = np.concatenate([[0], averaging.cumsum()])
    # The shortest flank that begins at each line, upwards and downwards.
    up = np.searchsorted(weights, weights + FLANK, side="left")
    down = np.searchsorted(weights, weights - FLANK, side="right") - 1
    tries: list[list[Ints]] = []
    gathered: list[Array] = []
    for width in (1 << i for i in range(int(math.log2(max(WIDEST_SHARE * m, 1))) + 1)):
        flank = max(SHORTEST_FLANK, 2 * width)
        at = np.arange(0, m - width, max(1, width // 4))
        if width > WIDEST:
            at = at[averaged[at + width] == averaged[at]]
        at = at[(at >= width) & (at + 2 * width <= m)]
        after, before = at + 2 * width, at - width
        after_end = np.minimum(np.maximum(up[after], after + flank), m)
        before_end = np.maximum(np.minimum(down[before], before - flank), 0)
        least = max(LEAST_FLANK, width)
        whole = np.minimum(after_end - after, before - before_end) >= least
        whole &= weights[after_end] - weights[after] >= LEAST_IN_FLANK
        whole &= weights[before] - weights[before_end] >= LEAST_IN_FLANK
        tries.append([one[whole] for one in (at, at + width, before_end, before, after, after_end)])
        gathered.append(np.where(averaging[at[whole]], _gathered(width), 1.0))
    at, end, low_from, low_to, high_from, high_to = map(np.concatenate, zip(*tries, strict=True))
    own, low, high = (
        weights[b] - weights[a] for a, b in ((at, end), (low_from, low_to), (high_from, high_to))
    )
    effective = own * np.concatenate(gathered)
    return _Stretches(at, end, low_from, low_to, high_from, high_to, own, effective, low, high)


def _strongest(lines: _Lines, false_alarm: float) -> _Found | None:
    """Return the most striking stretch, and the level around it; None if none is."""
    sums = np.concatenate([[0.0], (lines.weight * lines.power).cumsum()])
    least = 1e-12 * float(sums[-1] / lines.weight.cumsum()[-1])
    at_the_ends = _at_the_ends(lines, sums, least, false_alarm / 2)
    best, most = at_the_ends if at_the_ends is not None else (None, 0.0)
    tried = _stretches(lines.weight.tobytes())
    if not len(tried.at):
        return best
    critical = -NormalDist().inv_cdf(false_alarm / 2 / len(tried.at))
    mean = (sums[tried.end] - sums[tried.at]) / tried.own
    low = (sums[tried.low_to] - sums[tried.low_from]) / tried.low
    high = (sums[tried.high_to] - sums[tried.high_from]) / tried.high
    level = np.maximum(low, high)
    ratio = mean / np.maximum(level, least)
    # Of those that pass, the likeliest: deviates would favour wide stretches, whose flanks are longer.
    gain = np.where(ratio > 1, tried.effective * (ratio - 1 - np.log(np.maximum(ratio, 1.0))), 0.0)
    # If the level were known, the deviate would be about √(2 gain): most stretches need no closer look.
    near = np.flatnonzero(gain > max(HOPELESS * critical**2 / 2, most))
    other = np.where(low > high, tried.low, tried.high)[near]
    near = near[f_deviate(ratio[near], 2 * tried.effective[near], 2 * other) > critical]
    if not len(near):
        return best
    i = int(near[gain[near].argmax()])
    return _Found(int(tried.at[i]), int(tried.end[i]), float(level[i]))


class _AtAnEnd(NamedTuple):
    """A stretch that is tried at an end; flanks: both, or two pieces of the lower one, and their weights."""

    at: int
    width: int
    own: float
    effective: float
    flanks: list[tuple[int, int, float]]
    two_sided: bool
    others: list[float]
    """What the flanks that count are worth."""


@functools.lru_cache(maxsize=64)
def _tries_at_the_ends(weight: bytes) -> list[_AtAnEnd]:
    """Return the stretches too near to an end for whole flanks, of lines of these weights."""
    each = np.frombuffer(weight)
    # Plain numbers: these few tries are looked at one by one.
    total: list[float] = np.concatenate([[0.0], each.cumsum()]).tolist()
    averaged: list[bool] = _averaged(each).tolist()
    m = len(averaged)
    places = []
    for width in END_WIDTHS:
        first = bisect_left(total, LEAST_IN_FLANK) + width
        last = min(bisect_right(total, total[-1] - LEAST_IN_FLANK) - 1, m - LEAST_FLANK)
        last -= 2 * width
        places += [(at, width) for at in range(END_FLANK + width, min(first, last + 1))]
        if width == 1 or not averaged[-1]:  # over two averages a level can rise too far
            places += [(at, width) for at in range(max(last + 1, first), m - width + 1)]
    tries = []
    for at, width in places:
        after, before = min(at + 2 * width, m), at - width
        after_to = min(max(bisect_left(total, total[after] + FLANK), after + LEAST_FLANK), m)
        two_sided = after_to - after >= LEAST_FLANK and total[after_to] - total[after] >= LEAST_IN_FLANK
        if two_sided:
            ends = (_down(total, before, FLANK, SHORTEST_FLANK), before), (after, after_to)
        else:
            begin = _down(total, before, FLANK // 2, LEAST_FLANK)
            ends = (begin, before), (_down(total, begin, FLANK // 2, LEAST_FLANK), begin)
        flanks = [(a, b, total[b] - total[a]) for a, b in ends]
        others = [flank[2] for flank in flanks] if two_sided else [flanks[0][2]]
        if not two_sided and averaged[at]:
            others = [others[0] / CONTINUED]
        own = total[at + width] - total[at]
        effective = own * (_gathered(width) if averaged[at] else 1.0)
        tries.append(_AtAnEnd(at, width, own, effective, flanks, two_sided, others))
    return tries


def _at_the_ends(lines: _Lines, sums: Array, least: float, false_alarm: float) -> tuple[_Found, float] | None:
    """Return the likeliest line at an end, and its gain."""
    tries = _tries_at_the_ends(lines.weight.tobytes())
    if not tries:
        return None
    critical = -NormalDist().inv_cdf(false_alarm / len(tries))
    best: tuple[_Found, float] | None = None
    for one in tries:
        mean = float(sums[one.at + one.width] - sums[one.at]) / one.own
        near, other = (float(sums[b] - sums[a]) / max(weight, 1e-300) for a, b, weight in one.flanks)
        near = max(near, least)
        levels = [near, max(other, least)] if one.two_sided else [continued(near, other)]
        ratio = mean / max(levels)
        if ratio <= 1:
            continue
        gain = one.effective * (ratio - 1 - math.log(ratio))
        if gain <= max(HOPELESS * critical**2 / 2, best[1] if best is not None else 0.0):
            continue
        # Each flank by itself: a short one is low by luck more often.
        deviates = f_deviate(mean / np.array(levels), 2 * one.effective, 2 * np.array(one.others))
        if float(deviates.min()) > critical:
            best = _Found(one.at, one.at + one.width, max(levels)), gain
    return best


def _down(weights: list[float], end: int, ordinates: int, lines: int) -> int:
    """Return where a flank up to `end` begins that has so many ordinates, and lines; 0 if there are fewer."""
    return max(min(bisect_right(weights, weights[end] - ordinates) - 1, end - lines), 0)


@functools.cache
def _gathered(width: int) -> float:
    """Return the effective ordinates of so many averaged lines, over the sum of their weights."""

    def correlated(lines: float) -> float:
        return 1 + 2 * sum(r * max(1 - (i + 1) / lines, 0.0) for i, r in enumerate(NEIGHBOURS))

    return correlated(math.inf) / correlated(width)


def _extent(lines: _Lines, found: _Found) -> tuple[int, int]:
    """Return the stretch with its skirts: as far as pieces of half its width are above the level."""
    piece = max(LOBE if lines.averaged[found.start] else 3, (found.stop - found.start) // 2)

    def above(begin: int, end: int) -> bool:
        weight = lines.weight[begin:end]
        total = float(weight.sum())
        return float(weight @ lines.power[begin:end]) / total > found.level * (
            1 + max(2 / math.sqrt(total), SKIRT)
        )

    left, right = max(found.start - 1, 0), min(found.stop + 1, len(lines.lam))
    while left > piece and above(left - piece, left):
        left -= piece
    while right < len(lines.lam) - piece and above(right, right + piece):
        right += piece
    return left, right


def _describe(lines: _Lines, found: _Found, extent: tuple[int, int], total: float, h: float) -> Peak:
    left, right = extent
    to_hz = 1 / (2 * math.pi * h)
    part, steps = lines.power[left:right], lines.spread[left:right]
    averaged = bool(lines.averaged[found.start])
    smooth = 1 if averaged else max(1, (found.stop - found.start) // 4)
    smoothed = np.convolve(part, np.ones(smooth) / smooth, mode="same")
    top = int(smoothed.argmax())
    wide = smoothed > found.level + (smoothed[top] - found.level) / 2
    narrow = int(wide.sum()) <= (NARROW if averaged else LINE_ORDINATES)
    if narrow:
        top = int(part.argmax())
    at = slice(max(top - 1, 0), top + 2) if narrow and averaged else slice(top, top + 1)
    above = np.maximum(part[at] - found.level, 0.0) + 1e-300
    frequency = float(np.average(lines.lam[left:right][at], weights=above))
    core = slice(found.start, found.stop)
    return Peak(
        kind="resonance" if not narrow else "peak" if averaged else "line",
        frequency_hz=frequency * to_hz,
        width_hz=float(steps[wide].sum() * to_hz),
        power_share=float((part - found.level) @ steps / total),
        height=float(np.average(lines.power[core], weights=lines.weight[core]) / found.level),
        # A little more: the ends must not be kept for rounding.
        notch_hz=(
            float((lines.lam[left] - steps[0] / 4) * to_hz),
            float((lines.lam[right - 1] + steps[-1] / 4) * to_hz),
        ),
    )
