"""Low-pass filters: a family, whether a spectrum has gone through one, and the spectrum without it (pure).

A chip's own low-pass is the commonest colour of noise that there is. The family is Butterworth's with any
slope, sampled: gain² = sum over branches ν = λ + 2πk of 1 / (1 + (ν²/c)^n), with n poles and its corner at
ν² = c. Relaxations slower than it and a floor of white noise, which comes in after the filter, are fitted
besides it. A low-pass of one pole, sampled, is AR(1): it differs from a relaxation in white noise only by the
floor, of which it has next to none.
"""

import math
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from fltea.noise import spectra as spectrum
from fltea.spectrum.models import broken_stick, logit, share
from fltea.spectrum.periodogram import Binned, Periodogram, check_enough
from fltea.spectrum.residuals import residual_ks
from fltea.spectrum.warm import Search
from fltea.spectrum.whittle import Fit, Model, fit

Array = NDArray[np.float64]

MOST_POLES = 24.0
BRANCHES = (0, -1, 1)
"""Branches of the spectrum before it was sampled, in multiples of the sample rate."""
NAMES = ("low_pass", "low_pass_ar1", "low_pass_two_ar1")
"""The low-pass alone, and with one and two relaxations."""
DEEPEST = 0.1
"""Gain² of the filter below which the family is not fitted: far down filters differ."""
CRITICAL_KS = 1.36
"""95 % point."""
FEWEST_BINS = 16
PASSES = 3
LEAST_GAIN = 0.7
"""The least gain of the ordinates that are kept, where the family's shape errs by little."""
MUCH_SLOWER = 0.2
"""Corners of relaxations over that of the filter, at most."""
LEAST_FALL = 0.8
"""The least fall of the density at half the sample rate: what falls less may be anything."""
STEEP = 1.15
"""Poles from which on it is no relaxation."""


class LowPass(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A low-pass filter that a spectrum has gone through."""

    corner_hz: float
    """Where it lets half of the power through; may be above half the sample rate."""
    poles: float
    """How steep it is: 20 dB a decade each."""
    floor: float
    """Density of what has not gone through it over that of what has, well below the corner."""
    gain: float
    """2 log L above the best model without a steep filter; 0 for a filter of one pole."""


class _Numbers(NamedTuple):
    """The numbers of the family, (k,) each, but for the relaxations."""

    log_c: Array
    poles: Array
    phi: Array
    """The poles φ of the relaxations, (k, slow)."""
    through: Array
    """Density of the low-pass at frequency 0."""
    shares: Array
    """Variances of the relaxations' innovations, (k, slow)."""
    white: Array


def low_pass_parameters(theta: Array) -> _Numbers:
    """Return the parameters of coordinates (k, 3 + 2 slow); the spectrum is of scale 1."""
    first = (theta.shape[1] - 3) // 2 + 2
    shares, white = broken_stick(theta[:, first:])
    return _Numbers(
        theta[:, 0],
        1 + (MOST_POLES - 1) * share(theta[:, 1]),
        2 * share(theta[:, 2:first]) - 1,
        shares[:, 0],
        shares[:, 1:],
        white,
    )


def squared_gain(lam: Array, log_c: Array, poles: Array) -> Array:
    """Return the family's squared gain (k, len(lam)) for numbers (k,), which is a little above 1 at λ = 0."""
    total = np.zeros((len(log_c), len(lam)))
    for branch in BRANCHES:
        ratio = 2 * np.log(np.abs(lam + 2 * np.pi * branch)) - log_c[:, np.newaxis]
        total += 1 / (1 + np.exp(np.minimum(poles[:, np.newaxis] * ratio, 200.0)))
    return total


def _shape(lam: Array, theta: Array) -> Array:
    p = low_pass_parameters(theta)
    total = p.through[:, np.newaxis] * squared_gain(lam, p.log_c, p.poles) + p.white[:, np.newaxis]
    for k in range(p.phi.shape[1]):
        total = total + p.shares[:, k, np.newaxis] * spectrum.ar1(lam, p.phi[:, k])
    return np.asarray(total)


def _low_pass(slow: int) -> Model:
    corners = np.pi * np.array([0.003, 0.01, 0.03, 0.06, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.92])
    axes = [np.arange(len(corners)), np.array([1.3, 3.0]), np.array([1e-4, 0.03])]
    if slow:  # corners over that of the filter, and plateaus over its
        axes += [np.array([1e-3, 1e-2, 0.1, 0.3]), np.array([1.0, 30.0])]
    which, poles, floor, *others = (axis.ravel() for axis in np.meshgrid(*axes, indexing="ij"))
    index = which.astype(np.intp)
    lam = corners[index]
    columns = [2 * np.log(lam), logit((poles - 1) / (MOST_POLES - 1))]
    shares = [np.ones_like(lam)]
    for k in range(slow):
        phi = np.exp(-others[0] * lam * 0.1**k)
        columns.append(logit((1 + phi) / 2))
        shares.append(others[1] * 3.0**k * (1 - phi) ** 2)
    left = floor + sum(shares)
    for one in shares:
        columns.append(logit(one / left))
        left = left - one
    return Model(NAMES[slow], 4 + 2 * slow, np.stack(columns, axis=-1), index, _shape)


LOW_PASS = tuple(_low_pass(slow) for slow in range(len(NAMES)))


def fit_low_pass(data: Binned, search: Search) -> Fit:
    """Return the low-pass of lowest BIC, with as many relaxations as it takes.

    One whose residuals are not white is fitted down to `DEEPEST` of its own gain: below, filters differ most.
    -log L is of all bins.
    """
    best = _best(data, search)
    nll = best.nll
    if residual_ks(data.power[0], best.spectrum(data.lam)[0], data.counts) < CRITICAL_KS:
        return best
    for _ in range(PASSES):
        p = low_pass_parameters(best.theta)
        bins = int((squared_gain(data.lam, p.log_c, p.poles)[0] > DEEPEST).sum())
        if not FEWEST_BINS <= bins < len(data.lam):
            break
        best = _best(Binned(data.lam[:bins], data.counts[:bins], data.power[:, :bins]), fit)
    return best._replace(nll=nll)


def _best(data: Binned, search: Search) -> Fit:
    penalty = math.log(data.ordinates)
    fits = [one for one in (search(data, model) for model in LOW_PASS) if _much_slower(one)]
    return min(fits, key=lambda f: 2 * float(f.nll[0]) + f.model.parameters * penalty)


def _much_slower(found: Fit) -> bool:
    """Return whether what is fitted besides the low-pass is no part of its shape."""
    p = low_pass_parameters(found.theta)
    corners = -np.log(np.maximum(p.phi[0], 1e-9))
    return bool((corners < MUCH_SLOWER * math.exp(float(p.log_c[0]) / 2)).all())


def steep(found: Fit, h: float, gain: float) -> LowPass | None:
    """Return the filter of a fit of `LOW_PASS`, or None if it is no steeper than one pole.

    gain: 2 log L above the best model without it. h in s.
    """
    p = low_pass_parameters(found.theta)
    through, floor = float(p.through[0]), float(p.white[0] / p.through[0])
    ends = squared_gain(np.array([1e-9, np.pi]), p.log_c, p.poles)[0]
    if p.poles[0] < STEEP or not through > 0 or ends[1] + floor > LEAST_FALL * (ends[0] + floor):
        return None
    corner_hz = math.exp(float(p.log_c[0]) / 2) / (2 * np.pi * h)
    return LowPass(corner_hz, float(p.poles[0]), floor, gain)


def of_one_pole(phi: float, floor: float, h: float) -> LowPass:
    """Return the low-pass of one pole, AR(1), of white noise; h is in s, floor as in `LowPass`."""
    return LowPass(-math.log(phi) / (2 * np.pi * h), 1.0, floor, 0.0)


def power_gain(lam: Array, found: LowPass, h: float) -> Array:
    """Return what it has made of the density at λ, (len(lam),); 1 at 0."""
    lam = np.append(1e-9, lam)
    if found.poles == 1.0:
        phi = math.exp(-2 * np.pi * found.corner_hz * h)
        gain = spectrum.ar1(lam, phi)
    else:
        log_c = np.array([2 * math.log(2 * np.pi * found.corner_hz * h)])
        gain = squared_gain(lam, log_c, np.array([found.poles]))[0]
    gain = gain / gain[0]
    return np.asarray((gain[1:] + found.floor) / (1 + found.floor))


def divided(p: Periodogram, found: LowPass) -> Periodogram:
    """Return the one series without the filter, as far up as it lets `LEAST_GAIN` through.

    Raises:
        ValueError: too few ordinates are left.
    """
    gain = power_gain(p.lam, found, p.h)
    inside = gain > LEAST_GAIN
    last = len(gain) if inside.all() else int(np.argmin(inside))
    check_enough(last, p.n)
    weight = None if p.weight is None else p.weight[:last]
    return p._replace(lam=p.lam[:last], power=p.power[..., :last] / gain[:last], weight=weight)
