"""N (angle random walk) of a noise model, with a 95 % interval that allows for other models that fit as well.

The model that the verdict chose may lack a part that is too weak to be found. Most weak parts hardly change
N. But a relaxation whose corner is near the sample rate looks much like white noise. If it is missing from
the model, the fit takes its power for white noise, and N comes out too large by many standard deviations. So
three kinds of other models are tried as well:

    the best model without an order; if the chosen model is this one, the best model with an order
    the chosen model with one more relaxation
    the chosen model with a relaxation, or with a rise (a part whose density rises with the frequency), in
        place of all parts that shape the high frequencies, such as filters

The interval of N covers the intervals by all those models that describe the data as well as the chosen one.
"""

import math
from collections.abc import Iterator

import numpy as np

from fltea.noise.filters import LowPass, Mean
from fltea.noise.parts import (
    CODES,
    FILTERS,
    SLOW,
    Part,
    Relaxation,
    Resonance,
    Rise,
    White,
    free_of,
    kind_of,
    spectrum_of,
)
from fltea.records.fit import Interval
from fltea.records.plus_minus import NORMAL_95
from fltea.spectrum.candidate_models import BY_CHANCE, CandidateModels, FittedModel
from fltea.spectrum.evidence import APART
from fltea.spectrum.information import slopes
from fltea.spectrum.intervals import around, interval_end
from fltea.spectrum.reading import NO_WHITE

HARDLY_KNOWN = 2.0
"""N is computed from a power density. N counts as unknown if the density is very uncertain: if half the width
of the 95 % interval of its logarithm is at least this.
"""
SHAPES = tuple(kind for kind in CODES if kind is not White and not kind.has("slow"))
"""Kinds of parts of a model that shape the high frequencies. A relaxation, or a rise (a part whose density
rises with the frequency), is tried in place of all of them.
"""
SEEN = 2.706
"""A model with one more relaxation counts as better if it raises 2 log L by at least this. Without such a
relaxation, 2 log L rises this much in one record of twenty. The reason: a relaxation's variance cannot be
below 0, so the rise is 0 with probability 1/2, else it follows χ² with one degree of freedom (Self & Liang,
*JASA* 82, 1987).
"""
FAST = (0.15, 0.3), (0.6, 0.4), (1.8, 0.5)
"""Starting points of the search for one more relaxation. Each has two numbers: the relaxation's corner
frequency [rad a sample], and the ratio of its density at low frequencies to that of the white noise.
"""
RISING = (0.4, 1.0), (1.0, 1.0)
"""Starting points of the search for a rise, a part whose density rises with the frequency. Each has two
numbers: the exponent of this rise, and the ratio of its density at half the sample rate to the density of the
white noise.
"""


def angle_walk(f: CandidateModels, model: FittedModel) -> Interval:
    """Return N (angle random walk) with its interval, in the unit of the samples times √s.

    N is computed from a density at low frequencies: the sum over the white noise and all other parts that are
    neither slow nor an order. The value comes from `model`, the noise model of the verdict. Value and ends
    are None if the white noise is negligible compared with a fast relaxation. Such a relaxation may be the
    sensor's white noise after a filter.
    """
    found = _of_one(f, model)
    if found.value is None or found.low is None or found.high is None:
        return found
    low, high = found.low, found.high
    for other in _as_good(f, model):
        from_, to = _profile(f, other)
        low, high = min(low, from_), max(high, to)
    return Interval(found.value, low, high)


def _of_one(f: CandidateModels, model: FittedModel) -> Interval:
    """Return N of `model`, with the 95 % interval that is valid if this model is the right one."""
    terms = list(model.terms())
    # If the model has a low-pass or a mean filter, its resonance is taken for a part of the filter's
    # response, a maximum near the corner. The resonance's density at low frequencies is then white noise that
    # has passed the filter, and is a part of N.
    filtered = any(_is(code, LowPass, Mean) for code, _ in terms)
    fast_only = tuple(kind for kind in CODES if kind.has("fast only"))
    others = (*SLOW, *FILTERS, *fast_only) + (() if filtered else (Resonance,))
    fast = [(code, at) for code, at in terms if not _is(code, *others)]
    relaxing = [(code, at) for code, at in terms if _is(code, White, Relaxation)]
    places = [at + k for code, at in fast for k in range(free_of(code))]
    total, rows = slopes(f, [code for code, _ in fast], [model.eta[i] for i in places])
    value = float(total[0])
    codes = [code for code, _ in relaxing]
    those = [model.eta[at + k] for code, at in relaxing for k in range(free_of(code))]
    if value < NO_WHITE * float(spectrum_of(codes, those, np.array([math.pi]), f.h)[0]):
        return Interval()
    slope = np.zeros(len(model.eta))
    slope[places] = rows[:, 0]
    whole = rows if len(fast) == len(terms) else slopes(f, model.codes, model.eta)[1]
    information = (whole * f.data.counts) @ whole.T + 1e-9 * np.eye(len(slope))
    deviation = NORMAL_95 * math.sqrt(max(float(slope @ np.linalg.solve(information, slope)), 0.0))
    if not deviation < HARDLY_KNOWN:
        return Interval()
    here = _walk_of(math.log(value), f.h)
    if len(fast) == 1 < len(terms):
        # If only the white noise contributes to N, the interval of N follows from that of the white noise's
        # variance R. The interval of R is asymmetric if stronger parts of the model hide the white noise.
        return Interval(here, *_profile(f, model))
    return Interval(here, *(_walk_of(math.log(value) + one, f.h) for one in (-deviation, deviation)))


def _as_good(f: CandidateModels, model: FittedModel) -> Iterator[FittedModel]:
    """Yield the other models that describe the data as well as `model` does."""
    if model is not f.plain and _stands_beside(f.plain, model):
        yield f.plain
    if model is f.plain and f.ordered is not None and _stands_beside(f.ordered, model):
        assert f.order is not None
        yield f.order
    more = _with(f, model, Relaxation, ())
    if 2 * (model.nll - more.nll) > SEEN:
        yield more
    if any(kind in SHAPES for kind in model.kinds):
        for kind in (Relaxation, Rise):
            instead = _with(f, model, kind, SHAPES)
            if 2 * (instead.nll - model.nll) < APART:
                yield instead


def _stands_beside(other: FittedModel, model: FittedModel) -> bool:
    """Return whether `other` describes the data about as well as `model`, or better.

    Their 2 log L are compared. What further parameters of `other` gain by chance is subtracted before.
    """
    dearer = BY_CHANCE * (other.parameters - model.parameters)
    return 2 * (other.nll - model.nll) + dearer < APART


def _with(
    f: CandidateModels, model: FittedModel, kind: type[Part], left_out: tuple[type[Part], ...]
) -> FittedModel:
    """Return the best fit of `model` with one more fast part, and without parts of the kinds `left_out`.

    `kind`: kind of the added part, Relaxation or Rise (noise whose power rises with the frequency). If the
    last refit had a model with the same parts, the fit starts at its result.
    """
    kept = [(code, at) for code, at in model.terms() if not _is(code, *left_out)]
    codes = [*(code for code, _ in kept), CODES.index(kind)]
    rest = [model.eta[at + k] for code, at in kept for k in range(free_of(code))]
    last = f.fits.beside.get(tuple(codes))
    first = (
        (_relaxing(rest, *one) for one in FAST)
        if kind is Relaxation
        else (_rising(rest, *one) for one in RISING)
    )
    starts = list(first) if last is None else [last]
    fitted = (f.native.fit(codes, start, converged=1e-3, steps=40) for start in starts)
    eta, nll = min(fitted, key=lambda one: one[1])
    f.fits.beside[tuple(codes)] = eta
    return FittedModel(tuple(codes), tuple(eta), nll)


def _rising(rest: list[float], delta: float, share: float) -> list[float]:
    """Return free parameters from which a fit with one more part starts.

    The new part is a rise: its density rises with the frequency, by the exponent `delta`. `rest`: parameters
    of the other parts. `share`: ratio of the rise's density at half the sample rate to that of the white
    noise.
    """
    return [*rest, rest[0] + math.log(share), delta]


def _relaxing(rest: list[float], rate: float, share: float) -> list[float]:
    """Return free parameters from which a fit with one more part starts.

    The new part is a relaxation with the corner frequency `rate` [rad a sample]. `rest`: parameters of the
    other parts, whose white noise is made less. `share`: ratio of the relaxation's density at low frequencies
    to that of the white noise.
    """
    variance = rest[0] + math.log(share * math.tanh(rate / 2))
    return [rest[0] + math.log1p(-share / 2), *rest[1:], variance, math.log(rate)]


def _profile(f: CandidateModels, model: FittedModel) -> tuple[float, float]:
    """Return the ends of the profile-likelihood interval of N, if only the white noise contributes to N."""
    limits = around(f, model.eta[0])
    low, high = (
        interval_end(f, model, 0, side, limit, 0.1) for side, limit in zip((-1, 1), limits, strict=True)
    )
    return 0.0 if low is None else _walk_of(low, f.h), _walk_of(limits[1] if high is None else high, f.h)


def _walk_of(log_density: float, h: float) -> float:
    return math.sqrt(math.exp(log_density) * h)


def _is(code: int, *kinds: type[Part]) -> bool:
    return kind_of(code) in kinds
