"""Find lines and resonances in an octave spectrum, whose values average different numbers of ordinates.

As in `spectral_lines`, a peak is a range of frequencies whose mean is too far above the means of the flanks
on both sides. host/native/octave_peak.hpp finds the strongest peak of all.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fltea import _native
from fltea.records.arrays import Array
from fltea.spectrum.periodogram import Periodogram
from fltea.spectrum.side_lobes import TELLING, lines_among_lobes, notch_below
from fltea.spectrum.spectral_lines import (
    FALSE_ALARM,
    FLANK,
    LINE_ORDINATES,
    MOST,
    SMOOTHEST,
    Peak,
    height_over,
)

LOBE = 2
"""Number of lines on each side to which a sharp line spreads."""
SHORTEST_FLANK = 12
"""Fewest lines in a flank, however many ordinates each line stands for."""
NARROW = 3
"""A peak up to this many averaged lines wide may be a line or a resonance."""
SKIRT = 0.05
"""A line belongs to a peak if its power is more than this share above the level around the peak."""


class _Lines(NamedTuple):
    lam: Array
    power: Array
    weight: Array
    averaged: NDArray[np.bool_]
    """Whether each line is an average over blocks under Hann's window."""
    spread: Array
    """The width [rad a sample] of the band that each line stands for."""

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
    """Find the peaks of one series, strongest first; each peak is removed before the next search."""
    weight = np.ones_like(p.lam) if p.weight is None else p.weight
    lines = _Lines(p.lam, p.power, weight, _averaged(weight), np.gradient(p.lam))
    return _search(lines, float(lines.power @ lines.spread), p.h, false_alarm)


def _search(lines: _Lines, total: float, h: float, false_alarm: float) -> tuple[Peak, ...]:
    """Return the peaks of `lines`; `total`: power of all lines before any peak was removed."""
    all_of_them = lines
    peaks: list[Peak] = []
    while len(peaks) < MOST:
        strongest = _native.strongest_octave_peak(lines.power, lines.weight, false_alarm)
        if strongest is None:
            break
        found = _Found(*strongest)
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
    """Return where the notch begins that makes the peak a side lobe of a filter; None without a notch.

    Lines that are single ordinates are not searched if the peak is among averages.
    """
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
    """Return `bands` (low, high) [Hz], widened so that no sharp line inside leaks out of them in `p`."""
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
    """Return which lines are averages over blocks; all others are averages of one or a few ordinates."""
    return np.asarray(weight != np.rint(weight))


def _extent(lines: _Lines, found: _Found) -> tuple[int, int]:
    """Return the range of the peak with its skirts.

    A skirt ends where a piece of half the peak's width is no longer above the level.
    """
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
        height=height_over(float(np.average(lines.power[core], weights=lines.weight[core])), found.level),
        # The band is a little wider than the peak, so that rounding does not keep the lines at its ends.
        notch_hz=(
            float((lines.lam[left] - steps[0] / 4) * to_hz),
            float((lines.lam[right - 1] + steps[-1] / 4) * to_hz),
        ),
    )
