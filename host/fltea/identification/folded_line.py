"""Find a spectral line near a multiple of the sample rate. Aliasing moves such a line to near frequency 0.

An example is mains of 50 Hz, whose frequency wanders a little, sampled at 50 Hz or 25 Hz. The spectrum looks
like noise behind a low-pass far below half the sample rate, plus white noise of the sensor. But the amplitude
of a line is constant. If its samples are averaged over much less than a period, the ratio of their fourth
moment to the squared second moment is 1.5. For noise this ratio is 3.
"""

import math

import numpy as np

from fltea.records.arrays import Array
from fltea.spectrum.candidate_models import CandidateModels
from fltea.spectrum.spectral_lines import Peak

LEAST_HEIGHT = 30.0
"""The density near frequency 0 must be at least this many times the density at the highest frequencies.

With a smaller ratio, the hump near 0 cannot be told from the white noise.
"""
EDGE = 1.1
"""The hump near frequency 0 ends where the spectral density is this multiple of the white noise's density."""
WIDEST = 0.3
"""The hump that the aliased line makes near frequency 0 may cover at most this proportion of the frequency
range.
"""
ON_ITS_SHOULDER = 0.1
"""The aliased line makes a hump in the spectrum near frequency 0. The hump's main part ends where the density
has fallen to this proportion of the density near frequency 0.

The ratio of the fourth moment to the squared second moment tells a line from noise. It is computed from
averages of a few samples each, which must be short enough to keep oscillations of the frequency at which the
main part ends.
"""
AVERAGED = 6
"""Successive samples are averaged in groups. One period of the oscillation at which the hump's main part ends
(`ON_ITS_SHOULDER`) holds this number of groups.
"""
PARTS = 16
"""Number of parts into which the record is divided, to find the standard error of the ratio of the fourth
moment to the squared second moment.
"""
FEWEST_PERIODS = 100
"""The record must hold at least this many periods of the fastest oscillations in the hump's main part
(`ON_ITS_SHOULDER`).

The power of a random walk is in slower oscillations, of which the record has fewer periods.
"""
BETWEEN, SURE = (1.2, 2.3), 5.0
"""For a line, the ratio of the fourth moment to the squared second moment lies in the range BETWEEN. It is
also below 3, the ratio for noise, by at least SURE standard errors.

The range excludes 1, which is the ratio for noise that jumps between two values.
"""


def folded_line(y: Array, h: float, candidates: CandidateModels) -> Peak | None:
    """Return the hump that a line near a multiple of the sample rate makes in the spectrum of y, or None.

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
    # Subtract the mean of each part of the record. This removes slower oscillations, which are drift and have
    # too few independent values in the record.
    parts = [one - one.mean() for one in np.array_split(means, PARTS)]
    second = np.array([np.mean(one**2) for one in parts])
    fourth = np.array([np.mean(one**4) for one in parts])
    left_out = np.array(
        [np.delete(fourth, i).mean() / np.delete(second, i).mean() ** 2 for i in range(PARTS)]
    )
    error = math.sqrt((PARTS - 1) / PARTS * float(((left_out - left_out.mean()) ** 2).sum()))
    return float(fourth.mean() / second.mean() ** 2), error
