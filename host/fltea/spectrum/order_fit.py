"""The order of a noise model and its other parameters, with their intervals.

The likelihood of an order sometimes has a second maximum far from the first. So the whole range of orders is
searched, and all orders that are as good as the interval's ends belong to the interval.
"""

import math
from collections.abc import Sequence

import msgspec
import numpy as np

from fltea.noise.free_parameters import g_of_eta
from fltea.noise.parts import Arfima, Order, free_of, kind_of, part_of
from fltea.noise.spectra import f_of
from fltea.records.fit import Interval
from fltea.spectrum.candidate_models import AT_A_LIMIT, CandidateModels, FittedModel
from fltea.spectrum.intervals import (
    AT_BOUND,
    BY_F,
    BY_NOISE,
    BY_PARAMETER,
    BY_STEP,
    CRITICAL,
    LEAST,
    Ends,
    around,
    interval_end,
    interval_of,
    little_white,
    reparametrised,
)

WIDEST_ORDER = 0.9
"""The order α counts as undefined if its 95 % interval is wider than this."""
HIGHEST_ORDER = 1.999
ORDERS_TRIED = np.arange(0.04, 1.3, 0.08)
"""Orders at which a second maximum of the likelihood is searched for."""


class OrderFit(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Order and other parameters of a noise model. If the data do not define them, all values are None.

    The order α and f are those of D^α x = f x + ω. F = h^α f + α, where h is the sampling period. s2 is the
    variance of the steps that drive x, and R that of the white noise, both in unit².
    """

    alpha: Interval = Interval()
    f: Interval = Interval()
    F: Interval = Interval()
    s2: Interval = Interval()
    R: Interval = Interval()
    arfima: bool = False
    """Whether the order is that of ARFIMA(1, d, 0), for which α is d and f has no meaning."""


def of_order(f: CandidateModels, model: FittedModel, code: int, at: int) -> dict[str, Interval]:
    """Return the intervals of those parameters of an order or of ARFIMA that one search per end cannot find.

    Such a parameter depends on several free parameters of the fit, or its likelihood may have several maxima.
    For a part of any other kind the result is empty.
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
    by_step = reparametrised(model, at, BY_STEP, [d, rate, log_s2])
    return Interval(*interval_of(f, by_step, at + 2, "s2", around(f, log_s2)).exp())


def _noise(f: CandidateModels, model: FittedModel, at: int, Q: float) -> Interval:
    """Return the variance Q of the noise ω that drives noise of an order, with its interval."""
    alpha, logit = model.eta[at : at + 2]
    by_noise = reparametrised(model, at, BY_NOISE, [alpha, logit, math.log(Q)])
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
        alpha = interval_of(f, model, at, "alpha", (0.0, 1.0), 0.03)
        R = interval_of(f, model, 0, "R", around(f, here[0])).exp()
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

    The parameters are those of `OrderFit`. `first`: whether this is the highest maximum of the likelihood.
    Only then are the ends of the intervals stored, as starts for the next refit.
    """
    here, s2_at = model.eta, at + 2

    def interval(one: FittedModel, i: int, name: str, limits: tuple[float, float], step: float = 0.1) -> Ends:
        return interval_of(f, one, i, name, limits, step, keep=first)

    alpha = interval(model, at, "alpha", (0.0, HIGHEST_ORDER), 0.03)
    s2 = interval(model, s2_at, "s2", around(f, here[s2_at])).exp()
    R = interval(model, 0, "R", around(f, here[0])).exp()
    g = g_of_eta(here[at : at + 2])
    by_F = reparametrised(model, at, BY_F, [here[at] + g, math.log(-g)])
    F = interval(by_F, at, "F", (-2.0, HIGHEST_ORDER), 0.03)
    log_f = math.log(-f_of(here[at], g, f.h))
    by_f = reparametrised(model, at, BY_PARAMETER, [here[at], log_f])
    highest = 2 * math.log(2) - 2 * min(math.log(f.h), 0.0)
    minus_f = interval(by_f, at + 1, "f", (log_f - LEAST, highest)).exp()
    return [alpha, F, minus_f, s2, R]


def _values(f: CandidateModels, eta: Sequence[float], at: int) -> tuple[float, ...]:
    """Return α, F, -f, s2 and R (see `OrderFit`), computed from the free parameters `eta`."""
    g = g_of_eta(eta[at : at + 2])
    return eta[at], eta[at] + g, -f_of(eta[at], g, f.h), math.exp(eta[at + 2]), math.exp(eta[0])


def _elsewhere(f: CandidateModels, model: FittedModel, at: int) -> list[list[float]]:
    """Return the free parameters of further fits, each with the order held at another value.

    The order of each lies in the interval of the order: its 2 log L is less than CRITICAL below that of
    `model`. The first call after a model search tries all orders in ORDERS_TRIED. Later calls repeat only the
    fits that made an interval wider.
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
            for order in ORDERS_TRIED
            for logit in (-6.0, 0.0)
        ]
    fitted = [f.native.fit(list(model.codes), one, held=at, converged=1e-2, steps=20) for one in starts]
    return [eta for eta, nll in fitted if 2 * (nll - model.nll) < CRITICAL]


def _if_known(alpha: Ends) -> Interval:
    return Interval() if alpha.high - alpha.low > WIDEST_ORDER else Interval(*alpha)
