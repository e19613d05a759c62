"""Low-pass filters: a family, whether a spectrum has gone through one, and the spectrum without it (pure).

A chip's own low-pass is the commonest colour of noise that there is. The family is Butterworth's with any
slope: gain² = 1 / (1 + (x²/c)^n), x = 2 sin(λ/2), with n poles and the gain² 1/2 at x² = c. n = 1 is the
low-pass of one pole to the last digit, also sampled at any lower rate: AR(1). There may be slow relaxations
and a floor of white noise beside it, which comes in after the filter or from above half the rate.
"""

import msgspec
import numpy as np
from numpy.typing import NDArray

from fltea.noise import spectra as spectrum
from fltea.spectrum.models import logit, share
from fltea.spectrum.whittle import Model

Array = NDArray[np.float64]

MOST_POLES = 8.0
MOST_SLOW = 2
"""Relaxations beside it."""


class LowPass(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A low-pass filter that a spectrum has gone through."""

    corner_hz: float
    """where it lets half of the power through"""
    poles: float
    """how steep it is: 20 dB a decade each"""
    floor: float
    """density of what has not gone through it, over that of what has, below the corner"""
    gain: float
    """by how much 2 log L is higher than of the best model without"""


def low_pass_parameters(theta: Array, slow: int) -> tuple[Array, Array, Array, Array, Array, Array]:
    """Of coordinates (..., 3 + 2 slow): log c, n, φ (..., slow), share of the filter, theirs, white noise's.

    The share of the filter is its density at frequency 0, theirs are variances of innovations.
    """
    first = 2 + slow
    poles = 1 + (MOST_POLES - 1) * share(theta[..., 1])
    phi = 2 * share(theta[..., 2:first]) - 1
    taken, rest = [], np.ones(theta.shape[:-1])
    for k in range(first, theta.shape[-1]):
        part = rest * share(theta[..., k])
        taken.append(part)
        rest = rest - part
    shares = np.stack(taken, axis=-1)
    return np.asarray(theta[..., 0]), poles, phi, shares[..., 0], shares[..., 1:], rest


def _low_pass(slow: int) -> Model:
    def shape(lam: Array, theta: Array) -> Array:
        log_c, n, phi, through, shares, white = low_pass_parameters(theta, slow)
        total = through[:, np.newaxis] * squared_gain(lam, log_c, n) + white[:, np.newaxis]
        for k in range(slow):
            total = total + shares[:, k, np.newaxis] * spectrum.ar1(lam, phi[:, k])
        return np.asarray(total)

    corners = np.pi * np.array([0.003, 0.01, 0.03, 0.06, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.92])
    slow_corners = np.array([1e-3, 1e-2, 0.1, 0.3])
    plateaus = np.array([1.0, 30.0])
    axes = [np.arange(len(corners)), np.array([1.3, 3.0]), np.array([1e-4, 0.03])]
    if slow:
        axes += [slow_corners, plateaus]
    which, n, floor, *beside = (axis.ravel() for axis in np.meshgrid(*axes, indexing="ij"))
    index = which.astype(np.intp)
    lam = corners[index]
    columns = [2 * np.log(2 * np.sin(lam / 2)), logit((n - 1) / (MOST_POLES - 1))]
    shares = []
    for k in range(slow):
        phi = np.exp(-beside[0] * lam * 0.1**k)
        columns.append(logit((1 + phi) / 2))
        shares.append(beside[1] * 3.0**k * (1 - phi) ** 2)
    columns.append(logit(1 / (1 + floor + sum(shares))))
    left = floor + sum(shares)
    for one in shares:
        columns.append(logit(one / left))
        left = left - one
    name = ("low_pass", "low_pass_ar1", "low_pass_two_ar1")[slow]
    return Model(name, 4 + 2 * slow, np.stack(columns, axis=-1), index, shape)


def squared_gain(lam: Array, log_c: Array, n: Array) -> Array:
    """Of the family, (k, len(lam)) for (k,) numbers each."""
    x = 2 * np.log(2 * np.sin(lam / 2)) - log_c[:, np.newaxis]
    return np.asarray(1 / (1 + np.exp(np.minimum(n[:, np.newaxis] * x, 200.0))))


LOW_PASS = tuple(_low_pass(slow) for slow in range(MOST_SLOW + 1))
"""Alone, and with one and two relaxations beside it."""
