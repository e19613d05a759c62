"""Find a spectrum's most significant peak by its definition, as the oracle of host/native/octave_peak.hpp."""

import math
from collections.abc import Iterator
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from fltea.noise.distributions import f_deviate
from fltea.records.arrays import Array
from fltea.spectrum.ordinate_peak import FLANK, WIDEST_SHARE
from fltea.spectrum.spectral_lines import SHORTEST_FLANK

LEAST_FLANK, LEAST_ORDINATES, END_FLANK, CONTINUED, HOPELESS = 4, 16.0, 4, 5.0, 0.6
NEIGHBOURS = 4 / 9, 1 / 36


class Try(NamedTuple):
    """A range of neighbouring spectral lines (bins) that is tested for a peak.

    `begin`, `end`: the range.
    `level`: background level around the range.
    `levels`: background levels, each of which the power of the range must exceed significantly.
    `ordinates`: number of periodogram values of which each of these levels is the mean.
    """

    begin: int
    end: int
    level: float
    levels: list[float]
    ordinates: list[float]
    gain: float
    mean: float
    effective: float


class Lines:
    """The powers of spectral lines (bins).

    `weight`: effective number of periodogram values of which each power is the mean.
    """

    def __init__(self, power: Array, weight: Array) -> None:
        self.m = len(power)
        self.sums = [0.0, *(power * weight).cumsum().tolist()]
        self.weights = [0.0, *weight.cumsum().tolist()]
        self.averaged = (weight != np.rint(weight)).tolist()
        self.least = 1e-12 * self.sums[-1] / self.weights[-1]

    def worth(self, begin: int, end: int) -> float:
        return self.weights[end] - self.weights[begin]

    def mean(self, begin: int, end: int) -> float:
        return (self.sums[end] - self.sums[begin]) / max(self.worth(begin, end), 1e-300)

    def below(self, end: int, ordinates: float, lines: int) -> tuple[int, int]:
        enough = [i for i in range(end) if self.weights[i] <= self.weights[end] - ordinates]
        return max(min(enough[-1] if enough else 0, end - lines), 0), end

    def above(self, begin: int, ordinates: float, lines: int) -> tuple[int, int]:
        reached = self.weights[begin] + ordinates
        enough = next((i for i in range(begin, self.m + 1) if self.weights[i] >= reached), self.m)
        return begin, min(max(enough, begin + lines), self.m)

    def tried(self, begin: int, end: int, level: float, levels: list[float], ordinates: list[float]) -> Try:
        mean, effective = self.mean(begin, end), self.worth(begin, end)
        if self.averaged[begin]:
            ratio = [
                1 + 2 * sum(r * max(1 - i / n, 0) for i, r in enumerate(NEIGHBOURS, 1))
                for n in (math.inf, end - begin)
            ]
            effective *= ratio[0] / ratio[1]
        ratio_to_level = mean / max(level, self.least)
        gain = effective * (ratio_to_level - 1 - math.log(ratio_to_level)) if ratio_to_level > 1 else 0.0
        return Try(begin, end, level, levels, ordinates, gain, mean, effective)

    def between(self) -> Iterator[Try]:
        for width in (1 << i for i in range(int(math.log2(max(WIDEST_SHARE * self.m, 1))) + 1)):
            for at in range(0, self.m - 2 * width + 1, max(1, width // 4)):
                if at < width or (width > 8 and any(self.averaged[at : at + width])):
                    continue
                flank = max(SHORTEST_FLANK, 2 * width)
                low, high = self.below(at - width, FLANK, flank), self.above(at + 2 * width, FLANK, flank)
                if min(b - a for a, b in (low, high)) < max(LEAST_FLANK, width):
                    continue
                if min(self.worth(*low), self.worth(*high)) < LEAST_ORDINATES:
                    continue
                higher = low if self.mean(*low) > self.mean(*high) else high
                level = self.mean(*higher)
                yield self.tried(at, at + width, level, [max(level, self.least)], [self.worth(*higher)])

    def at_the_ends(self) -> Iterator[Try]:
        for width in (1, 2):
            first = next((i for i, w in enumerate(self.weights) if w >= LEAST_ORDINATES), self.m + 1) + width
            filled = max(
                (i for i, w in enumerate(self.weights) if w <= self.weights[-1] - LEAST_ORDINATES), default=-1
            )
            last = min(filled, self.m - LEAST_FLANK) - 2 * width
            for at in range(END_FLANK + width, min(first, last + 1)):
                yield self.at_an_end(at, width)
            if width == 1 or not self.averaged[-1]:
                for at in range(max(last + 1, first), self.m - width + 1):
                    yield self.at_an_end(at, width)

    def at_an_end(self, at: int, width: int) -> Try:
        high = self.above(min(at + 2 * width, self.m), FLANK, LEAST_FLANK)
        if high[1] - high[0] >= LEAST_FLANK and self.worth(*high) >= LEAST_ORDINATES:
            flanks = self.below(at - width, FLANK, SHORTEST_FLANK), high
            levels = [max(self.mean(*flank), self.least) for flank in flanks]
            return self.tried(at, at + width, max(levels), levels, [self.worth(*flank) for flank in flanks])
        near = self.below(at - width, FLANK // 2, LEAST_FLANK)
        far = self.below(near[0], FLANK // 2, LEAST_FLANK)
        level, further = max(self.mean(*near), self.least), self.mean(*far)
        level *= max(level / further, 1.0) if further > 0 else 1.0
        worth = self.worth(*near) / (CONTINUED if self.averaged[at] else 1)
        return self.tried(at, at + width, level, [level], [worth])


def strongest(power: Array, weight: Array, false_alarm: float) -> tuple[int, int, float] | None:
    """Return begin and end of a spectrum's most significant peak (indices of its lines), and the background
    level around it. Return None if no peak is significant.
    """
    lines = Lines(power, weight)
    best: Try | None = None
    for tries in (list(lines.at_the_ends()), list(lines.between())):
        if not tries:
            continue
        critical = -NormalDist().inv_cdf(false_alarm / 2 / len(tries))
        for one in tries:
            if one.gain <= max(HOPELESS * critical**2 / 2, best.gain if best else 0.0):
                continue
            deviates = [
                float(f_deviate(one.mean / level, 2 * one.effective, 2 * ordinates))
                for level, ordinates in zip(one.levels, one.ordinates, strict=True)
            ]
            if min(deviates) > critical:
                best = one
    return None if best is None else (best.begin, best.end, best.level)
