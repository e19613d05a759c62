"""Intervals of the parameters of a noise model by profile likelihood.

A value belongs to the interval if 2 log L of the best fit with this value is at most 3.84 (95 % of χ² with
one degree of freedom) below the highest one. Intervals from the curvature at the maximum would be wrong in
three cases, in which this rule still holds: the data cannot separate α from f; a correlation time has only a
lower bound; white noise below other noise has only an upper bound. An end is None where all values on that
side belong to the interval.

The variance R of the white noise cannot be below 0. If the best fit with a given value has R = 0, an estimate
of R can only err upwards, and the other parameters err with it. The likelihood ratio then does not follow χ².
For such fits the larger limits `AT_BOUND` are used.
"""

import math
from typing import NamedTuple

import numpy as np

from fltea.noise.part import BY_NAME
from fltea.noise.parts import (
    free_of,
)
from fltea.spectrum.candidate_models import CandidateModels, FittedModel

CRITICAL = 3.841
"""95 % point of χ² with one degree of freedom."""
AT_BOUND = {"alpha": 4.8, "f": 4.6, "F": 5.1, "s2": 5.1}
"""A parameter's 95 % interval ends where 2 log L of the best fit with this value is CRITICAL lower than at
the maximum. If this fit has no white noise, these limits replace CRITICAL. The parameters are the order α, f,
F = h^α f + α (h: sampling period), and s2, the variance of the steps that drive the noise.

The limits are larger than CRITICAL, since the variance R of the white noise cannot be below 0. Each is the 95
% point of the likelihood ratio for two normal estimates, of the parameter and of R, where that of R is never
below 0. It depends on the correlation ρ of the two: 4.4 for |ρ| = 0.8, 4.6 for 0.88, 4.8 for 0.94 and 5.1 for
1 (Self & Liang, *JASA* 82, 1987). ρ was computed from the Fisher information of 35 noises with R = 0. With
60,000 samples, |ρ| is in nine tenths of them at most 0.88 for f, 0.94 for α, 0.99 for F and 1 for s2
(tools/validation/bound.py).
"""
LEAST = 7.0
"""A variance counts as 0 if it is less than exp(-LEAST) times the best value."""
LITTLE = 4.0
"""Some fits start with a small amount of white noise (`little_white`). Its power is exp(-LITTLE) times the
power at the highest frequencies.
"""
BY_F, BY_PARAMETER, BY_NOISE, BY_STEP = (
    BY_NAME[name].code for name in ("order by F", "order by f", "order by Q", "arfima by s2")
)
"""Code numbers of parts that describe an order or ARFIMA by other free parameters than `fltea.noise.parts`
uses. So a fit can keep such a parameter at a fixed value.

The order α is that of x_k = h^α f x_{k-1} + ..., where h is the sampling period. With g = h^α f, F = g + α,
and s2 = h^2α Q, the variance of a step, its free parameters are

    in fltea.noise.parts   α   logit(-g / 2^α)   log s2
    BY_F                   F   log -g            log s2
    BY_PARAMETER           α   log -f            log s2
    BY_NOISE               α   logit(-g / 2^α)   log Q

ARFIMA has log(s2 / (1 - φ)²) as a free parameter, and BY_STEP has log s2 in its place.
"""


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


def interval_of(
    f: CandidateModels,
    model: FittedModel,
    i: int,
    name: str,
    limits: tuple[float, float],
    step: float = 0.1,
    keep: bool = True,
) -> Ends:
    """Return free parameter `i` with its interval. An end beyond one of `limits` becomes this limit.

    `name`: name of the parameter in AT_BOUND; for all other parameters, CRITICAL alone is used. `step`,
    `keep`: as for `interval_end`.
    """
    bound = AT_BOUND.get(name, CRITICAL)
    ends = [
        interval_end(f, model, i, side, limit, step, bound, keep=keep)
        for side, limit in zip((-1, 1), limits, strict=True)
    ]
    low, high = (limit if end is None else end for end, limit in zip(ends, limits, strict=True))
    return Ends(model.eta[i], low, high)


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

    It is where 2 log L of the best fit is CRITICAL lower than at the maximum, or `bound` lower, if this fit
    has no white noise. `side`: -1 for the lower end, 1 for the upper one. `limit`: the search ends at this
    value of the parameter. `step`: first step of the search. `keep`: whether to store the end for the next
    refit, which then begins its search there.
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


def reparametrised(model: FittedModel, at: int, code: int, first: list[float]) -> FittedModel:
    """Return the same model, with other free parameters for the part whose parameters begin at `eta[at]`.

    `code`: the part's code number with the new parameters. `first`: values of its first free parameters; its
    other parameters stay as they are. So the spectrum stays the same. If a part without free parameters, such
    as a mean of samples, stands before this part, the index `at` fits both. That part is left as it is.
    """
    codes = [code if place == at and free_of(one) else one for one, place in model.terms()]
    eta = [*model.eta[:at], *first, *model.eta[at + len(first) :]]
    return model._replace(codes=tuple(codes), eta=tuple(eta))


def little_white(f: CandidateModels) -> float:
    """Return log R of a small amount of white noise, with which a fit can start.

    The amount is not smaller, since near R = 0 the likelihood hardly changes with log R: a fit would stay
    there.
    """
    return math.log(max(float(np.median(f.data.power[0][-10:])), 1e-300)) - LITTLE


def around(f: CandidateModels, here: float) -> tuple[float, float]:
    """Return the limits of the search for the ends of a variance's interval.

    The limits and `here`, the best value, are logarithms of the variance.
    """
    return here - LEAST, max(here, f.white.eta[0]) + LEAST
