"""Find a comb in an octave spectrum, in which only the lowest peaks of the comb can be told apart.

The frequencies of an octave spectrum are called lines here. The distance between neighbouring lines is about
proportional to the frequency. So the first ten to twenty peaks of a comb (at multiples of its fundamental
frequency) are separate, and all higher peaks merge. The separate peaks are found in a similar way as in
`comb`: the ratio of each line to the level around it is converted to a normal deviate. For each possible
fundamental frequency, the deviates at its multiples are summed, and the sums are compared. Deviates are
limited, so that a few strong lines do not make a comb. If a comb is found, the part of the spectrum in which
its peaks merge is left out together with the separate peaks.
"""

import functools
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fltea.noise.distributions import f_deviate
from fltea.records.arrays import Array
from fltea.spectrum.comb import FALSE_ALARM, FEWEST_TEETH, find_comb
from fltea.spectrum.periodogram import LOWEST, Periodogram
from fltea.spectrum.spectral_lines import Peak, Repeats

FEWEST_LINES = 5.0
"""Peaks of a comb (its teeth) count as separate if they are at least this many lines apart. Under Hann's
window, a peak is up to four lines wide. A line is one frequency of the octave spectrum.
"""
LOBES = 2.75
"""Where Hann's window was used, this many lines on each side of a comb's peak are left out, too."""
LEAKS = 0.05
"""Without a window, the power of a comb's peak leaks far to both sides. As far as the leaked power is at
least this proportion of the noise's power, the lines beside the peak are left out with it.
"""
AROUND, ASIDE = 12, 3
"""AROUND: the level of the noise at a line (one frequency of the spectrum) is the median over this many lines
on each side. ASIDE: if a line is an average over blocks, the level is at least the mean of the two lines that
are this many lines away. So a wide maximum, such as a side lobe of a filter, is not taken for a comb's peak.
"""
FEWEST_CLEAR, CLEAR_BY_CHANCE = 5, 0.0062
"""A line stands out clearly if its deviate is above CLEAR. CLEAR_BY_CHANCE: proportion of the lines of white
noise that do so by chance. To save time, a comb is searched for only if at least FEWEST_CLEAR more lines than
that stand out clearly.
"""
CLEAR, MOST = 2.5, 4.0
"""The normal deviate of a line says by how many standard deviations the line exceeds the level. CLEAR: a line
with a larger deviate stands out clearly. MOST: a larger deviate is replaced by this one.
"""
NOTCH, LEAST_WEIGHT, LOBE = 0.4, 16.0, 10
"""NOTCH: a line lies in a notch of a filter if its power is below this proportion of the level. LOBE: a line
that is at most this many lines away from a notch may be a side lobe of the filter, and is no peak of a comb.
LEAST_WEIGHT: this holds only for lines that average more ordinates than this, since other lines may be so low
by chance.
"""
NEARLY, SAME = 0.8, 0.02
"""NEARLY: of all fundamental frequencies whose evidence is at least this proportion of the highest evidence,
the lowest is chosen. SAME: fundamental frequencies whose relative difference is less than this count as the
same frequency.
"""
MOST_LEFT_OUT = 0.42
"""To remove a comb, a band around each of its peaks is left out. To each side, the band reaches at most this
proportion of the distance between peaks.
"""
STEP = 1 / 160
"""Relative step between the fundamental frequencies that are tried. It is half the smallest relative distance
between lines.
"""
MOST_TEETH = 32
PREFIXES = np.array([5, 8, 12, 20, 32])
"""A fundamental frequency is tested with each of these numbers of peaks, counted from the lowest."""


class OctaveComb(NamedTuple):
    """A comb, and the frequency bands (low, high) [Hz] that are left out to remove it."""

    peak: Peak
    bands: tuple[tuple[float, float], ...]


def find_octave_comb(p: Periodogram, false_alarm: float = FALSE_ALARM) -> OctaveComb | None:
    """Return the comb of one series, or None without one. `p`: the octave spectrum of the series."""
    weight = np.ones_like(p.lam) if p.weight is None else p.weight
    # if `p` has as many lines as a periodogram of `p.n` samples, no part of it comes from blocks
    if len(p.lam) == p.n // 2 + (p.n % 2) - LOWEST:
        return _of_the_whole(p, false_alarm)
    if _nothing_stands_out(p.power, weight):
        return None
    spread = np.gradient(p.lam)
    level = _level(p.power, weight)
    aside = np.pad(p.power, ASIDE, mode="reflect")
    around = np.maximum(level, np.where(_is_whole(weight), 0.0, aside[: -2 * ASIDE] + aside[2 * ASIDE :]) / 2)
    deviate = f_deviate(p.power / around, 2 * weight, 2 * weight * AROUND)
    deviate = np.where(_beside_a_notch(p.power, level, weight), 0.0, np.minimum(deviate, MOST))
    fundamentals = _fundamentals(float(p.lam[0]), float(p.lam[-1]))
    order = np.arange(1, MOST_TEETH + 1)
    teeth = np.outer(fundamentals, order)
    line = _nearest(p.lam, teeth)
    # The peaks at multiples of a fundamental frequency merge at high frequencies. There they give no
    # evidence.
    end = _ends(fundamentals, p.lam, spread)
    seen = teeth < end[:, np.newaxis]
    terms = np.where(seen, deviate[line], 0.0)
    many = np.minimum(PREFIXES, np.maximum(seen.sum(axis=1), 1)[:, np.newaxis])
    clear = np.cumsum(terms > CLEAR, axis=1)[:, PREFIXES - 1] >= FEWEST_TEETH
    evidence = np.where(clear, np.cumsum(terms, axis=1)[:, PREFIXES - 1] / np.sqrt(many), 0.0)
    strongest = evidence.max(axis=1)
    if not strongest.max() ** 2 / 2 > math.log(evidence.size / false_alarm):
        return None
    # Events each second have power at all multiples of 1 Hz, so also at those of 2 Hz. But 2 Hz has less
    # evidence, since the peaks at 1, 3, 5 … Hz are not among its multiples. So the lowest fundamental
    # frequency with nearly the highest evidence is the true one.
    lowest = int((strongest > NEARLY * strongest.max()).argmax())
    near = fundamentals < fundamentals[lowest] * (1 + SAME)
    i = int(np.where(near, strongest, 0.0).argmax())
    used = int(many[i, int(evidence[i].argmax())])
    fundamental = _refined(p, level, line[i, :used], order[:used])
    return _described(p, level, weight, fundamental, used, float(end[i]))


def _nothing_stands_out(power: Array, weight: Array) -> bool:
    """Return whether too few lines for a comb are clearly higher than the median of the lines around them.

    This quick test saves the time of a search for a comb.
    """
    blocks = len(power) // (2 * AROUND)
    parts = power[: blocks * 2 * AROUND].reshape(blocks, 2 * AROUND)
    level = np.repeat(np.partition(parts, AROUND, axis=1)[:, AROUND], 2 * AROUND)
    thin = 1 / (9 * weight[: len(level)])
    # `least`: a line stands out clearly if its power is more than this many times the level. In white noise,
    # this is as rare as a normal random number above CLEAR, by the approximation of Wilson and Hilferty for a
    # mean of `weight` ordinates.
    least = (1 - thin + CLEAR * np.sqrt(thin)) ** 3 / (1 - thin) ** 3
    few = FEWEST_CLEAR + CLEAR_BY_CHANCE * len(level)
    return int(np.count_nonzero(power[: len(level)] > least * level)) < few


def _of_the_whole(p: Periodogram, false_alarm: float) -> OctaveComb | None:
    comb = find_comb(p._replace(weight=None), false_alarm=false_alarm)
    if comb is None:
        return None
    fundamental = 2 * np.pi / comb.period
    weight = np.ones_like(p.lam)
    return _described(p, _level(p.power, weight), weight, fundamental, comb.teeth, math.pi)


def _ends(fundamentals: Array, lam: Array, spread: Array) -> Array:
    """Return up to which frequency a comb's peaks are separate, for each fundamental frequency.

    It is 0 if no peaks are separate.
    """
    needed = np.maximum.accumulate(spread) * FEWEST_LINES
    place = np.searchsorted(needed, fundamentals, "right") - 1
    return np.where(place >= 0, lam[np.maximum(place, 0)] * (1 + 1e-9), 0.0)


@functools.lru_cache(maxsize=16)
def _fundamentals(first: float, last: float) -> Array:
    """Return all fundamental frequencies to try in a spectrum from `first` to `last` [rad a sample].

    The spectrum contains at least the first FEWEST_TEETH multiples of each.
    """
    lowest = 2 * first
    count = int(math.log(last / FEWEST_TEETH / lowest) / STEP)
    return np.asarray(lowest * np.exp(STEP * np.arange(max(count, 1))))


def _level(power: Array, weight: Array) -> Array:
    """Return the mean level around each line, (m,).

    The level is computed from a median, which the peaks of a comb hardly raise.
    """
    padded = np.pad(power, AROUND, mode="reflect")
    around = np.lib.stride_tricks.sliding_window_view(padded, 2 * AROUND + 1)
    level = np.partition(around, AROUND, axis=1)[:, AROUND]
    # The median of many averages, each over `weight` ordinates, is smaller than the mean by the factor (1 - 1
    # / (9 weight))³ (Wilson and Hilferty).
    return np.asarray(np.maximum(level / (1 - 1 / (9 * weight)) ** 3, 1e-12 * power.mean()))


def _beside_a_notch(power: Array, level: Array, weight: Array) -> NDArray[np.bool_]:
    """Return which lines may be side lobes of a filter, (m,).

    They are those near a notch, where the power is far below the level.
    """
    padded = np.pad(power / level, LOBE, mode="reflect")
    lowest = np.lib.stride_tricks.sliding_window_view(padded, 2 * LOBE + 1).min(axis=1)
    return np.asarray((lowest < NOTCH) & (weight > LEAST_WEIGHT))


def _nearest(lam: Array, at: ArrayLike) -> NDArray[np.intp]:
    at = np.asarray(at, dtype=np.float64)
    place = np.searchsorted(lam, at).clip(1, len(lam) - 1)
    return np.asarray(place - (at - lam[place - 1] < lam[place] - at), dtype=np.intp)


def _refined(p: Periodogram, level: Array, line: NDArray[np.intp], order: NDArray[np.intp]) -> float:
    """Return the fundamental frequency, computed more exactly from the centres of the comb's peaks."""
    near = line[:, np.newaxis] + np.arange(-1, 2)
    near = near.clip(0, len(p.lam) - 1)
    above = np.maximum(p.power[near] - level[near], 1e-300 * level[near])
    centre = (above * p.lam[near]).sum(axis=1) / above.sum(axis=1) / order
    # The error of a peak's centre is about the distance between two lines. The fundamental frequency is the
    # centre divided by the peak's number, so its error is divided by this number, too.
    precision = (order / np.gradient(p.lam)[line]) ** 2
    return float((centre * precision).sum() / precision.sum())


def _described(
    p: Periodogram, level: Array, weight: Array, fundamental: float, teeth: int, end: float
) -> OctaveComb:
    to_hz, spread = 1 / (2 * math.pi * p.h), np.gradient(p.lam)
    at = np.arange(1, int(end / fundamental) + 1) * fundamental
    line = _nearest(p.lam, at)
    near = (line[:, np.newaxis] + np.arange(-2, 3)).clip(0, len(p.lam) - 1)
    excess = ((p.power - level)[near] * spread[near]).sum(axis=1)
    height = np.maximum((p.power / level)[near].max(axis=1), 1.0)
    # Ordinates of the whole record are computed without a window, so that the power of a peak decreases as 1
    # / (π d)² at a distance of d ordinates.
    skirts = np.sqrt(height / (2 * LEAKS)) / math.pi
    reach = np.where(_is_whole(weight[line]), np.maximum(skirts, LOBES), LOBES) * spread[line]
    reach = np.minimum(reach, fundamental * MOST_LEFT_OUT)
    bands = [((a - r) * to_hz, (a + r) * to_hz) for a, r in zip(at.tolist(), reach.tolist(), strict=True)]
    if end < p.lam[-1]:
        bands.append((end * to_hz, 1 / p.h))
    # The merged peaks, those that are too close to each other to be seen, are assumed to have the same power
    # as the separate peaks.
    share = float(excess.mean()) * (math.pi / fundamental) / float(p.power @ spread)
    return OctaveComb(
        Peak(
            kind="comb",
            frequency_hz=fundamental * to_hz,
            width_hz=float(spread[line[0]]) * to_hz,
            power_share=min(max(share, 0.0), 1.0),
            height=float(height[:teeth].mean()),
            notch_hz=bands[0],
            repeats=Repeats(2 * math.pi * p.h / fundamental, teeth),
        ),
        tuple(bands),
    )


def _is_whole(weight: Array) -> NDArray[np.bool_]:
    """Return which lines come from the whole record, not from blocks.

    The weight of a line that averages over blocks is not a whole number.
    """
    return np.asarray(weight == np.rint(weight))
