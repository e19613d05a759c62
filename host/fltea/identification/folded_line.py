"""Find a line that wanders about a multiple of the sample rate, and is therefore seen near frequency 0.

Mains of 50 Hz sampled at 50 Hz or 25 Hz is an example. Its spectrum looks like noise behind a low-pass far
below half the sample rate, plus white noise of the sensor. But the line oscillates with one amplitude.
Averaged over far less than a period, its samples have a fourth moment of 1.5 times the squared second moment;
noise has 3.
"""

import math

import numpy as np

from fltea.records.arrays import Array
from fltea.spectrum.candidate_models import CandidateModels
from fltea.spectrum.spectral_lines import Peak

LEAST_HEIGHT = 30.0
"""Least ratio of the density near frequency 0 to that at the highest frequencies.

With a smaller ratio, N would include both.
"""
EDGE = 1.1
"""Ratio of the density to that of the floor at which the hump ends."""
WIDEST = 0.3
"""Largest share of the band that the hump may cover."""
ON_ITS_SHOULDER = 0.1
"""Share of the density near 0 that the fastest oscillations still have; averaging must keep these."""
AVERAGED = 6
"""Number of averages in a period of these fastest oscillations."""
PARTS = 16
"""Number of parts of the record; their spread gives the error of the ratio of moments."""
FEWEST_PERIODS = 100
"""Least number of periods of the fastest oscillations; a random walk has its power in fewer periods."""
BETWEEN, SURE = (1.2, 2.3), 5.0
"""Range of the ratio of moments, and the number of standard errors by which it must be below that of noise.

A ratio of 1 is excluded, since noise that jumps between two values has it.
"""


def folded_line(y: Array, h: float, candidates: CandidateModels) -> Peak | None:
    """Return the hump of such a line in y (n,), or None.

    `h`: sampling period [s]. `frontier`: the candidate models of the spectrum of y.
    """
    lam = candidates.data.lam
    density = candidates.plain.spectrum(lam, h)
    floor, top = float(np.median(density[lam > lam[-1] / 2])), float(density[:8].mean())
    if top < LEAST_HEIGHT * floor:
        return None
    edge = float(lam[int(np.flatnonzero(density > EDGE * floor)[-1])])
    shoulder = float(lam[int(np.flatnonzero(density > ON_ITS_SHOULDER * top)[-1])])
    if edge > WIDEST * lam[-1] or shoulder * len(y) / (2 * np.pi) < FEWEST_PERIODS:
        return None
    ratio, error = _moments(y, max(1, int(2 * np.pi / (AVERAGED * shoulder))))
    if not BETWEEN[0] < ratio < BETWEEN[1] or 3 - ratio < SURE * error:
        return None
    to_hz = 1 / (2 * np.pi * h)
    inside = lam <= edge
    counts, power = candidates.data.counts, candidates.data.power[0]
    excess = float((counts * (power - floor))[inside].sum() / (counts * power).sum())
    return Peak(
        kind="resonance",
        frequency_hz=shoulder * to_hz / 2,
        width_hz=shoulder * to_hz,
        power_share=min(max(excess, 0.0), 1.0),
        height=top / floor,
        notch_hz=(0.0, edge * to_hz),
    )


def _moments(y: Array, averaged: int) -> tuple[float, float]:
    """Return the fourth moment of averaged samples over their squared second moment, and its error."""
    count = len(y) // averaged
    means = y[: count * averaged].reshape(count, averaged).mean(axis=1)
    # Remove what is slower than a part: it is drift, which has only a few independent values.
    parts = [one - one.mean() for one in np.array_split(means, PARTS)]
    second = np.array([np.mean(one**2) for one in parts])
    fourth = np.array([np.mean(one**4) for one in parts])
    left_out = np.array(
        [np.delete(fourth, i).mean() / np.delete(second, i).mean() ** 2 for i in range(PARTS)]
    )
    error = math.sqrt((PARTS - 1) / PARTS * float(((left_out - left_out.mean()) ** 2).sum()))
    return float(fourth.mean() / second.mean() ** 2), error
