"""Intervals of the fractional model's parameters by profile likelihood (pure).

A value belongs to the interval if the best fit that has it is at most 3.84 in 2 log L below the best of all
(95 % of χ² with one degree). Unlike the curvature at the maximum this also holds where α and g cannot be told
apart; there the interval takes in nearly all that is possible, and the parameter is undefined.

R cannot be below 0. Where the best fit that has a value has no white noise, the ratio of likelihoods is not
χ²: R can only be too large, and then α or F is too large with it. The critical value is 4.6 there.
The search is native (host/native/whittle_profile.hpp).
"""

import math
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from fltea import _native
from fltea.noise import spectra as spectrum
from fltea.spectrum.models import WHITE, parameters
from fltea.spectrum.periodogram import Binned
from fltea.spectrum.warm import Warm
from fltea.spectrum.whittle import HOLDS, Fit, fit

Array = NDArray[np.float64]

CRITICAL = 3.841
"""95 % point of χ² with one degree of freedom."""
CRITICAL_AT_BOUND = 4.6
"""The same where the best fit that has the value has no white noise.

Of long records the worst, with R and the parameter fully correlated, is 4.24 (a mixture of χ²; Self & Liang,
*JASA* 82, 1987), and short ones need more. With 4.6 the true α, f and F of 35 noises without R are inside in
95 to 96 % on average, in 90 % at worst (tools/bench/bound_tables.py)."""
NEARLY_ALL = 0.9
"""Share of the possible range from which on a parameter is undefined."""
LOWEST = 1e-6
"""Positive parameters are searched for from here on, in units of the largest possible; less is 0."""


class Parameter(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A fitted parameter; low and high are the ends of its 95 % interval, both None where it is undefined."""

    value: float
    low: float | None
    high: float | None

    @property
    def defined(self) -> bool:
        """Whether the data say anything about it."""
        return self.low is not None


class FractionalFit(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The fractional state in white noise, fitted; f and Q as in `fltea.noise.simulation`.

    Variances are in the square of the unit of y.
    """

    F: Parameter
    """g + α: what the data say most about, the weight of the last state in the next"""
    alpha: Parameter
    g: Parameter
    """h^α f"""
    f: Parameter
    """in s^-α"""
    s2: Parameter
    """h^2α Q"""
    R: Parameter
    Q: float
    """s2 h^-2α"""


class _Profile(NamedTuple):
    """A parameter: its best value, and what is possible."""

    hold: str
    value: float
    low: float
    high: float
    positive: bool = True
    """searched for in its logarithm"""

    def row(self) -> tuple[float, ...]:
        """What the native search takes: enum Hold, whether in the logarithm, best value, low and high."""
        low, high, here = self.low, self.high, self.value
        if self.positive:
            low, high, here = math.log(LOWEST * high), math.log(high), math.log(max(here, 1e-300))
        return HOLDS[self.hold], self.positive, min(max(here, low), high), low, high

    def parameter(self, low: float, high: float) -> Parameter:
        """Of the ends that the native search returns."""
        if self.positive:
            low, high = (0.0 if v <= self.row()[3] else math.exp(v) for v in (low, high))
        if high - low >= NEARLY_ALL * (self.high - self.low) / (2 if self.positive else 1):
            return Parameter(self.value, None, None)
        return Parameter(self.value, min(low, self.value), max(high, self.value))


def fractional_fit(
    data: Binned, found: Fit, h: float, *, white: bool = False, warm: Warm | None = None
) -> FractionalFit:
    """Profile the one series of `data`, whose fit of the model FULL is `found`; h in s.

    white: the null test does not reject white noise, in which none of the parameters is defined. warm: holds
    the ends of the last search, about which those of now are looked for first; they are replaced.

    Raises:
        ValueError: no spectrum can be fitted to the data, as for `whittle.fit`.
    """
    p = parameters(found.theta[0])
    alpha, g, weight, scale = float(p.alpha), float(p.g), float(p.weight), float(found.scale[0])
    f, s2, R = spectrum.f_of(alpha, g, h), weight * scale, (1 - weight) * scale
    power = float(fit(data._replace(power=data.power[:1]), WHITE).scale[0])
    profiles = (
        _Profile("F", g + alpha, -2.0, 2.0, positive=False),  # α - 2^α < F < α
        _Profile("alpha", alpha, 0.0, spectrum.HIGHEST_ORDER - 1e-4, positive=False),
        _Profile("g", -g, 0.0, 4.0),
        _Profile("f", -f, 0.0, 4 * max(1.0, h**-2)),
        _Profile("s2", s2, 0.0, 2 * power),
        _Profile("R", R, 0.0, 2 * power),
    )
    if white:
        F, order, minus_g, minus_f, state, noise = (Parameter(one.value, None, None) for one in profiles)
    else:
        ends = _ends(data, found, h, profiles, warm.ends if warm else None)
        if warm:
            warm.ends = ends
        F, order, minus_g, minus_f, state, noise = (
            one.parameter(*pair) for one, pair in zip(profiles, ends.tolist(), strict=True)
        )
    told_apart = order.defined and minus_g.defined
    return FractionalFit(
        F=F,
        alpha=order,
        g=_negative(minus_g),
        f=_negative(minus_f) if told_apart else Parameter(f, None, None),
        s2=state,
        R=noise,
        Q=spectrum.noise_variance(alpha, s2, h),
    )


def _ends(data: Binned, found: Fit, h: float, profiles: tuple[_Profile, ...], near: Array | None) -> Array:
    """Low and high of each as they are searched for, (profiles, 2)."""
    ends = np.empty((len(profiles), 2))
    _native.whittle_intervals(
        np.ascontiguousarray(data.lam, dtype=np.float64),
        np.ascontiguousarray(data.counts, dtype=np.float64),
        np.ascontiguousarray(data.power[:1], dtype=np.float64),
        np.ascontiguousarray(found.theta[0], dtype=np.float64),
        scale=float(found.scale[0]),
        nll=float(found.nll[0]),
        critical=CRITICAL,
        at_bound=CRITICAL_AT_BOUND,
        h=h,
        what=np.array([one.row() for one in profiles]),
        near=near,
        ends=ends,
    )
    return ends


def _negative(p: Parameter) -> Parameter:
    """Of -p to p."""
    if p.low is None or p.high is None:
        return Parameter(-p.value, None, None)
    return Parameter(-p.value, -p.high, -p.low)
