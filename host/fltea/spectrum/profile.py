"""Intervals of the fractional model's parameters by profile likelihood (pure).

A value belongs to the interval if the best fit that has it is at most 3.84 in 2 log L below the best of all
(95 % of χ² with one degree). Unlike the curvature at the maximum this also holds where α and g cannot be told
apart; there the interval takes in nearly all that is possible, and the parameter is undefined.

R cannot be below 0. Where the best fit that has a value has no white noise, the ratio of likelihoods is not
χ²: R can only be too large, and then another parameter is too large or too small with it (`AT_BOUND`).

Where the best order is above 1, a peak in the spectrum, and an order up to 1 does nearly as well, chance may
have made the peak, since there are many places for one. F, f, s2 and R of the two are far apart. Their values
are then inside by what they are below the best order up to 1 (`APART`).
The search is native (host/native/whittle_profile.hpp).
"""

import math
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from fltea import _native
from fltea.noise import spectra as spectrum
from fltea.spectrum.models import UP_TO_ONE, WHITE, parameters
from fltea.spectrum.periodogram import Binned
from fltea.spectrum.warm import Warm
from fltea.spectrum.whittle import HOLDS, Fit, fit

Array = NDArray[np.float64]

CRITICAL = 3.841
"""95 % point of χ² with one degree of freedom."""
AT_BOUND = {"alpha": 4.8, "g": 4.6, "f": 4.6, "F": 5.1, "s2": 5.1}
"""The same where the best fit that has the value has no white noise.

That of two normal estimates with the correlation ρ, of which the second cannot be below 0 and is there while
the first is held: 4.4 for |ρ| = 0.8, 4.7 for 0.9, 4.8 for 0.95 and 5.1 for 1 (the law is Self & Liang's,
*JASA* 82, 1987). Nine tenths of 35 noises with R = 0 have, by the information, up to 0.9 between f and R,
0.95 between α and R, 0.99 for F and 1 for s2 (tools/validation/bound.py)."""
NO_WHITE = 1e-3
"""R over s2: less is none; so in the native search."""
APART = 6.0
"""The difference in 2 log L up to which an order above 1 may be chance, as `rivals.APART`."""
JUMPS = ("F", "g", "f", "s2", "R")
"""What is far off where chance has made a peak. α itself says which of both it is: its ratio stays χ²."""
OWN_MAXIMUM = 0.999
"""Orders up to 1 that do best at a higher one lead up to the order above 1 without a valley between."""
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
    """F = g + α, the weight of the last state in the next, which the data say most about."""
    alpha: Parameter
    g: Parameter
    """The parameter g = h^α f."""
    f: Parameter
    """The parameter f in s^-α."""
    s2: Parameter
    """The variance s2 = h^2α Q."""
    R: Parameter
    Q: float
    """The variance Q = s2 h^-2α."""


def critical_value(name: str, no_white: bool) -> float:
    """Return how far below the best 2 log L may be for a value to be in the interval.

    no_white: the best fit that has the value has no white noise.
    """
    return AT_BOUND.get(name, CRITICAL) if no_white else CRITICAL


class _Profile(NamedTuple):
    """A parameter: its best value, and what is possible."""

    hold: str
    value: float
    low: float
    high: float
    positive: bool = True
    """Whether it is searched for in its logarithm."""

    def row(self, more: float = 0.0) -> tuple[float, ...]:
        """Return what the native search takes.

        That is enum Hold, whether in the logarithm, best value, low and high, and the critical values for
        R > 0 and R = 0, `more` than they are by themselves.
        """
        low, high, here = self.low, self.high, self.value
        if self.positive:
            low, high, here = math.log(LOWEST * high), math.log(high), math.log(max(here, 1e-300))
        critical = (critical_value(self.hold, no_white) + more for no_white in (False, True))
        return HOLDS[self.hold], self.positive, min(max(here, low), high), low, high, *critical

    def parameter(self, low: float, high: float) -> Parameter:
        """Return the parameter with the ends that the native search returns."""
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
    distinct = order.defined and minus_g.defined
    return FractionalFit(
        F=F,
        alpha=order,
        g=_negative(minus_g),
        f=_negative(minus_f) if distinct else Parameter(f, None, None),
        s2=state,
        R=noise,
        Q=spectrum.noise_variance(alpha, s2, h),
    )


def below_by_chance(data: Binned, found: Fit) -> float:
    """Return by how much orders up to 1 are worse than one above 1 that may be chance, in 2 log L."""
    if float(parameters(found.theta[0]).alpha) <= 1:
        return 0.0
    other = fit(data, UP_TO_ONE)
    if float(parameters(other.theta[0]).alpha) > OWN_MAXIMUM:
        return 0.0
    below = 2 * float(other.nll[0] - found.nll[0])
    return below if 0 < below <= APART else 0.0


def _ends(data: Binned, found: Fit, h: float, profiles: tuple[_Profile, ...], near: Array | None) -> Array:
    """Return the low and high of each as they are searched for, (profiles, 2)."""
    ends = np.empty((len(profiles), 2))
    chance = below_by_chance(data, found)
    rows = [one.row(chance if one.hold in JUMPS else 0.0) for one in profiles]
    _native.whittle_intervals(
        np.ascontiguousarray(data.lam, dtype=np.float64),
        np.ascontiguousarray(data.counts, dtype=np.float64),
        np.ascontiguousarray(data.power[:1], dtype=np.float64),
        np.ascontiguousarray(found.theta[0], dtype=np.float64),
        scale=float(found.scale[0]),
        nll=float(found.nll[0]),
        h=h,
        what=np.array(rows),
        near=near,
        ends=ends,
    )
    return ends


def _negative(p: Parameter) -> Parameter:
    """Return the interval with its signs changed."""
    if p.low is None or p.high is None:
        return Parameter(-p.value, None, None)
    return Parameter(-p.value, -p.high, -p.low)
