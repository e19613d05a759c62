"""The order that is published of the same series: of the whole record, and live.

Both are the verdict's, from the same search. What differs is the spectrum: every ordinate of the record's
periodogram, or what the accumulators of the daemon have kept of it.
"""

from collections.abc import Iterator, Sequence
from typing import Literal, NamedTuple, get_args

import numpy as np
from fltea.records.arrays import Array, Mask
from fltea.spectrum.intervals import OrderFit
from fltea.spectrum.octaves import Octaves
from fltea.spectrum.periodogram import Periodogram, periodogram
from fltea.spectrum.spectral import examine
from fltea.spectrum.verdict import decide

from tools.validation.evaluate.cases import Case

Quantity = Literal["alpha", "f", "F", "s2", "R"]
QUANTITIES: tuple[Quantity, ...] = get_args(Quantity)


class FitReading(NamedTuple):
    """What is published of all series, (seeds,) each."""

    estimates: dict[str, Array]
    """by the names of QUANTITIES; NaN where none is published"""
    covered: dict[str, Mask]
    """whether the 95 % interval holds the truth. Empty without a truth"""
    published: Mask
    """the verdict has an order, and the data define it"""


def truths(case: Case) -> dict[str, float]:
    """By the names of QUANTITIES; none of white noise."""
    if case.alpha is None or case.f is None:
        return {}
    noise = case.noise
    return {"alpha": case.alpha, "f": case.f, "F": case.alpha + noise.g, "s2": noise.s2, "R": noise.R}


def whole_reading(y: Array, h: float, truth: dict[str, float]) -> FitReading:
    """Judge the periodograms of the whole records y (n, seeds)."""
    return read_fits([periodogram(one, h) for one in y.T], truth)


def live_readings(y: Array, h: float, lengths: Sequence[int], truth: dict[str, float]) -> list[FitReading]:
    """Judge what the accumulators hold of y (n, seeds) after each of `lengths` samples, rising."""
    return [read_fits(spectra, truth) for spectra in live_spectra(y, h, lengths)]


def live_spectra(y: Array, h: float, lengths: Sequence[int]) -> Iterator[list[Periodogram]]:
    """Feed y (n, seeds) to the accumulators; yield what is kept after each of `lengths`, lane by lane."""
    octaves, at = Octaves(y.shape[1]), 0
    for n in lengths:
        octaves.add(y[at:n])
        at = n
        yield [octaves.periodogram(lane, h) for lane in range(y.shape[1])]


def read_fits(spectra: Sequence[Periodogram], truth: dict[str, float]) -> FitReading:
    """Judge one series after the other."""
    found = [published(one) for one in spectra]
    values: dict[str, Array] = {name: np.array([_value(one, name) for one in found]) for name in QUANTITIES}
    covered = {name: np.array([holds(one, name, value) for one in found]) for name, value in truth.items()}
    return FitReading(values, covered, np.isfinite(values["alpha"]))


def published(p: Periodogram) -> OrderFit:
    """Return the order that the verdict on one series has; all of it is null where it has none."""
    return decide(examine(p, p.n * p.h, p.n).evidence).order


def holds(found: OrderFit, name: str, truth: float) -> bool:
    """Return whether an interval has the truth in it; where an end is not known, none is beyond it."""
    one = getattr(found, name)
    above_low, below_high = one.low is None or one.low <= truth, one.high is None or truth <= one.high
    return one.value is not None and above_low and below_high


def fitted_variances(y: Array, h: float, Q: float, power: float) -> tuple[Array, Array]:
    """Q = s2 and R of the fits of y (n, seeds), (seeds,) each.

    Where no order is published they are the given Q and the variance `power` of y. None is below a thousandth
    of `power`: the fit may say 0, and the filters need R > 0.
    """
    found = whole_reading(y, h, {})
    least = power / 1000
    s2, R = (np.maximum(found.estimates[name], least) for name in ("s2", "R"))
    return np.where(found.published, s2, Q), np.where(found.published, R, power)


def _value(found: OrderFit, name: str) -> float:
    value = getattr(found, name).value
    return np.nan if value is None else float(value)
