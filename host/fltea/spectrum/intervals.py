"""Intervals of the parameters of a noise model by profile likelihood.

A value belongs to the interval if 2 log L of the best fit with this value is at most 3.84 (95 % of χ² with
one degree of freedom) below the highest one. Unlike the curvature at the maximum, this rule holds where the
data cannot separate α from f, where a correlation time has only a lower bound, and where white noise below
other noise has only an upper bound. An end is None where all values on that side belong to the interval.

The variance R of the white noise cannot be below 0. If the best fit with a given value has R = 0, the
likelihood ratio does not follow χ²: an estimate of R can then only be too large, and this error shifts the
other parameters. For such fits the larger limits `AT_BOUND` are used.

The likelihood of an order sometimes has a second maximum far from the first. So the whole range of orders is
searched, and all orders that are as good as the interval's ends belong to the interval.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import msgspec
import numpy as np

from fltea.noise.coordinates import g_of_eta
from fltea.noise.part import BY_NAME, ROWS
from fltea.noise.parts import (
    Arfima,
    Order,
    Walk,
    free_of,
    kind_of,
    part_of,
)
from fltea.noise.spectra import f_of
from fltea.records.fit import Interval
from fltea.records.plus_minus import NORMAL_95
from fltea.spectrum.candidate_models import AT_A_LIMIT, LEAK_OF_CUBIC, CandidateModels, FittedModel, leaking
from fltea.spectrum.information import slopes

CRITICAL = 3.841
"""95 % point of χ² with one degree of freedom."""
AT_BOUND = {"alpha": 4.8, "f": 4.6, "F": 5.1, "s2": 5.1}
"""Limits that replace CRITICAL for these parameters if the best fit with a given value has no white noise.
Each is the 95 % point of a likelihood ratio for two normal estimates with the correlation ρ. The second, here
the white noise's variance R, cannot be below 0. The points are 4.4 for |ρ| = 0.8, 4.7 for 0.9, 4.8 for 0.95
and 5.1 for 1 (Self & Liang, *JASA* 82, 1987). The correlation between each parameter and R was computed from
the Fisher information of 35 noises with R = 0. In nine tenths of them it is at most 0.9 for f, 0.95 for α,
0.99 for F and 1 for s2 (tools/validation/bound.py).
"""
LEAST = 7.0
"""A variance counts as 0 if its logarithm is lower by more than this than the logarithm of the best value."""
LITTLE = 4.0
"""Logarithm of a ratio: power at the highest frequencies, divided by the small amount of white noise with
which some fits start (`little_white`).
"""
SLOWEST = 300.0
"""The longest correlation time that is tried, divided by the longest one that the data can show."""
WIDEST_ORDER = 0.9
"""The order α counts as undefined if its 95 % interval is wider than this."""
BY_F, BY_PARAMETER, BY_NOISE, BY_STEP = (
    BY_NAME[name].code for name in ("order by F", "order by f", "order by Q", "arfima by s2")
)
"""Code numbers of parts that describe an order or ARFIMA by other free parameters than the parts in
`fltea.noise.parts` do. So a fit can keep such a parameter at a fixed value. `OrderFit` explains the letters.
In `fltea.noise.parts`, the free parameters of an order are α, logit(-g / 2^α) and log s2. BY_F has F and log
-g in place of the first two, and BY_PARAMETER has α and log -f. BY_NOISE has log Q in place of log s2. ARFIMA
has log s2 / (1 - φ)² as a free parameter, and BY_STEP has log s2 in its place.
"""
HIGHEST_ORDER = 1.999
LOOKED_AT = np.arange(0.04, 1.3, 0.08)
"""Orders at which a second maximum of the likelihood is searched for."""


class Ends(NamedTuple):
    """A value, and the ends of its 95 % interval."""

    value: float
    low: float
    high: float

    def exp(self) -> "Ends":
        """Return the interval of a quantity, if this is the interval of its logarithm.

        A lower end at the limit of the search, below which a variance counts as 0, becomes 0.
        """
        low = 0.0 if self.low <= self.value - LEAST else math.exp(self.low)
        return Ends(math.exp(self.value), low, math.exp(self.high))

    def negative(self) -> "Ends":
        """Return the interval with its sign changed."""
        return Ends(-self.value, -self.high, -self.low)

    def including(self, value: float) -> "Ends":
        """Return the interval extended so that it includes `value`."""
        return Ends(self.value, min(self.low, value), max(self.high, value))

    def with_another(self, other: "Ends") -> "Ends":
        """Return the interval that covers both intervals."""
        return Ends(self.value, min(self.low, other.low), max(self.high, other.high))


class Estimated(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A part of a noise model: its parameters with their intervals, in the units of `fltea.noise.parts`."""

    part: str
    values: dict[str, Interval]

    def value(self, name: str) -> float:
        found = self.values[name].value
        assert found is not None
        return found


class OrderFit(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Order and other parameters of a noise model. If the data do not define them, all values are None.

    F = g + α, g = h^α f, h: sampling period. Variances: s2 of the state's steps, R of white noise, in unit².
    """

    alpha: Interval = Interval()
    f: Interval = Interval()
    F: Interval = Interval()
    s2: Interval = Interval()
    R: Interval = Interval()
    arfima: bool = False
    """Whether the order is that of ARFIMA(1, d, 0), for which α is d and f has no meaning."""


def estimated(f: CandidateModels, model: FittedModel) -> tuple[Estimated, ...]:
    """Return the parts of a model, each with its parameters and their intervals."""
    found = []
    for code, at in model.terms():
        free = free_of(code)
        part = part_of(code, model.eta[at : at + free], f.h)
        values = _of_order(f, model, code, at)
        for k, name in enumerate(part.__struct_fields__):
            value = float(getattr(part, name))
            if name in values:
                continue
            if k >= free:  # a parameter of this kind, such as the number of samples of a mean, is not fitted
                values[name] = Interval(value, value, value)
                continue
            low, high = (
                interval_end(f, model, at + k, side, *_limits(f, code, k, model.eta[at + k], side))
                for side in (-1, 1)
            )
            ends = [
                None if end is None else _at(code, model.eta[at : at + free], k, end, f.h, name)
                for end in (low, high)
            ]
            if kind_of(code) is Walk:
                ends = [_wider(f, model, at, value, end) for end in ends]
            if _falls(ends, value):
                ends.reverse()
            values[name] = Interval(value, *ends)
        in_order = {name: values[name] for name in part.__struct_fields__}
        found.append(Estimated(str(part.__struct_config__.tag), in_order))
    return tuple(found)


def _of_order(f: CandidateModels, model: FittedModel, code: int, at: int) -> dict[str, Interval]:
    """Return the intervals of those parameters of an order or of ARFIMA that need more than one search.

    Such a parameter depends on several transformed parameters, or its likelihood may have several maxima. For
    a part of any other kind the result is empty.
    """
    if kind_of(code) not in (Order, Arfima):
        return {}
    part, order = part_of(code, model.eta[at : at + free_of(code)], f.h), order_fit(f, model)
    if isinstance(part, Arfima):
        return {"d": _with_value(order.alpha, part.d), "s2": _step(f, model, at)}
    assert isinstance(part, Order)
    known = {"alpha": _with_value(order.alpha, part.alpha), "f": _with_value(order.f, part.f)}
    return known | {"Q": _noise(f, model, at, part.Q)}


def _with_value(found: Interval, value: float) -> Interval:
    """Return the interval `found`. If it has no value, return `value` without ends."""
    return found if found.value is not None else Interval(value)


def _step(f: CandidateModels, model: FittedModel, at: int) -> Interval:
    """Return the variance s2 of the steps that drive an ARFIMA, with its interval."""
    d, rate, level = model.eta[at : at + 3]
    log_s2 = level + 2 * math.log(-math.expm1(-math.exp(rate)))
    by_step = _other(model, at, BY_STEP, [d, rate, log_s2])
    return Interval(*_interval(f, by_step, at + 2, "s2", around(f, log_s2)).exp())


def _noise(f: CandidateModels, model: FittedModel, at: int, Q: float) -> Interval:
    """Return the variance Q of the noise that drives an order, with its interval."""
    alpha, logit = model.eta[at : at + 2]
    by_noise = _other(model, at, BY_NOISE, [alpha, logit, math.log(Q)])
    reach = LEAST + 4 * abs(math.log(f.h))
    ends = [
        interval_end(f, by_noise, at + 2, side, math.log(Q) + side * reach, 0.1, AT_BOUND["s2"])
        for side in (-1, 1)
    ]
    return Interval(Q, *(None if one is None else math.exp(one) for one in ends))


def order_fit(f: CandidateModels, model: FittedModel) -> OrderFit:
    """Return the order of a model with an order, and its other parameters, with their intervals."""
    arfima = model.place(Order) is None
    at = model.place(Order, Arfima)
    assert at is not None
    here = model.eta
    # the fit has the highest allowed order, so the true order may be even higher
    if not arfima and here[at] > HIGHEST_ORDER - AT_A_LIMIT:
        return OrderFit()
    if arfima:
        alpha = _interval(f, model, at, "alpha", (0.0, 1.0), 0.03)
        R = _interval(f, model, 0, "R", around(f, here[0])).exp()
        return OrderFit(_if_known(alpha), s2=_step(f, model, at), R=Interval(*R), arfima=True)
    found = _of_maximum(f, model, at)
    starts = _elsewhere(f, model, at)
    f.fits.elsewhere = []
    for eta in starts:
        if all(one.low <= value <= one.high for one, value in zip(found, _values(f, eta, at), strict=True)):
            continue
        f.fits.elsewhere.append(eta)
        there, _ = f.native.fit(list(model.codes), eta)
        other = model._replace(eta=tuple(there))
        wider = [
            one.with_another(two) for one, two in zip(found, _of_maximum(f, other, at, False), strict=True)
        ]
        found = [one.including(value) for one, value in zip(wider, _values(f, eta, at), strict=True)]
    alpha, F, minus_f, s2, R = found
    order = _if_known(alpha)
    parameter = Interval() if order.value is None else Interval(*minus_f.negative())
    return OrderFit(order, parameter, Interval(*F), Interval(*s2), Interval(*R))


def _of_maximum(f: CandidateModels, model: FittedModel, at: int, first: bool = True) -> list[Ends]:
    """Return α, F, -f, s2 and R, each with the interval around one maximum of the likelihood.

    `first`: whether this is the highest maximum of the likelihood. The ends around another maximum are not
    stored for the next refit.
    """
    here, s2_at = model.eta, at + 2

    def interval(one: FittedModel, i: int, name: str, limits: tuple[float, float], step: float = 0.1) -> Ends:
        return _interval(f, one, i, name, limits, step, keep=first)

    alpha = interval(model, at, "alpha", (0.0, HIGHEST_ORDER), 0.03)
    s2 = interval(model, s2_at, "s2", around(f, here[s2_at])).exp()
    R = interval(model, 0, "R", around(f, here[0])).exp()
    g = g_of_eta(here[at : at + 2])
    by_F = _other(model, at, BY_F, [here[at] + g, math.log(-g)])
    F = interval(by_F, at, "F", (-2.0, HIGHEST_ORDER), 0.03)
    log_f = math.log(-f_of(here[at], g, f.h))
    by_f = _other(model, at, BY_PARAMETER, [here[at], log_f])
    highest = 2 * math.log(2) - 2 * min(math.log(f.h), 0.0)
    minus_f = interval(by_f, at + 1, "f", (log_f - LEAST, highest)).exp()
    return [alpha, F, minus_f, s2, R]


def _values(f: CandidateModels, eta: Sequence[float], at: int) -> tuple[float, ...]:
    """Return α, F, -f, s2 and R, computed from the transformed parameters `eta`."""
    g = g_of_eta(eta[at : at + 2])
    return eta[at], eta[at] + g, -f_of(eta[at], g, f.h), math.exp(eta[at + 2]), math.exp(eta[0])


def _interval(
    f: CandidateModels,
    model: FittedModel,
    i: int,
    name: str,
    limits: tuple[float, float],
    step: float = 0.1,
    keep: bool = True,
) -> Ends:
    """Return transformed parameter `i` with its interval. An end beyond one of `limits` becomes this limit.

    `name`: name of the parameter in AT_BOUND. `step`, `keep`: as for `interval_end`.
    """
    bound = AT_BOUND.get(name, CRITICAL)
    ends = [
        interval_end(f, model, i, side, limit, step, bound, keep=keep)
        for side, limit in zip((-1, 1), limits, strict=True)
    ]
    low, high = (limit if end is None else end for end, limit in zip(ends, limits, strict=True))
    return Ends(model.eta[i], low, high)


def _elsewhere(f: CandidateModels, model: FittedModel, at: int) -> list[list[float]]:
    """Return the transformed parameters of fits, each with a fixed order that is in the order's interval.

    The first call after a model search tries all orders in LOOKED_AT. Later calls repeat only those fits
    whose order was found to lie in the interval.
    """
    starts = f.fits.elsewhere
    if starts is None:
        starts = [
            [
                max(model.eta[0], little_white(f)),
                *model.eta[1:at],
                float(order),
                logit,
                *model.eta[at + 2 :],
            ]
            for order in LOOKED_AT
            for logit in (-6.0, 0.0)
        ]
    fitted = [f.native.fit(list(model.codes), one, held=at, converged=1e-2, steps=20) for one in starts]
    return [eta for eta, nll in fitted if 2 * (nll - model.nll) < CRITICAL]


def _limits(f: CandidateModels, code: int, k: int, here: float, side: int) -> tuple[float, float]:
    """Return the value at which the search for an end of an interval stops, and the search's first step."""
    one = ROWS[code].coordinates[k]
    match one.kind:
        case "rate":
            lowest = float(f.data.lam[0])
            return (math.log(lowest / SLOWEST) if side < 0 else math.log(math.pi)), 0.2
        case "number" | "alpha":
            return (one.high if side > 0 else one.low), 0.03
        case "level":
            return around(f, here)[side > 0], 0.1
        case _:
            return here + side * LEAST, 0.1


def interval_end(
    f: CandidateModels,
    model: FittedModel,
    i: int,
    side: int,
    limit: float,
    step: float,
    bound: float = CRITICAL,
    keep: bool = True,
) -> float | None:
    """Return an end of the interval of parameter `i` in `eta`; None if it is not found up to `limit`.

    `side`: -1 for the lower end, 1 for the upper one. `step`: first step of the search. `bound`: limit in
    place of CRITICAL if the best fit has no white noise. `keep`: whether to store the end for the next refit,
    which then begins its search there.
    """
    if side * (limit - model.eta[i]) <= 0:
        return None
    last = f.fits.ends.get((model.codes, i, side), []) if keep else []
    end, there = f.native.end(
        list(model.codes), list(model.eta), model.nll, i, side, limit, step, CRITICAL, bound, last
    )
    if keep:
        f.fits.ends[model.codes, i, side] = there
    return None if math.isnan(end) else end


def _at(code: int, eta: Sequence[float], k: int, end: float, h: float, name: str) -> float:
    there = list(eta)
    there[k] = end
    return float(getattr(part_of(code, there, h), name))


def _falls(ends: Sequence[float | None], value: float) -> bool:
    """Return whether the two ends are swapped, since the parameter falls as its transformed value rises."""
    low, high = ends
    return (low is not None and low > value) or (high is not None and high < value)


def _wider(f: CandidateModels, model: FittedModel, at: int, value: float, end: float | None) -> float | None:
    """Return an end of the interval of K, moved outwards since the power that leaks is uncertain.

    The power that a random walk leaks depends on a single random number, which is common to all frequencies.
    So an average over frequencies does not make this uncertainty smaller.
    """
    if end is None:
        return None
    own = slopes(f, model.codes, model.eta)[1][at] ** 2 * f.data.counts
    leaks = leaking(f.data.lam, f.samples)
    share = float(own[leaks].sum() / own.sum())
    # χ² with one degree of freedom has the relative standard deviation √2, the root of a variance half of it.
    more = NORMAL_95 * share * math.sqrt(2) * LEAK_OF_CUBIC / (1 + LEAK_OF_CUBIC) / 2
    distance = math.log(end / value)
    return value * math.exp(math.copysign(math.hypot(distance, more), distance))


def _other(model: FittedModel, at: int, code: int, first: list[float]) -> FittedModel:
    """Return the same model, in which the part at index `at` is described by other free parameters.

    `code`: code number of the part with these free parameters. `first`: values of its first free parameters;
    its other parameters stay as they are. The spectrum stays the same. A part without free parameters, such
    as a mean of samples, may have the same index, and is left as it is.
    """
    codes = [code if place == at and free_of(one) else one for one, place in model.terms()]
    eta = [*model.eta[:at], *first, *model.eta[at + len(first) :]]
    return model._replace(codes=tuple(codes), eta=tuple(eta))


def little_white(f: CandidateModels) -> float:
    """Return log R of a small amount of white noise, with which a fit can start.

    Near R = 0, the likelihood hardly changes with log R, so that a fit that starts there stays there.
    """
    return math.log(max(float(np.median(f.data.power[0][-10:])), 1e-300)) - LITTLE


def around(f: CandidateModels, here: float) -> tuple[float, float]:
    """Return the limits of the search for the ends of a variance's interval. All values are logarithms."""
    return here - LEAST, max(here, f.white.eta[0]) + LEAST


def _if_known(alpha: Ends) -> Interval:
    return Interval() if alpha.high - alpha.low > WIDEST_ORDER else Interval(*alpha)
