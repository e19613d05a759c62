"""Check whether the published intervals of one axis contain the true values."""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from fltea.identification.allan import allan
from fltea.identification.forecast_judge import fitted_system, judged
from fltea.identification.sums import examined
from fltea.noise import parts as p
from fltea.records.arrays import Array
from fltea.records.fit import Interval
from fltea.records.plus_minus import NORMAL_95
from fltea.spectrum.drift_rate import drift_rate
from fltea.spectrum.noise_figures import NoiseFigures, noise_figures
from fltea.spectrum.questions import Verdict
from fltea.spectrum.verdict import decide

from tools.validation.closed_form import closed_form
from tools.validation.coverage.populations import H, Parts
from tools.validation.coverage.published import ALLAN, FIGURES, of_part
from tools.validation.same_parts import found_in_order, in_order, tag

STEADY = tuple(kind for kind in p.CODES if kind.has("slow") or kind.has("fast only") or kind is p.Resonance)
"""Kinds of parts of a noise that do not contribute to its N."""
FREQUENCIES = 40_000
"""Number of frequencies at which the integral for the Allan deviation of a spectrum is evaluated."""
SECONDS = 10.0
"""Forecasts are checked for this time ahead [s]."""


class Seen(NamedTuple):
    """The comparison of an interval with the true value that it should contain.

    For a band of intervals, each interval is compared with its own true value.
    """

    quantity: str
    published: bool
    below: float = 0.0
    """Proportion of the true values that are below their intervals. For a single figure it is 0 or 1. For the
    points of a band it can be any number from 0 to 1.
    """
    above: float = 0.0
    width: float | None = None


class Axis(NamedTuple):
    """The results for an axis whose true parts are known."""

    parts: Parts
    verdict: Verdict
    figures: NoiseFigures


def analyse(parts: Parts, y: Array) -> Axis:
    """Identify the samples `y` of shape (n,)."""
    e = examined(y, H).evidence
    verdict = decide(e)
    return Axis(parts, verdict, noise_figures(e, verdict))


def of_fit(axis: Axis) -> Iterator[Seen]:
    """Yield the results for N, for the parameters of the order, and for the parameters of each part.

    The parameters of the parts count only if the fitted parts are the true parts.
    """
    yield _seen("N", axis.figures.level.N, true_N(axis.parts))
    for name, true in _order(axis).items():
        yield _seen(str(FIGURES[name]), getattr(axis.verdict.order, name), true)
    truth = in_order(axis.parts)
    found = found_in_order(axis.figures.parts)
    if any(isinstance(one, p.White) and one.R == 0 for one in truth):
        truth = [one for one in truth if not isinstance(one, p.White)]
        found = [one for one in found if one.part != "white"]
    same = [one.part for one in found] == [tag(one) for one in truth]
    for one in truth:
        for name in one.__struct_fields__:
            if name != "samples" and not same:
                yield Seen(of_part(tag(one), name), False)
    for estimate, one in zip(found, truth, strict=True) if same else ():
        for name, interval in estimate.values.items():
            yield _seen(of_part(estimate.part, name), interval, float(getattr(one, name)))


def of_drift(axis: Axis, y: Array) -> Iterator[Seen]:
    """Yield the result for the interval of the drift rate; the true drift rate is 0."""
    yield _seen("drift rate", drift_rate(y, H, axis.figures.spectrum(H)), 0.0)


def of_allan(axis: Axis, y: Array) -> Iterator[Seen]:
    """Yield the result for the band of the Allan deviation.

    It has the proportion of points whose true value is below the band, and the proportion of points whose
    true value is above it.
    """
    found = allan([y], H)
    true = true_allan(axis.parts, np.rint(np.array(found.tau_s) / H))
    below, above = (float(np.mean(one)) for one in (true < found.low, true > found.high))
    width = float(np.median((np.array(found.high) - np.array(found.low)) / np.array(found.deviation)))
    yield Seen(ALLAN, True, below, above, width)


def of_forecast(axis: Axis, y: Array) -> Iterator[Seen]:
    """Yield the result for the forecasts of the heading, and that for the forecasts of the bias.

    The first half of the record predicts a 95 % band for the second half. The second half is divided into
    stretches. The result is the proportion of them that end outside the band.
    """
    half = len(y) // 2
    parts = analyse(axis.parts, y[:half]).figures.model.parts(H)
    judgement = judged(fitted_system(parts, np.ascontiguousarray(y[:half]), H), y, half, H)
    for name, pieces in (("heading_std", judgement.heading), ("bias_std", judgement.bias)):
        for one in pieces:
            if one.t_s == SECONDS:
                yield Seen(str(FIGURES[name]), True, above=1 - one.within, width=2 * NORMAL_95 * one.said)


def true_N(parts: Sequence[p.Part]) -> float:
    """Return the true N.

    N is the noise density at low frequencies of some of the parts together. Not among them are the kinds in
    STEADY (such as relaxations) and filters.
    """
    kept = [one for one in parts if not isinstance(one, (*STEADY, *p.FILTERS))]
    return math.sqrt(float(closed_form(kept, np.array([1e-6]), H)[0]) * H)


def true_allan(parts: Sequence[p.Part], factors: Array) -> Array:
    """Return the true Allan deviation, computed from the spectrum.

    `factors`: averaging times [samples], (k,).
    """
    # The spectra of slow parts rise without end at low frequencies, so the frequencies are closer there.
    edges = np.geomspace(1e-7, np.pi, FREQUENCIES + 1)
    lam, width = np.sqrt(edges[1:] * edges[:-1]), np.diff(edges)
    S = closed_form(parts, lam, H)
    found = []
    for m in factors.tolist():
        gain = 2 * np.sin(m * lam / 2) ** 4 / (m * np.sin(lam / 2)) ** 2
        found.append(math.sqrt(float((S * gain * width).sum() / np.pi)))
    return np.array(found)


def _order(axis: Axis) -> dict[str, float]:
    """Return the true parameters of the noise's fractional order, by field name.

    The result is empty if the noise has no order. It is also empty if the noise is a fractional state and the
    verdict an ARFIMA model, or the other way round: their parameters cannot be compared.
    """
    R = sum(one.R for one in axis.parts if isinstance(one, p.White))
    for one in axis.parts:
        if isinstance(one, p.Order):
            s2 = H ** (2 * one.alpha) * one.Q
            found = {"alpha": one.alpha, "f": one.f, "F": one.alpha + H**one.alpha * one.f, "s2": s2, "R": R}
            return {} if axis.verdict.order.arfima else found
        if isinstance(one, p.Arfima):
            return {"alpha": one.d, "s2": one.s2, "R": R} if axis.verdict.order.arfima else {}
    return {}


def _seen(quantity: str, interval: Interval, true: float) -> Seen:
    """Compare an interval with the true value; an unknown end counts as infinitely far away."""
    low, value, high = interval.low, interval.value, interval.high
    if value is None or (low is None and high is None):
        return Seen(quantity, False)
    below, above = low is not None and true < low, high is not None and true > high
    width = None if low is None or high is None else (high - low) / abs(true or 1.0)
    return Seen(quantity, True, float(below), float(above), width)
