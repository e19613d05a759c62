"""Intervals of the parameters of a noise model by profile likelihood.

A value belongs to the interval if 2 log L of the best fit with this value is at most 3.84 (95 % of χ² with
one degree of freedom) below the highest one. Unlike the curvature at the maximum, this rule holds where the
data cannot separate α from f, where a correlation time has only a lower bound, and where white noise below
other noise has only an upper bound. An end is None where all values on that side belong to the interval.

The variance R of the white noise cannot be below 0. If the best fit with a given value has R = 0, the
likelihood ratio does not follow χ²: an estimate of R can then only be too large, and this error shifts the
other parameters. For such fits the larger limits `AT_BOUND` are used.
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
"""At the end of a parameter's 95 % interval, 2 log L of the best fit with this value is CRITICAL lower than
at the maximum. If this fit has no white noise, these limits replace CRITICAL. The parameters are the order α,
f, F = h^α f + α (h: sampling period), and s2, the variance of the state's steps. Each limit is the 95 % point
of a likelihood ratio for two normal estimates with the correlation ρ. The second estimate, here that of the
white noise's variance R, cannot be below 0. The points are 4.4 for |ρ| = 0.8, 4.6 for 0.88, 4.8 for 0.94 and
5.1 for 1 (Self & Liang, *JASA* 82, 1987). The correlation between each parameter and R was computed from the
Fisher information of 35 noises with R = 0. With 60,000 samples, nine tenths of them have at most 0.88 for f,
0.94 for α, 0.99 for F and 1 for s2 (tools/validation/bound.py).
"""
LEAST = 7.0
"""A variance counts as 0 if its logarithm is lower by more than this than the logarithm of the best value."""
LITTLE = 4.0
"""Logarithm of a ratio: power at the highest frequencies, divided by the small amount of white noise with
which some fits start (`little_white`).
"""
BY_F, BY_PARAMETER, BY_NOISE, BY_STEP = (
    BY_NAME[name].code for name in ("order by F", "order by f", "order by Q", "arfima by s2")
)
"""Code numbers of parts that describe an order or ARFIMA by other free parameters than `fltea.noise.parts`
uses. So a fit can keep such a parameter at a fixed value. The order α is part of x_k = h^α f x_{k-1} + ...,
with g = h^α f, F = g + α, and the variance s2 = h^2α Q of a step (h: sampling period). In
`fltea.noise.parts`, the free parameters of an order are α, logit(-g / 2^α) and log s2. BY_F has F and log -g
in place of the first two. BY_PARAMETER has α and log -f in place of the first two. BY_NOISE has log Q in
place of log s2. ARFIMA has log s2 / (1 - φ)² as a free parameter, and BY_STEP has log s2 in its place.
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

    `name`: name of the parameter in AT_BOUND. `step`, `keep`: as for `interval_end`.
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

    `side`: -1 for the lower end, 1 for the upper one. `limit`: the search ends at this value of the
    parameter. `step`: first step of the search. `bound`: limit of the fall of 2 log L, in place of CRITICAL,
    where the best fit has no white noise. `keep`: whether to store the end for the next refit, which then
    begins its search there.
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

    `code`: code number of the part with these free parameters. `first`: values of its first free parameters;
    its other parameters stay as they are. The spectrum stays the same. A part without free parameters, such
    as a mean of samples, may stand before this part at the same index. It is left as it is.
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
