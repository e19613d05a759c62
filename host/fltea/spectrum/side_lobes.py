"""Side lobes of a filter that averages over a window. They are humps of the spectrum, but no resonances.

A side lobe is separated from the filter's pass band, which lies at lower frequencies, by a notch of the
filter. The notch is not much wider than the lobe. Next to a resonance there is the noise floor instead, which
is much wider than the resonance. The stop band of the filter begins at the first notch, and contains lobes
and notches. A spectral line in the stop band stands far above all lobes.
"""

import numpy as np

from fltea.records.arrays import Array

DEPTH, BEYOND = 0.2, 0.6
"""The power in a notch is below DEPTH times that of the hump. The power on the other side of the notch is at
least BEYOND times that of the hump.
"""
NOTCH_WIDTH = 1.5
"""A notch is at most this many times as wide as the hump."""
TELLING = 30.0
"""A value in the stop band belongs to a spectral line if its power exceeds this multiple of the highest
lobe's power. The multiple is large since the powers of single ordinates scatter.
"""
TELLING_AVERAGED = 5.0
AVERAGED = 8.0
"""For values that average at least this effective number of ordinates, the smaller factor TELLING_AVERAGED
takes the place of TELLING.
"""


def notch_below(lam: Array, power: Array, start: int, stop: int, least: int) -> float | None:
    """Return the frequency at which the notch below a hump begins; None if the hump is no side lobe.

    `start`, `stop`: range of the hump, as indices.

    `lam`, `power`: frequencies and powers, (m,), in the order of rising frequency. `least`: smallest number
    of values over which the power is averaged.
    """
    # Powers are averaged over neighbouring values. `wide`: on the far side of the notch, the pass band is at
    # least as wide as the hump, so averages there are as wide as the hump. `fine`: the notch may be narrower
    # than the hump, so averages in it are half as wide.
    wide, fine = smoothed(power, max(least, stop - start)), smoothed(power, max(least, (stop - start) // 2))
    top, height = start + int(fine[start:stop].argmax()), float(power[start:stop].mean())
    low = np.flatnonzero(fine[:top] < DEPTH * height)
    if not low.size:
        return None
    bottom = int(low[-1])
    # Beyond the notch, only averages that do not include any part of the hump are considered.
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
    """Return begin, end and surrounding level of each peak above all lobes of a stop band.

    `power`: powers in the stop band, (m,).

    `lines`: number of values that a whole lobe or notch takes; a narrow spectral line takes only a few.
    `weight`: number of ordinates that each value averages.
    """
    if not len(power):
        return []
    telling = TELLING if weight < AVERAGED else TELLING_AVERAGED
    parts = np.array_split(power, max(len(power) // max(lines, 1), 1))
    highest = max(float(np.median(part)) for part in parts) / np.log(2)
    high = np.concatenate([[False], power > telling * highest, [False]])
    edges = np.flatnonzero(high[1:] != high[:-1]).reshape(-1, 2)
    return [(int(a), int(b), highest) for a, b in edges]
