"""Find a comb in an octave spectrum, where only its lowest teeth are separate lines.

The distance between neighbouring frequencies of an octave spectrum is about a constant share of the
frequency. So the first ten to twenty teeth of a comb are separate, and all higher teeth merge. The separate
teeth are found as in `comb`: each line's ratio to the level around it becomes a normal deviate, and the sums
of deviates over the multiples of a frequency are compared for all frequencies. Deviates are limited, so that
a few strong lines do not make a comb. The merged part of the spectrum is left out together with the teeth.
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
"""Fewest lines from tooth to tooth; under Hann's window a tooth takes up to four."""
LOBES = 2.75
"""Lines on each side of a tooth that are left out with it under Hann's window."""
LEAKS = 0.05
"""The skirts of a tooth without a window are left out down to this ratio of leaked power to noise power."""
AROUND, ASIDE = 12, 3
"""AROUND: lines on each side whose median is the level of a line. ASIDE: distance of the two lines that must
not be higher than the average of a tooth, since a lobe of a filter is no tooth."""
FEWEST_CLEAR, CLEAR_BY_CHANCE = 5, 0.0062
"""CLEAR_BY_CHANCE: share of all lines that are clear by chance. A comb is only searched for if FEWEST_CLEAR
more lines than that are clear, which saves time."""
CLEAR, MOST = 2.5, 4.0
"""CLEAR: deviate from which on a single tooth is clear. MOST: largest deviate that counts."""
NOTCH, LEAST_WEIGHT, LOBE = 0.4, 16.0, 10
"""NOTCH: share of the level below which a line is taken for a notch; averages over LEAST_WEIGHT ordinates or
more are hardly ever so low by chance. LOBE: a lobe has such a line within this many lines on one side."""
NEARLY, SAME = 0.8, 0.02
"""NEARLY: the lowest fundamental with this share of the highest evidence is taken. SAME: relative error of
the fundamental."""
MOST_LEFT_OUT = 0.42
"""Largest part of the spectrum that is left out on each side of a tooth, over the distance of teeth."""
STEP = 1 / 160
"""Relative step between the fundamentals that are tried: half a line where lines are closest together."""
MOST_TEETH = 32
PREFIXES = np.array([5, 8, 12, 20, 32])
"""Numbers of teeth, counted from the lowest, that are tried."""


class OctaveComb(NamedTuple):
    """A comb, and the frequency bands (low, high) [Hz] that are left out to remove it."""

    peak: Peak
    bands: tuple[tuple[float, float], ...]


def find_octave_comb(p: Periodogram, false_alarm: float = FALSE_ALARM) -> OctaveComb | None:
    """Return the comb of one series, or None; `p`: the octave spectrum of the series."""
    weight = np.ones_like(p.lam) if p.weight is None else p.weight
    if len(p.lam) == p.n // 2 + (p.n % 2) - LOWEST:  # `p` is the periodogram of the whole record
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
    # Above the frequency at which teeth merge, they give no evidence.
    end = _ends(fundamentals, p.lam, spread)
    seen = teeth < end[:, np.newaxis]
    terms = np.where(seen, deviate[line], 0.0)
    many = np.minimum(PREFIXES, np.maximum(seen.sum(axis=1), 1)[:, np.newaxis])
    clear = np.cumsum(terms > CLEAR, axis=1)[:, PREFIXES - 1] >= FEWEST_TEETH
    evidence = np.where(clear, np.cumsum(terms, axis=1)[:, PREFIXES - 1] / np.sqrt(many), 0.0)
    strongest = evidence.max(axis=1)
    if not strongest.max() ** 2 / 2 > math.log(evidence.size / false_alarm):
        return None
    # A comb with multiples of 1 Hz has those of 2 Hz too, but not the reverse: take the lowest candidate.
    lowest = int((strongest > NEARLY * strongest.max()).argmax())
    near = fundamentals < fundamentals[lowest] * (1 + SAME)
    i = int(np.where(near, strongest, 0.0).argmax())
    used = int(many[i, int(evidence[i].argmax())])
    fundamental = _refined(p, level, line[i, :used], order[:used])
    return _described(p, level, weight, fundamental, used, float(end[i]))


def _nothing_stands_out(power: Array, weight: Array) -> bool:
    """Return, in little time, whether too few lines are far above the median of the lines around them."""
    blocks = len(power) // (2 * AROUND)
    parts = power[: blocks * 2 * AROUND].reshape(blocks, 2 * AROUND)
    level = np.repeat(np.partition(parts, AROUND, axis=1)[:, AROUND], 2 * AROUND)
    thin = 1 / (9 * weight[: len(level)])
    # The deviate of Wilson and Hilferty for a mean of this many ordinates.
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
    """Return the frequency below which each fundamental's teeth are separate; 0 if they never are."""
    needed = np.maximum.accumulate(spread) * FEWEST_LINES
    place = np.searchsorted(needed, fundamentals, "right") - 1
    return np.where(place >= 0, lam[np.maximum(place, 0)] * (1 + 1e-9), 0.0)


@functools.lru_cache(maxsize=16)
def _fundamentals(first: float, last: float) -> Array:
    """Return fundamentals whose first FEWEST_TEETH multiples may be among lines from `first` to `last`."""
    lowest = 2 * first
    count = int(math.log(last / FEWEST_TEETH / lowest) / STEP)
    return np.asarray(lowest * np.exp(STEP * np.arange(max(count, 1))))


def _level(power: Array, weight: Array) -> Array:
    """Return the mean level around each line (m,), computed from the median, which teeth do not raise."""
    padded = np.pad(power, AROUND, mode="reflect")
    around = np.lib.stride_tricks.sliding_window_view(padded, 2 * AROUND + 1)
    level = np.partition(around, AROUND, axis=1)[:, AROUND]
    # The median of averages over w ordinates is this share of their mean (Wilson and Hilferty).
    return np.asarray(np.maximum(level / (1 - 1 / (9 * weight)) ** 3, 1e-12 * power.mean()))


def _beside_a_notch(power: Array, level: Array, weight: Array) -> NDArray[np.bool_]:
    """Return which lines (m,) have a line far below the level nearby, as between the lobes of a filter."""
    padded = np.pad(power / level, LOBE, mode="reflect")
    lowest = np.lib.stride_tricks.sliding_window_view(padded, 2 * LOBE + 1).min(axis=1)
    return np.asarray((lowest < NOTCH) & (weight > LEAST_WEIGHT))


def _nearest(lam: Array, at: ArrayLike) -> NDArray[np.intp]:
    at = np.asarray(at, dtype=np.float64)
    place = np.searchsorted(lam, at).clip(1, len(lam) - 1)
    return np.asarray(place - (at - lam[place - 1] < lam[place] - at), dtype=np.intp)


def _refined(p: Periodogram, level: Array, line: NDArray[np.intp], order: NDArray[np.intp]) -> float:
    """Return the fundamental frequency, refined by the centres of the teeth."""
    near = line[:, np.newaxis] + np.arange(-1, 2)
    near = near.clip(0, len(p.lam) - 1)
    above = np.maximum(p.power[near] - level[near], 1e-300 * level[near])
    centre = (above * p.lam[near]).sum(axis=1) / above.sum(axis=1) / order
    # A tooth's centre has an error of about one line distance; the error of the fundamental is that over the
    # tooth's number.
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
    # Ordinates of the whole record have no window: a tooth decreases as 1 / (π d)² at a distance of d
    # ordinates.
    skirts = np.sqrt(height / (2 * LEAKS)) / math.pi
    reach = np.where(_is_whole(weight[line]), np.maximum(skirts, LOBES), LOBES) * spread[line]
    reach = np.minimum(reach, fundamental * MOST_LEFT_OUT)
    bands = [((a - r) * to_hz, (a + r) * to_hz) for a, r in zip(at.tolist(), reach.tolist(), strict=True)]
    if end < p.lam[-1]:
        bands.append((end * to_hz, 1 / p.h))
    # The merged teeth are taken to have the power of the separate ones.
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
    """Return which lines are single ordinates of the record, not averages over blocks."""
    return np.asarray(weight == np.rint(weight))
