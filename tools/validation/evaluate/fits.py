"""Two published orders for the same series: one from the fit of the whole record, one from the live fit.

Both orders come from the same model search and verdict. Only the spectrum differs. The fit of the whole
record uses all ordinates of the record's periodogram. The live fit uses the sums that the daemon's
accumulators keep.
"""

from collections.abc import Iterator, Sequence
from typing import Literal, NamedTuple, get_args

import numpy as np
from fltea.records.arrays import Array, Mask
from fltea.spectrum.octaves import Octaves
from fltea.spectrum.order_fit import OrderFit
from fltea.spectrum.periodogram import Periodogram, periodogram
from fltea.spectrum.spectral import examine
from fltea.spectrum.verdict import decide

from tools.validation.evaluate.cases import Case

Quantity = Literal["alpha", "f", "F", "s2", "R"]
QUANTITIES: tuple[Quantity, ...] = get_args(Quantity)


class FitReading(NamedTuple):
    """The published results for all series of a noise; each array has the shape (seeds,)."""

    estimates: dict[str, Array]
    """For each name in QUANTITIES: the estimates. NaN stands for an estimate that is not published."""
    covered: dict[str, Mask]
    """For each quantity: whether its 95 % interval contains the true value. The dict is empty if no true
    values are known.
    """
    published: Mask
    """For each series: whether the verdict has an order that the data determine."""


def truths(case: Case) -> dict[str, float]:
    """Return the true value of each of QUANTITIES for a case, by name.

    For white noise the result is empty.
    """
    if case.alpha is None or case.f is None:
        return {}
    noise = case.noise
    return {"alpha": case.alpha, "f": case.f, "F": case.alpha + noise.g, "s2": noise.s2, "R": noise.R}


def whole_reading(y: Array, h: float, truth: dict[str, float]) -> FitReading:
    """Return the results from the periodograms of the whole records y (n, seeds)."""
    return read_fits([periodogram(one, h) for one in y.T], truth)


def live_readings(y: Array, h: float, lengths: Sequence[int], truth: dict[str, float]) -> list[FitReading]:
    """Return the results from the accumulators after each of `lengths` samples of y (n, seeds)."""
    return [read_fits(spectra, truth) for spectra in live_spectra(y, h, lengths)]


def live_spectra(y: Array, h: float, lengths: Sequence[int]) -> Iterator[list[Periodogram]]:
    """Feed the samples y (n, seeds) to the accumulators that the daemon uses.

    Yield the periodogram of each series after each of `lengths` samples.
    """
    octaves, at = Octaves(y.shape[1]), 0
    for n in lengths:
        octaves.add(y[at:n])
        at = n
        yield [octaves.periodogram(lane, h) for lane in range(y.shape[1])]


def read_fits(spectra: Sequence[Periodogram], truth: dict[str, float]) -> FitReading:
    """Return the published results of a fit to each of the spectra."""
    found = [published(one) for one in spectra]
    values: dict[str, Array] = {name: np.array([_value(one, name) for one in found]) for name in QUANTITIES}
    covered = {name: np.array([holds(one, name, value) for one in found]) for name, value in truth.items()}
    return FitReading(values, covered, np.isfinite(values["alpha"]))


def published(p: Periodogram) -> OrderFit:
    """Return the order in the verdict on one series; all its values are null if the verdict has no order."""
    return decide(examine(p, p.n * p.h, p.n).evidence).order


def holds(found: OrderFit, name: str, truth: float) -> bool:
    """Return whether the interval of the quantity `name` contains the true value.

    An unknown end counts as infinitely far away.
    """
    one = getattr(found, name)
    above_low, below_high = one.low is None or one.low <= truth, one.high is None or truth <= one.high
    return one.value is not None and above_low and below_high


def fitted_variances(y: Array, h: float, Q: float, power: float) -> tuple[Array, Array]:
    """Return the variances Q = s2 and R that fits of y (n, seeds) give, as two arrays (seeds,).

    `power`: variance of y. If the verdict on a series has no order, Q is the given `Q`, and R is `power`.
    Otherwise both are at least a thousandth of `power`: the fit may give 0, and the filters need R > 0.
    """
    found = whole_reading(y, h, {})
    least = power / 1000
    s2, R = (np.maximum(found.estimates[name], least) for name in ("s2", "R"))
    return np.where(found.published, s2, Q), np.where(found.published, R, power)


def _value(found: OrderFit, name: str) -> float:
    value = getattr(found, name).value
    return np.nan if value is None else float(value)
