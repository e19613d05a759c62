"""Find a comb in a periodogram: spectral lines at all multiples of one frequency.

An event that repeats at equal intervals, such as a glitch each second, has its power in many spectral lines,
of which each is too weak to be seen alone. Here, the lines are found together, with a known rate of false
alarms. Candidates for the period come from two sources. One is the lags at which the autocorrelation of the
whitened record is highest. The other is the periods for which most of the strongest single lines are
multiples of one frequency. Each candidate is tested by the ordinates at the multiples of its frequency, which
are called teeth. In noise, the ratio of an ordinate to the mean of m neighbours exceeds r with the
probability (1 + r/m)^-m. So the evidence of a tooth is m log(1 + r/m), and in noise its sum over H teeth has
a gamma distribution of shape H. The evidence of a single tooth is limited, so that a few strong lines alone
do not make a comb. The rate of false alarms is divided by the number of fundamental frequencies that are
tested (Bonferroni).
"""

import functools
import math
from collections.abc import Sequence
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fltea.records.arrays import Array
from fltea.spectrum.periodogram import Periodogram, bin_starts

FALSE_ALARM = 1e-3
"""Probability of finding a comb in noise without one."""
FEWEST_TEETH = 5
"""A comb has at least this many lines (teeth), at multiples of one frequency. Mains hum with its second and
third harmonic has fewer, so it is no comb.
"""
FEWEST_PERIODS = 8
"""The event must have at least this many periods in the record. The comb's lines are then at least this
many ordinates apart, so that the noise between them can be measured.
"""
SHORTEST_PERIOD = 2 * FEWEST_TEETH
"""Shortest period of an event, in samples. If the period is this short, just `FEWEST_TEETH` multiples of the
fundamental frequency lie in the spectrum.
"""
LAG_FALSE_ALARM = 0.01
"""Probability that the autocorrelation of noise without a comb yields a candidate for the period."""
LEAST_LIMIT, LIMIT_SHARE = 10.0, 0.25
"""While possible periods are searched for, the ratio of an ordinate to its surroundings is limited: to
LEAST_LIMIT, or, if this is larger, to LIMIT_SHARE times the root of the number of ordinates. Then a single
spectral line of a long record adds at most LIMIT_SHARE standard deviations to the autocorrelation.
"""
LEVEL_BINS = 5
"""The level of the noise around a bin is the median over this many bins on each side. Only few of these bins
can contain a line of a comb.
"""
TOGETHER = 4
"""This many neighbouring ordinates are summed before the autocorrelation is computed. The summing lowers the
autocorrelation at long lags, but at the longest lag two thirds of it remain.
"""
WIDTHS = (1, 3, 5)
"""The autocorrelation is averaged over each of these numbers of neighbouring lags, since the period of an
event may vary and need not be a whole number of samples.
"""
GUARD = 2
"""The power of a line of the comb leaks into this many ordinates on each side of the line."""
WIDEST_FLANK = 24
"""A line of the comb is compared with at most this many ordinates on each side. The nearest GUARD ordinates
on each side are not among them.
"""
MOST_A_TOOTH = 8.0
"""Limit of the evidence of a single line of the comb. In noise, one in 3,000 ordinates exceeds this limit."""
CLEAR = 4.0
"""A line of a comb with at least this evidence is clear. A comb has at least `FEWEST_TEETH` clear ones."""
FIRST_SHARE = 0.6
"""The candidate for the period is the shortest lag whose autocorrelation is at least this proportion of the
highest one.
"""
NEAR = 2.0
"""Largest difference between the true period and a candidate for it, in samples."""
MOST_DIVISOR = 6
"""The true period may be a candidate divided by a whole number. This is the largest divisor that is tried."""
NEARLY = 0.8
"""Of all periods whose evidence is at least this proportion of the highest evidence, the shortest one is
chosen.
"""
MOST_SOONER, FIRST_TEETH = 12, 8
"""An event may happen several times within the period that was found, which is tried for up to MOST_SOONER
times. If it does, the spectral lines at multiples of its true frequency are higher than the lines between
them. FIRST_TEETH: this many of these lines, the lowest, are compared with those between.
"""
NO_TOOTH, SHAPED = 1.5, 0.08
"""Spectral lines between the lines of a comb do not belong to it if their mean height is below one of two
limits. Below NO_TOOTH, they count as noise, which has the height 1. Below SHAPED times the mean height of the
comb's lines, they only show that the times of the events were rounded to whole samples.
"""
AT_ONCE = 1 << 18
"""Largest number of lines of combs that are computed in one step."""
PREFIXES = (5, 8, 16, 32, 64, 128, 256, 512, 1024, 2048, 4096)
"""A comb is tested with each of these numbers of lines, counted from the lowest. Small numbers are tested,
too, since the comb of a smooth wave has only a few lines.
"""


class Comb(NamedTuple):
    """A comb: the spectral lines of an event that repeats at equal intervals."""

    period: float
    """The period in samples."""
    teeth: int
    """Number of lines of the comb, from the lowest to the highest one in the band."""
    height: float
    """The mean ratio of the power of the comb's lines to the level around them."""


class _Ordinates:
    """All ordinates of a record, with running sums that give the mean of any range of ordinates."""

    def __init__(self, p: Periodogram) -> None:
        place = np.rint(p.lam * (p.n / (2 * np.pi))).astype(np.intp)
        self.n, self.count = p.n, (p.n - 1) // 2
        self.power = np.zeros(self.count + 1)
        self.power[place] = p.power
        there = np.zeros(self.count + 2)
        there[place + 1] = 1.0
        self.sums = np.concatenate([[0.0], np.cumsum(self.power)])
        self.seen = np.cumsum(there)
        self.first = int(place[0])

    def terms(self, fundamental: Array, teeth: int) -> Array:
        """Return the evidence of each line (tooth) of several combs, (f, teeth).

        `fundamental`: fundamental frequency of each comb, (f,), in steps of the periodogram (1 / duration). A
        tooth is the ordinate at a multiple of it. The evidence of a tooth is 0 if its ordinate was left out,
        or has too few neighbours.
        """
        at = np.rint(np.outer(fundamental, np.arange(1, teeth + 1))).astype(np.intp)
        flank = max(2, min(WIDEST_FLANK, int(fundamental.min() / 2) - GUARD))
        inside = at <= self.count - GUARD - 1
        np.minimum(at, self.count, out=at)
        low, high = np.maximum(at - GUARD - flank, 0), np.minimum(at + GUARD + 1 + flank, self.count + 1)
        left, right = np.maximum(at - GUARD, 0), np.minimum(at + GUARD + 1, self.count + 1)
        total = self.sums[left] - self.sums[low] + self.sums[high] - self.sums[right]
        many = self.seen[left] - self.seen[low] + self.seen[high] - self.seen[right]
        with np.errstate(divide="ignore", invalid="ignore"):
            found = many * np.log1p(self.power[at] / total)
        found[~(inside & (many >= 4) & (total > 0))] = 0.0
        return np.asarray(found)

    def heights(self, fundamental: float, teeth: int) -> Array:
        """Return the ratio of each tooth's power to the mean of the ordinates around it, (teeth,)."""
        e = self.terms(np.array([fundamental]), teeth)[0]
        many = 2 * max(2, min(WIDEST_FLANK, int(fundamental / 2) - GUARD))
        return np.asarray(many * np.expm1(e / many))


def find_comb(
    p: Periodogram, lines_hz: Sequence[float] = (), false_alarm: float = FALSE_ALARM
) -> Comb | None:
    """Return the comb of one series, or None without one.

    `lines_hz`: frequencies of spectral lines that were already found and may belong to a comb. If there are
    any, only they give candidates for the period. `false_alarm`: probability of finding a comb in noise
    without one.
    """
    candidates = _lags(p) if not lines_hz else _periods_of(lines_hz, p)
    if not candidates:
        return None
    ordinates = _Ordinates(p)
    longest = p.n / FEWEST_PERIODS
    tried = 2 * ordinates.count * math.log(longest / SHORTEST_PERIOD) * len(PREFIXES)
    needed = math.log(max(tried, 1.0) / false_alarm)
    found = [
        judged
        for lag in candidates
        for divisor in range(1, MOST_DIVISOR + 1)
        if SHORTEST_PERIOD <= lag / divisor <= longest
        if (judged := _judged(ordinates, lag / divisor, NEAR / divisor)) is not None
    ]
    best = max((evidence for evidence, _, _ in found), default=0.0)
    if best < needed:
        return None
    # An event that repeats each second also repeats every 2 s, so this period has nearly as much evidence. A
    # period of 0.5 s has only half of the evidence: its comb lacks the lines at 1, 3, 5 … Hz. So the shortest
    # period with nearly the highest evidence is the true one.
    _, fundamental, teeth = max(
        (one for one in found if one[0] >= max(NEARLY * best, needed)), key=lambda one: one[1]
    )
    while (sooner := _happens_sooner(ordinates, fundamental)) > 1:
        fundamental, teeth = fundamental * sooner, max(teeth // sooner, FEWEST_TEETH)
    return Comb(p.n / fundamental, teeth, float(ordinates.heights(fundamental, teeth).mean()))


def _happens_sooner(ordinates: _Ordinates, fundamental: float) -> int:
    """Return how often the event happens within the period that was found.

    For example, an event happens every 103.7 samples, but its times are rounded to whole samples. It repeats
    exactly only after 1037 samples, so this longer period is found, in which the event happens ten times. Of
    the spectral lines of this period, nearly all power is then in every tenth: in the multiples of the
    event's true frequency.
    """
    for times in range(MOST_SOONER, 1, -1):
        heights = ordinates.heights(fundamental, FIRST_TEETH * times)
        own = float(heights[times - 1 :: times].mean())
        others = float(np.delete(heights, slice(times - 1, None, times)).mean())
        if own > CLEAR and others < max(NO_TOOTH, SHAPED * own):
            return times
    return 1


def _lags(p: Periodogram) -> tuple[float, ...]:
    """Return the lags [samples] at which the whitened record has a high autocorrelation.

    The result is empty if there are none.
    """
    longest = p.n // FEWEST_PERIODS
    if longest <= SHORTEST_PERIOD + max(WIDTHS):
        return ()
    ratio = p.power / _level(p)
    np.minimum(ratio, max(LEAST_LIMIT, LIMIT_SHARE * math.sqrt(len(ratio))), out=ratio)
    ratio -= ratio.mean()
    first, last = np.rint(p.lam[[0, -1]] * (p.n / (2 * np.pi))).astype(np.intp).tolist()
    # The FFT is made of sums of TOGETHER neighbouring ordinates, to be shorter. For lags up to `longest`, the
    # autocorrelation is exact enough.
    size = -(-p.n // TOGETHER)
    whole = np.zeros((size // 2 + 1) * TOGETHER)
    if last - first + 1 == len(ratio):
        whole[first + TOGETHER // 2 : last + 1 + TOGETHER // 2] = ratio
    else:
        whole[np.rint(p.lam * (p.n / (2 * np.pi))).astype(np.intp) + TOGETHER // 2] = ratio
    means = whole.reshape(-1, TOGETHER).sum(axis=1)
    scale = math.sqrt(2 * float(ratio @ ratio)) / size
    likeness = np.fft.irfft(means, size)[SHORTEST_PERIOD - 1 : longest + 2]
    found = []
    for width in WIDTHS:
        values = np.convolve(likeness, np.ones(width), "valid") if width > 1 else likeness
        top = int(values.argmax())
        if values[top] > _stands_out(len(values)) * scale * math.sqrt(width):
            # The autocorrelation is about equally high at all multiples of the period, so the shortest of
            # these lags is used.
            first = int((values > FIRST_SHARE * values[top]).argmax())
            first += int(values[first : first + width].argmax())
            at = SHORTEST_PERIOD - 1 + width // 2
            found += [float(at + first), float(at + top)]
    return tuple(dict.fromkeys(found))


@functools.cache
def _stands_out(lags: int) -> float:
    """Return by how many standard deviations the autocorrelation has to stand out at one of `lags` lags.

    In noise, any of the lags, at any of WIDTHS, reaches this with the probability LAG_FALSE_ALARM.
    """
    return NormalDist().inv_cdf(1 - LAG_FALSE_ALARM / (len(WIDTHS) * lags))


def _level(p: Periodogram) -> Array:
    """Return the level of the noise around each ordinate, (m,).

    The level is computed from medians, so that ordinates that stand out hardly raise it.
    """
    starts = bin_starts(p.lam, p.n)
    count = np.diff(np.append(starts, len(p.lam)))
    means = np.add.reduceat(p.power, starts) / count
    padded = np.pad(means, LEVEL_BINS, mode="edge")
    around = np.lib.stride_tricks.sliding_window_view(padded, 2 * LEVEL_BINS + 1)
    level = np.partition(around, LEVEL_BINS, axis=1)[:, LEVEL_BINS]
    return np.repeat(np.maximum(level, 1e-12 * means.mean()), count)


def _periods_of(lines_hz: Sequence[float], p: Periodogram) -> tuple[float, ...]:
    """Return the period [samples] for which most of the lines are multiples of one frequency.

    The result is empty if fewer than FEWEST_TEETH lines are multiples of one frequency.
    """
    if len(lines_hz) < FEWEST_TEETH:
        return ()
    lines = np.array(lines_hz) * (p.n * p.h)
    found: list[tuple[int, float]] = []
    for line in lines.tolist():
        for order in range(1, 2 * FEWEST_TEETH + 1):
            fundamental = line / order
            if fundamental < FEWEST_PERIODS:
                break
            number = np.rint(lines / fundamental)
            # A spectral line is up to half a step of the periodogram beside its true frequency. `fundamental`
            # is one of the lines divided by `order`, so the error of its multiple `number` is up to `number /
            # order` half steps.
            off = np.abs(lines - number * fundamental) <= 0.6 * (1 + number / order)
            found.append((int((off & (number > 0)).sum()), fundamental))
    most = max((count for count, _ in found), default=0)
    if most < FEWEST_TEETH:
        return ()
    fundamentals = [fundamental for count, fundamental in found if count == most]
    return (p.n / max(fundamentals),)


def _judged(ordinates: _Ordinates, period: float, within: float) -> tuple[float, float, int] | None:
    """Return the best period near `period`: evidence, fundamental frequency [ordinates], number of lines.

    Periods that differ from `period` by up to `within` are tried; both are in samples. The evidence is minus
    the logarithm of an upper bound of the probability that noise would give as much. The result is None if no
    period has any evidence.
    """
    n = ordinates.n
    most = int((ordinates.count - GUARD - 1) / (n / period))
    if most < FEWEST_TEETH:
        return None
    low, high = n / (period + within), n / max(period - within, SHORTEST_PERIOD / 2)
    teeth = min(most, PREFIXES[-1])
    grid = np.arange(low, high, 1 / (2 * teeth))
    prefixes = np.array([h for h in PREFIXES if h < teeth] + [teeth])
    best: tuple[float, float, int] | None = None
    rows = max(1, AT_ONCE // teeth)
    for begin in range(0, len(grid), rows):
        some = grid[begin : begin + rows]
        terms = ordinates.terms(some, teeth)
        clear = np.cumsum(terms > CLEAR, axis=1)[:, prefixes - 1]
        sums = np.cumsum(np.minimum(terms, MOST_A_TOOTH), axis=1)[:, prefixes - 1]
        evidence = np.where(clear >= FEWEST_TEETH, _evidence(sums, prefixes), 0.0)
        i, k = np.unravel_index(int(evidence.argmax()), evidence.shape)
        if evidence[i, k] > (best[0] if best is not None else 0.0):
            best = float(evidence[i, k]), float(some[i]), int(prefixes[k])
    return best


def _evidence(sums: Array, teeth: NDArray[np.intp]) -> Array:
    """Return the evidence of combs: minus the logarithm of an upper bound of a probability.

    It is the probability that in noise, the evidence of `teeth` lines of a comb adds up to at least `sums`.
    This sum has a gamma distribution of shape `teeth`. The bound is Chernoff's.
    """
    above = np.maximum(sums / teeth, 1.0)
    return np.asarray(teeth * (above - 1 - np.log(above)))
