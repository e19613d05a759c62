"""Find a spectral line near a multiple of the sample rate. Aliasing moves such a line to near frequency 0.

An example is mains of 50 Hz, whose frequency wanders a little, sampled at 50 Hz or 25 Hz. In the spectrum,
the aliased line is a wide hump near frequency 0, above the white noise of the sensor. Noise after a low-pass
has the same spectrum. But the oscillation of a line has a constant amplitude, and noise has not. The ratio of
the fourth moment of the samples to their squared second moment shows this: it is 1.5 for an oscillation, and
3 for noise. To suppress the white noise, groups of samples much shorter than a period are averaged first.
"""

import math

import numpy as np

from fltea.records.arrays import Array
from fltea.spectrum.candidate_models import CandidateModels
from fltea.spectrum.spectral_lines import Peak

LEAST_HEIGHT = 30.0
"""The density near frequency 0 must be at least this many times the density at the highest frequencies, which
is that of the white noise.

With a lower hump near frequency 0, white noise would hide the ratio of the moments that shows a line.
"""
EDGE = 1.1
"""The hump in the spectrum near frequency 0 ends where the density falls to this many times the density of
the white noise.
"""
WIDEST = 0.3
"""A line that aliasing moves to near frequency 0 makes a hump in the spectrum. This hump may extend to at
most this fraction of half the sample rate.
"""
ON_ITS_SHOULDER = 0.1
"""The hump in the spectrum near frequency 0 has a main part. It ends at the frequency where the density falls
to this proportion of the density near frequency 0.

Samples are averaged in groups before the test for a line. The groups must be so short that they still show
oscillations of this frequency.
"""
AVERAGED = 6
"""Samples are averaged in groups before the test for a line. This is the number of groups in one period of
the frequency at which the hump's main part ends (`ON_ITS_SHOULDER`).
"""
PARTS = 16
"""Number of parts into which the record is divided, to find the standard error of the ratio of the fourth
moment to the squared second moment.
"""
FEWEST_PERIODS = 100
"""The record must hold at least this many periods of the frequency at which the hump's main part ends
(`ON_ITS_SHOULDER`).

This excludes random walks: their main part ends at so low a frequency that the record has fewer periods of
it.
"""
BETWEEN, SURE = (1.2, 2.3), 5.0
"""The ratio of the fourth moment to the squared second moment is 1.5 for a line, and 3 for noise. A ratio
counts as that of a line if it lies in the range BETWEEN, and below 3 by at least SURE standard errors.

The range excludes 1, which is the ratio for noise that jumps between two values.
"""


def folded_line(y: Array, h: float, candidates: CandidateModels) -> Peak | None:
    """Return the aliased line as a peak at a low frequency, or None if there is no such line.

    `y`: samples, (n,). `h`: sampling period [s]. `candidates`: the candidate models of the spectrum of y.
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
    """Return the ratio of the fourth moment to the squared second moment, and its standard error.

    The moments are those of means of `averaged` successive samples.
    """
    count = len(y) // averaged
    means = y[: count * averaged].reshape(count, averaged).mean(axis=1)
    # Subtract the mean of each part of the record. This removes drift: oscillations longer than a part, of
    # which the record holds too few for an estimate of their moments.
    parts = [one - one.mean() for one in np.array_split(means, PARTS)]
    second = np.array([np.mean(one**2) for one in parts])
    fourth = np.array([np.mean(one**4) for one in parts])
    left_out = np.array(
        [np.delete(fourth, i).mean() / np.delete(second, i).mean() ** 2 for i in range(PARTS)]
    )
    error = math.sqrt((PARTS - 1) / PARTS * float(((left_out - left_out.mean()) ** 2).sum()))
    return float(fourth.mean() / second.mean() ** 2), error
