"""A line whose frequency wanders about a multiple of the sample rate, and is seen about frequency 0 (pure).

Mains of 50 Hz that is sampled 50 or 25 times a second is one. Its spectrum is that of noise behind a low-pass
far below half the sample rate, with white noise of the reader behind that. What distinguishes it is that it
oscillates with one amplitude: of its samples, averaged over far less than a period, the fourth moment over
the squared second one is 1.5, and of noise 3.
"""

import math

import numpy as np

from fltea.records.arrays import Array
from fltea.spectrum.candidate_models import CandidateModels
from fltea.spectrum.spectral_lines import Peak

LEAST_HEIGHT = 30.0
"""The density about frequency 0 over that at the highest frequencies, below which N is that of both."""
EDGE = 1.1
"""The density over that of the floor at which the hump ends."""
WIDEST = 0.3
"""The largest share of the band in the hump."""
ON_ITS_SHOULDER = 0.1
"""Share of the density about 0 that the fastest oscillations have which are not averaged away."""
AVERAGED = 6
"""Averages in a period of these."""
PARTS = 16
"""Parts of the record, whose spread gives the error of the ratio of moments."""
FEWEST_PERIODS = 100
"""Periods of the fastest oscillations in the record: a walk has its power in fewer."""
BETWEEN, SURE = (1.2, 2.3), 5.0
"""Where the ratio of moments is, and the standard errors by which it is below that of noise: two values
between which noise jumps have a ratio of 1."""


def folded_line(y: Array, h: float, candidates: CandidateModels) -> Peak | None:
    """Return the hump of such a line in y (n,), or None.

    frontier: the models of its spectrum. h: sampling period in s.
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
    """Return the fourth moment of means over the squared second one, and its standard error."""
    count = len(y) // averaged
    means = y[: count * averaged].reshape(count, averaged).mean(axis=1)
    # What is slower than a part is drift, which is of few values.
    parts = [one - one.mean() for one in np.array_split(means, PARTS)]
    second = np.array([np.mean(one**2) for one in parts])
    fourth = np.array([np.mean(one**4) for one in parts])
    left_out = np.array(
        [np.delete(fourth, i).mean() / np.delete(second, i).mean() ** 2 for i in range(PARTS)]
    )
    error = math.sqrt((PARTS - 1) / PARTS * float(((left_out - left_out.mean()) ** 2).sum()))
    return float(fourth.mean() / second.mean() ** 2), error
