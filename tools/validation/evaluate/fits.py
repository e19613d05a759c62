"""The maximum-likelihood fit of the same series: of the whole record, and live.

Both are the same fit by the same likelihood. What differs is the spectrum that it is fitted to: every
ordinate of the record's periodogram, or what the accumulators of the daemon have kept of it.
"""

from collections.abc import Iterator, Sequence
from typing import Literal, NamedTuple, get_args

import numpy as np
from fltea.spectrum.likelihood_ratio import critical_values, null_fits
from fltea.spectrum.models import FULL
from fltea.spectrum.null_constants import PROBABILITIES
from fltea.spectrum.octaves import Octaves
from fltea.spectrum.periodogram import Binned, binned, periodogram
from fltea.spectrum.profile import FractionalFit, Parameter, fractional_fit
from fltea.spectrum.whittle import fit
from numpy.typing import NDArray

from tools.validation.evaluate.cases import Case

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

Quantity = Literal["alpha", "f", "F", "s2", "R"]
QUANTITIES: tuple[Quantity, ...] = get_args(Quantity)
LEVEL = 0.05
"""Of the null test."""


class FitReading(NamedTuple):
    """What the fit says of all series, (seeds,) each."""

    estimates: dict[str, Array]
    """by the names of QUANTITIES"""
    covered: dict[str, Mask]
    """whether the 95 % interval holds the truth; one without ends holds everything. Empty without a truth"""
    rejected: Mask
    """the null test rejects white noise: where it does not, nothing is published"""


def truths(case: Case) -> dict[str, float]:
    """By the names of QUANTITIES; none of white noise."""
    if case.alpha is None or case.f is None:
        return {}
    noise = case.noise
    return {"alpha": case.alpha, "f": case.f, "F": case.alpha + noise.g, "s2": noise.s2, "R": noise.R}


def whole_reading(y: Array, h: float, truth: dict[str, float]) -> FitReading:
    """Fit the periodograms of the whole records y (n, seeds)."""
    data = binned(periodogram(y.T, h))
    return read_fits([data._replace(power=data.power[[i]]) for i in range(y.shape[1])], h, truth)


def live_readings(y: Array, h: float, lengths: Sequence[int], truth: dict[str, float]) -> list[FitReading]:
    """Fit what the accumulators hold of y (n, seeds) after each of `lengths` samples, rising."""
    return [read_fits(data, h, truth) for data in live_spectra(y, h, lengths)]


def live_spectra(y: Array, h: float, lengths: Sequence[int]) -> Iterator[list[Binned]]:
    """Feed y (n, seeds) to the accumulators; yield what is fitted after each of `lengths`, lane by lane."""
    octaves, at = Octaves(y.shape[1]), 0
    for n in lengths:
        octaves.add(y[at:n])
        at = n
        yield [binned(octaves.periodogram(lane, h)) for lane in range(y.shape[1])]


def read_fits(data: Sequence[Binned], h: float, truth: dict[str, float]) -> FitReading:
    """Fit one series after the other; there are intervals only if there is a truth."""
    found = [fitted(one, h, intervals=bool(truth)) for one in data]
    estimates: dict[str, Array] = {
        name: np.array([getattr(one, name).value for one, _ in found]) for name in QUANTITIES
    }
    covered = {
        name: np.array([rejected and _holds(getattr(one, name), value) for one, rejected in found])
        for name, value in truth.items()
    }
    return FitReading(estimates, covered, np.array([rejected for _, rejected in found]))


def fitted(data: Binned, h: float, *, intervals: bool = True) -> tuple[FractionalFit, bool]:
    """Fit one series; with intervals, if the null test rejects white noise, and whether it does."""
    rejected = rejects(data, LEVEL)[0]
    return fractional_fit(data, fit(data, FULL), h, white=not (rejected and intervals)), rejected


def rejects(data: Binned, *levels: float) -> list[bool]:
    """Whether the null test rejects white noise in the one series of `data`, at each of `levels`."""
    ratio, critical = null_fits(data).likelihood_ratio[0], critical_values(data.ordinates)
    return [bool(ratio > critical[PROBABILITIES.index(level)]) for level in levels]


def fitted_variances(y: Array, h: float, Q: float, power: float) -> tuple[Array, Array]:
    """Q = s2 and R of the fits of y (n, seeds), (seeds,) each.

    Where the null test does not reject white noise they are the given Q and the variance `power` of y. None
    is below a thousandth of `power`: the fit may say 0, and the filters need R > 0.
    """
    found = whole_reading(y, h, {})
    least = power / 1000
    s2, R = (np.maximum(found.estimates[name], least) for name in ("s2", "R"))
    return np.where(found.rejected, s2, Q), np.where(found.rejected, R, power)


def _holds(interval: Parameter, value: float) -> bool:
    if interval.low is None or interval.high is None:
        return True
    return interval.low <= value <= interval.high
