"""Find narrow lines and broad resonances in a spectrum, with a known rate of false alarms.

A peak is a range of frequencies with so much power that chance does not explain it. Its mean power is
compared with those of its flanks, the neighbouring frequencies on both sides. Where the spectrum rises or
falls, the higher flank counts.

The search is the same for a file's periodogram and for the running spectrum, whose values average different
numbers of ordinates (`Ordinates` can contain either). Only the strongest peak is found in two different ways:
by `ordinate_peak` in a file, and by host/native/octave_peak.hpp in the running spectrum.
"""

import math
from typing import Literal

import msgspec
import numpy as np

from fltea.records.arrays import Array
from fltea.spectrum.ordinate_peak import FLANK
from fltea.spectrum.ordinates import LOBE, Found, Ordinates
from fltea.spectrum.periodogram import Periodogram
from fltea.spectrum.side_lobes import TELLING, lines_among_lobes, notch_below

FALSE_ALARM = 3e-3
"""Probability of finding a peak in noise without peaks, in a record that is tested once."""
MOST = 12
"""The search ends after this many peaks: a record with more peaks has other problems."""
SMOOTHEST = 9
"""Smallest number of ordinates over which a spectrum is averaged to test whether a hump is a side lobe."""
LINE_SKIRT = 3
"""If a file has a spectral line in the stop band of a filter, among side lobes, this many ordinates on each
side of the line are left out with it.
"""
SHORTEST_FLANK = 12
"""Assumed width of a side lobe or notch in a filter's stop band, as a number of values. It holds for a
running spectrum, whose values at high frequencies are averages over blocks.
"""
SKIRT = 0.05
"""In the running spectrum, the skirt of a peak reaches only as far as the power exceeds the level around the
peak by more than this proportion of the level.
"""
NARROW = 3
"""At high frequencies, values of the running spectrum are averages over blocks. There, a peak that is at most
this many values wide may be a line or a resonance. A wider peak is a resonance.
"""
LINE_ORDINATES = 6
"""A peak with nearly all its power in about this many ordinates is a spectral line, since its phase is stable
over the whole record.
"""
IN_A_LINE = 0.7
"""Proportion of a peak's power that counts as nearly all. The rest is noise around the spectral line."""


class Repeats(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An event that repeats at equal intervals and causes a comb of spectral lines."""

    period_s: float
    harmonics: int
    """Approximate number of lines of the event in the spectrum."""
    shape: Literal["glitch", "wave", "unknown"] = "unknown"
    """What the event is. A "glitch" is much shorter than the period, a "wave" is not. In live data the shape
    is "unknown", since the sums over samples do not show it.
    """
    duration_s: float | None = None
    """The duration of a glitch, in seconds."""
    deviations: float | None = None
    """The largest value of the event, as a multiple of the standard deviation of the noise."""


class Peak(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A peak of a spectrum: a spectral line, a resonance, or a comb of spectral lines."""

    kind: str
    """"line" or "resonance". "peak" where the resolution is too low to distinguish the two. "comb" for
    spectral lines at all multiples of `frequency_hz`.
    """
    frequency_hz: float
    """Frequency of the spectrum's maximum in the peak. For a resonance, the spectrum is smoothed first."""
    width_hz: float
    """Width of the peak at half its height above the surroundings."""
    power_share: float
    """Power of the peak, divided by the power of all ordinates that are used."""
    height: float
    """Ratio of the peak's mean power to the level around the peak."""
    notch_hz: tuple[float, float]
    """The band that has to be left out to remove the peak. For a comb, it is the band of its lowest line."""
    repeats: Repeats | None = None
    """The repeating event; only for a comb."""


def find_peaks(p: Periodogram, false_alarm: float = FALSE_ALARM) -> tuple[Peak, ...]:
    """Find the peaks in the spectrum of one series, the strongest first.

    Each peak is removed before the next strongest peak is searched for.
    """
    ordinates = Ordinates.of(p)
    return _search(ordinates, ordinates.total(), false_alarm)


def _search(lines: Ordinates, total: float, false_alarm: float) -> tuple[Peak, ...]:
    """Return the peaks of a spectrum. `total`: power of all its values before any peak was removed."""
    remaining = lines
    peaks: list[Peak] = []
    while len(peaks) < MOST:
        found = remaining.strongest(false_alarm)
        if found is None:
            break
        left, right = _extent(remaining, found)
        peak = _describe(remaining, found, (left, right), total)
        if peak.kind == "resonance" or peak.height < TELLING:
            edge = _notch_below(remaining, found)
            if edge is not None:
                return _with_stop_band(lines, total, false_alarm, edge)
        peaks.append(peak)
        remaining = remaining.without(left, right)
    return tuple(peaks)


def _notch_below(lines: Ordinates, found: Found) -> float | None:
    """Return the frequency at which the notch below the peak begins; None if the peak is no side lobe.

    At high frequencies, values of the running spectrum are averages over blocks. If the peak consists of such
    averages, the notch is searched for in averages only.
    """
    averaged = lines.is_averaged(found.start)
    begin = lines.first_average_before(found.start) if averaged else 0
    least = 1 if averaged else SMOOTHEST
    return notch_below(lines.lam[begin:], lines.power[begin:], found.start - begin, found.stop - begin, least)


def _with_stop_band(lines: Ordinates, total: float, false_alarm: float, edge: float) -> tuple[Peak, ...]:
    """Return the peaks in a filter's pass band, and the spectral lines in its stop band.

    `edge`: frequency at which the stop band begins.
    """
    begin = int(np.searchsorted(lines.lam, edge))
    peaks = _search(lines.part(0, begin), total, false_alarm)
    above = lines.part(begin, len(lines.lam))
    if not len(above.lam):
        return peaks
    # `flank`: assumed width of a whole side lobe or notch, as a number of values; a spectral line is narrower
    flank = SHORTEST_FLANK if above.has_averages() else FLANK
    skirt = LINE_SKIRT if above.weight is None else LOBE
    described = []
    for start, stop, level in lines_among_lobes(above.power, flank, above.median_weight()):
        extent = max(start - skirt, 0), min(stop + skirt, len(above.lam))
        described.append(_describe(above, Found(start, stop, level), extent, total))
    described.sort(key=lambda line: -line.power_share)
    return (*peaks, *described)[:MOST]


def _extent(lines: Ordinates, found: Found) -> tuple[int, int]:
    """Return the range of the peak `found` with its skirts, as indices.

    A skirt ends where the power is no longer significantly above the level around the peak. To see this, the
    power is averaged over half the peak's width.
    """
    piece = max(LOBE if lines.is_averaged(found.start) else 3, (found.stop - found.start) // 2)
    least = 0.0 if lines.weight is None else SKIRT

    def above(begin: int, end: int) -> bool:
        return lines.mean(begin, end) > found.level * (
            1 + max(2 / math.sqrt(lines.ordinates_in(begin, end)), least)
        )

    left, right = max(found.start - 1, 0), min(found.stop + 1, len(lines.lam))
    while left > piece and above(left - piece, left):
        left -= piece
    while right < len(lines.lam) - piece and above(right, right + piece):
        right += piece
    return left, right


def _describe(lines: Ordinates, found: Found, extent: tuple[int, int], total: float) -> Peak:
    left, right = extent
    to_hz = 1 / (2 * math.pi * lines.h)
    part = lines.power[left:right]
    averaged = lines.is_averaged(found.start)
    smooth = 1 if averaged else max(1, (found.stop - found.start) // 4)
    smoothed = np.convolve(part, np.ones(smooth) / smooth, mode="same")
    top = int(smoothed.argmax())
    wide = np.flatnonzero(smoothed > found.level + (smoothed[top] - found.level) / 2)
    sharp = int(part.argmax())
    is_narrow = len(wide) <= (NARROW if averaged else LINE_ORDINATES)
    if lines.weight is not None:
        top = sharp if is_narrow else top
    elif _in_few_ordinates(part - found.level, sharp):  # a sharp peak is not smoothed, which would widen it
        # A live spectrum is not examined in this way, since it has few single ordinates: even a resonance at
        # a low frequency could have nearly all its power in a few of them.
        top, wide, is_narrow = sharp, wide[:LINE_ORDINATES], True
    frequency = float(lines.lam[left + top])
    if averaged and is_narrow:
        at = slice(max(top - 1, 0), top + 2)
        above = np.maximum(part[at] - found.level, 0.0) + 1e-300
        frequency = float(np.average(lines.lam[left:right][at], weights=above))
    margins = lines.margin(left), lines.margin(right - 1)
    return Peak(
        kind="resonance" if not is_narrow else "peak" if averaged else "line",
        frequency_hz=frequency * to_hz,
        width_hz=lines.width_hz(left + wide),
        power_share=lines.power_over(left, right, found.level) / total,
        height=height_over(lines.mean(found.start, found.stop), found.level),
        notch_hz=(
            float((lines.lam[left] - margins[0]) * to_hz),
            float((lines.lam[right - 1] + margins[1]) * to_hz),
        ),
    )


def _in_few_ordinates(excess: Array, top: int) -> bool:
    """Return whether nearly all power of a peak lies in the few ordinates around its highest one."""
    half = LINE_ORDINATES // 2
    near = float(excess[max(top - half, 0) : top + half + 1].sum())
    return near > IN_A_LINE * float(excess.sum())


def height_over(power: float, level: float) -> float:
    """Return the ratio of the peak's power to the noise level.

    The ratio is infinite if there is no noise, as in exactly periodic samples.
    """
    return power / level if level > 0 else math.inf
