"""Sums of relaxations, which are AR(1) or Gauss–Markov, in white noise (pure).

A sum of several passes for a fractional order, of which it is a finite piece: over some decades each can be
made as like the other as one wants.
"""

import functools
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fltea.noise import spectra as spectrum
from fltea.spectrum.models import AR1, TWO_AR1, broken_stick, logit, share
from fltea.spectrum.periodogram import Binned
from fltea.spectrum.whittle import Fit, Model

Array = NDArray[np.float64]

MOST = 6
"""Relaxations: one a decade of all that a record of hours shows."""
NAMES = ("white", "ar1", "two_ar1", "three_ar1", "four_ar1", "five_ar1", "six_ar1")
"""The names of the sums by their number of relaxations."""
CORNERS_A_DECADE = 2
NEW_PARTS = (0.1, 1.0)
"""Plateaus of a new relaxation over the spectrum where it has its corner, as starts."""


class Parts(NamedTuple):
    """The parts of a sum of scale 1, which `Fit.scale` is to be multiplied with."""

    poles: Array
    """The φ of each, (..., K)."""
    shares: Array
    """The variances of their innovations, (..., K)."""
    white: Array
    """The variance of the white noise, (...,)."""


@functools.cache
def sum_of(count: int) -> Model:
    """Return a sum of 1 to `MOST` AR(1) in white noise.

    Raises:
        ValueError: there is no such sum.
    """
    if not 1 <= count <= MOST:
        raise ValueError(f"sums are of 1 to {MOST} relaxations, got {count}")
    if count <= 2:
        return AR1 if count == 1 else TWO_AR1

    def shape(lam: Array, theta: Array) -> Array:
        p = sum_parameters(theta, count)
        total = np.repeat(p.white[:, np.newaxis], len(lam), axis=1)
        for k in range(count):
            total += p.shares[:, k, np.newaxis] * spectrum.ar1(lam, p.poles[:, k])
        return total

    # Poles spread over all that can be; what is known better comes as a start of its own.
    poles = logit((1 + np.exp(-(10.0 ** np.linspace(-4, 0.5, count)))) / 2)
    start = np.concatenate([poles, np.linspace(-8, -1, count)])
    return Model(NAMES[count], 2 * count + 1, start[np.newaxis], np.zeros(1, dtype=np.intp), shape)


def sum_parameters(theta: Array, count: int) -> Parts:
    """Return the parameters of coordinates (..., 2 count) of `sum_of`."""
    shares, white = broken_stick(theta[..., count : 2 * count])
    return Parts(2 * share(theta[..., :count]) - 1, shares, white)


def sum_coordinates(poles: Array, shares: Array, white: Array) -> Array:
    """Return the inverse for (..., K), (..., K) and (...,), which need not add up to 1."""
    total = shares.sum(axis=-1) + white
    before = np.cumsum(shares, axis=-1) - shares
    left = np.maximum(total[..., np.newaxis] - before, 1e-300)
    return np.concatenate([logit((1 + poles) / 2), logit(shares / left)], axis=-1)


def grown(data: Binned, found: Fit, count: int) -> Array:
    """Return starts (1, k, p) of a sum of count + 1 from the fit of one of `count` to `data`."""
    p = sum_parameters(found.theta[:1], count)
    # New corners all over the frequencies that the data have.
    low, high = math.log10(data.lam[0] / 2), math.log10(np.pi)
    lam = 10.0 ** np.linspace(low, high, round(CORNERS_A_DECADE * (high - low)) + 1)
    phi = np.exp(-lam)
    level = found.model.shape(np.minimum(lam, np.pi), found.theta[:1])[0]
    starts = []
    for part in NEW_PARTS:
        new = part * level * (1 - phi) ** 2
        poles = np.concatenate([np.broadcast_to(p.poles, (len(lam), count)), phi[:, np.newaxis]], axis=1)
        shares = np.concatenate([np.broadcast_to(p.shares, (len(lam), count)), new[:, np.newaxis]], axis=1)
        starts.append(sum_coordinates(poles, shares, np.broadcast_to(p.white, len(lam))))
    # The same without: the sum is then no worse.
    pole, none = logit((1 + phi[:1]) / 2), np.array([-13.0])
    same = np.concatenate([found.theta[0, :count], pole, found.theta[0, count:], none])
    return np.concatenate([*starts, same[np.newaxis]])[np.newaxis]


def corner_hz(phi: float, h: float) -> float:
    """Return where a relaxation of φ > 0 at h s has its corner; 1 / 2π of it is the correlation time.

    It may be above half the sample rate.
    """
    return -math.log(phi) / (2 * math.pi * h)
