"""Side lobes of a filter that averages over a window. They are humps of the spectrum, but no resonances.

A side lobe is separated from the filter's pass band, which lies at lower frequencies, by a notch of the
filter. The notch is not much wider than the lobe. Next to a resonance there is the noise floor instead, which
is much wider than the resonance. The stop band of the filter begins at the first notch, and contains lobes
and notches. A spectral line in the stop band stands far above all lobes.
"""

import numpy as np

from fltea.records.arrays import Array

DEPTH, BEYOND = 0.2, 0.6
"""In a notch, the power is less than DEPTH times the hump's power. Beyond the notch, in the pass band, the
power is at least BEYOND times the hump's power.
"""
NOTCH_WIDTH = 1.5
"""A notch is at most this many times as wide as the hump."""
TELLING = 30.0
"""A value in the stop band belongs to a spectral line if its power exceeds this multiple of the highest
lobe's power. The multiple is large since the powers of single ordinates scatter.
"""
TELLING_AVERAGED = 5.0
AVERAGED = 8.0
"""If each value is an average over at least this effective number of ordinates, the values scatter less. Then
the smaller factor TELLING_AVERAGED is used instead of TELLING.
"""


def notch_below(lam: Array, power: Array, start: int, stop: int, least: int) -> float | None:
    """Return the frequency at which the notch below a hump begins; None if the hump is no side lobe.

    `start`, `stop`: range of the hump, as indices.

    `lam`, `power`: frequencies and powers, (m,), in the order of rising frequency. `least`: smallest number
    of values over which the power is averaged.
    """
    # A side lobe has a notch below it, and below the notch the filter's pass band. Both are searched for in
    # running means of the power. `wide`: for the pass band, which is at least as wide as the hump, means over
    # the width of the hump. `fine`: for the notch, which may be narrower, means over half that width.
    wide, fine = smoothed(power, max(least, stop - start)), smoothed(power, max(least, (stop - start) // 2))
    top, height = start + int(fine[start:stop].argmax()), float(power[start:stop].mean())
    low = np.flatnonzero(fine[:top] < DEPTH * height)
    if not low.size:
        return None
    bottom = int(low[-1])
    # search for the pass band below the notch, only in means that do not include any part of the hump
    higher = np.flatnonzero(wide[: max(min(bottom, start - (stop - start) // 2), 0)] >= BEYOND * height)
    if not higher.size:
        return None
    edge = int(higher[-1])
    rises = np.flatnonzero(fine[bottom : top + 1] >= BEYOND * height)
    foot = bottom + int(rises[0]) if rises.size else top
    low = np.flatnonzero(fine[top:] < DEPTH * height)
    end = lam[top + int(low[0])] if low.size else 2 * lam[top] - lam[bottom]
    return float(lam[edge]) if lam[foot] - lam[edge] <= NOTCH_WIDTH * (end - lam[bottom]) else None


def smoothed(power: Array, lines: int) -> Array:
    """Return running means over `lines` neighbouring values. Near the ends, fewer values are averaged."""
    # The means are computed from cumulative sums, since a hump of a long record can be a million values wide.
    lines, places = min(lines, len(power)), np.arange(len(power))
    sums = np.concatenate([[0.0], np.cumsum(power)])
    first, last = np.maximum(places - lines // 2, 0), np.minimum(places + (lines - 1) // 2 + 1, len(power))
    return np.asarray((sums[last] - sums[first]) / (last - first))


def lines_among_lobes(power: Array, lines: int, weight: float = 1.0) -> list[tuple[int, int, float]]:
    """Return the spectral lines that stand above all side lobes of a filter's stop band.

    For each line, returns the indices at which it begins and ends, and the power of the highest lobe.

    `power`: powers in the stop band, (m,). `lines`: assumed width of a lobe, as a number of values; a
    spectral line is narrower. `weight`: effective number of ordinates of which each value is the mean.
    """
    if not len(power):
        return []
    telling = TELLING if weight < AVERAGED else TELLING_AVERAGED
    parts = np.array_split(power, max(len(power) // max(lines, 1), 1))
    highest = max(float(np.median(part)) for part in parts) / np.log(2)
    high = np.concatenate([[False], power > telling * highest, [False]])
    edges = np.flatnonzero(high[1:] != high[:-1]).reshape(-1, 2)
    return [(int(a), int(b), highest) for a, b in edges]
