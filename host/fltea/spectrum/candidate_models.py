"""The candidate noise models of one spectrum: the best model without an order, and the best with one.

The native search (host/native/whittle_search.hpp) finds each model. It adds one part after another, as long
as the new part raises 2 log L by more than a price for each of its parameters. At BIC's price (the logarithm
of the number of ordinates) hardly any part is added by chance. In a long record, though, a noise may be a sum
of many relaxations, each of which raises 2 log L by less than that price. BIC alone would then prefer a model
with an order, where there is none. Therefore a second model without an order is searched for at a lower
price, and a model with an order has to be ahead of both.
"""

import math
from collections.abc import Iterator
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fltea import _native
from fltea.noise.parts import (
    CODES,
    Arfima,
    Order,
    Part,
    White,
    free_of,
    kind_of,
    part_of,
    spectrum_of,
)
from fltea.records.arrays import Array
from fltea.spectrum.octaves import BLOCK, JOIN, WHOLE
from fltea.spectrum.periodogram import Binned

BY_CHANCE = 4.0
"""In a search, each further parameter of a model may raise 2 log L (twice the log likelihood) by this much by
chance.
"""
LEAST_ORDER, MOST_ORDER = 0.15, 0.85
"""Lowest and highest order α that a search fits. Noise of a lower order is hardly different from white noise.
Noise of a higher order is described as well by a relaxation.
"""
AT_A_LIMIT = 0.01
ABOVE_ONE = 1.2, 1.6
"""If orders up to 2 are allowed, fits also start at these orders."""
WITHOUT_WHITE, NO_WHITE = (0.25, 0.5), 12.0
"""The model with the reported order is fitted again, from two starting points with almost no white noise.
Each has one of the orders in WITHOUT_WHITE. The variance R of the white noise is exp(-NO_WHITE) times that of
the first fit.
"""
AHEAD = 6.0
"""Two models have an order: ARFIMA, and the fractional state D^α x = f x + ω in white noise. ARFIMA is
reported only if its 2 log L is higher by at least this than that of the fractional state.
"""
LEAK_OF_CUBIC = 1 / 9
"""A random walk leaks into all frequencies, since the last sample of a record differs from the first one. If
a cubic is subtracted from the record, the mean square of this difference, and so the power that leaks,
becomes this proportion of what it was.
"""

Raw = tuple[list[int], list[float], float]


class FittedModel(NamedTuple):
    """A noise model that was fitted: its parts and their parameters.

    `codes`: the native module's code number of each part, white noise first. `eta`: the fitted values of the
    transformed free parameters of all parts.
    """

    codes: tuple[int, ...]
    eta: tuple[float, ...]
    nll: float
    """Negative log-likelihood (-log L) of the fit."""

    @property
    def parameters(self) -> int:
        """Return the number of parameters that BIC counts.

        This number includes parameters whose value is found by trying several values: the number of samples
        of a mean, the frequency of a notch.
        """
        return sum(map(free_of, self.codes)) + sum(kind.row().sought for kind in self.kinds)

    @property
    def kinds(self) -> tuple[type[Part], ...]:
        """Return the kinds of the model's parts."""
        return tuple(map(kind_of, self.codes))

    def terms(self) -> Iterator[tuple[int, int]]:
        """Yield for each part its code, and the index in `eta` of its first parameter."""
        at = 0
        for code in self.codes:
            yield code, at
            at += free_of(code)

    def parts(self, h: float) -> tuple[Part, ...]:
        """Return the parts with their parameters in physical units."""
        return tuple(part_of(code, self.eta[at : at + free_of(code)], h) for code, at in self.terms())

    def spectrum(self, lam: Array, h: float) -> Array:
        """Return the power spectrum at λ > 0 [rad a sample], (len(lam),)."""
        return spectrum_of(self.codes, self.eta, lam, h)

    def without(self, kind: type[Part]) -> "FittedModel":
        """Return the model without its parts of `kind`.

        The other parts are not fitted again, and `nll` is still the -log L of the whole model.
        """
        terms = [(code, at) for code, at in self.terms() if kind_of(code) is not kind]
        eta = [self.eta[at + k] for code, at in terms for k in range(free_of(code))]
        return FittedModel(tuple(code for code, _ in terms), tuple(eta), self.nll)

    def place(self, *kinds: type[Part]) -> int | None:
        """Return the index in `eta` where the parameters of a part begin; None if there is no such part.

        The part is the first one that has one of these kinds.
        """
        return next((at for code, at in self.terms() if kind_of(code) in kinds), None)


class Fits:
    """Results from which a later fit of the same axis begins. This object keeps no reference to the data.

    `raw`: the fitted models. `elsewhere`: free parameters of fits at other, fixed orders, which made an
    interval of the reported order's parameters wider; None if such fits have not been searched for yet.
    `ends`: for each end of a parameter's interval, the parameters there minus those of the best fit. A key of
    `ends` consists of the codes of the model's parts, the parameter's index, and the side. `beside`:
    parameters of the other models that are fitted for the interval of N. A key of `beside` consists of the
    codes of the model's parts.
    """

    def __init__(self, raw: list[Raw], last: "Fits | None" = None) -> None:
        self.raw = raw
        self.elsewhere: list[list[float]] | None = None if last is None else last.elsewhere
        self.ends: dict[tuple[tuple[int, ...], int, int], list[float]] = {} if last is None else last.ends
        self.beside: dict[tuple[int, ...], list[float]] = {} if last is None else last.beside


# Why more than 12 attributes: the models are compared with each other, so they are kept side by side.
class CandidateModels:
    """The noise models that are fitted to the spectrum of one series.

    `samples`: length of the record, on which the leakage of a random walk depends.

    Attributes:
        white: white noise alone.
        null: an order up to 1 in white noise, the first alternative to white noise in the null test.
        missing: white noise through a high-pass of one pole, the second alternative to white noise in the
            null test.
        plain: the best model without an order. BIC chooses the number of its parts.
        rich: the best model without an order, if a further part has to raise 2 log L by less than for BIC.
        pure: the best model with an order and without relaxations or random walks, or None if nothing
            indicates an order.
        ordered: the best model with an order, or None if nothing indicates an order.

    Raises:
        ValueError: no spectrum can be fitted to the data.
    """

    def __init__(self, data: Binned, h: float, samples: int, last: Fits | None = None) -> None:
        self.data, self.h, self.samples = data, h, samples
        self.native = native(data, h, samples)
        self.ordinates = float(data.counts.sum())
        found = self.native.search(last.raw if last is not None else [])
        self.fits = Fits(found, last)
        self.white, self.null, self.plain, self.rich = (_fitted_model(one) for one in found[:4])
        self.pure, self.ordered = (_fitted_model(one) if one[0] else None for one in found[4:6])
        self.missing = _fitted_model(found[6])

    @cached_property
    def order(self) -> FittedModel | None:
        """Return the model whose order is reported.

        It is the best model with an order, fitted again without limits of the order. That may be an ARFIMA,
        which has no parameter f. Then the fractional state D^α x = f x + ω in white noise is reported in its
        place, if its 2 log L is less than AHEAD below that of the ARFIMA.
        """
        if self.ordered is None:
            return None
        found = min(self._starts(self._unlimited(self.ordered)), key=lambda one: one.nll)
        if found.place(Order) is None:
            state = self._unlimited(self.null)
            if 2 * (state.nll - found.nll) < AHEAD:
                return state
        return found

    def _starts(self, found: FittedModel) -> Iterator[FittedModel]:
        """Yield the fit `found`, and fits that start from the same model with almost no white noise.

        The further starts help because an order with white noise and another order without white noise can
        have nearly the same spectrum.
        """
        yield found
        at = found.place(Order)
        if at is None or self.fits.elsewhere is not None:
            return
        for order in WITHOUT_WHITE:
            eta = [found.eta[0] - NO_WHITE, *found.eta[1:at], order, *found.eta[at + 1 :]]
            yield self._unlimited(found._replace(eta=tuple(eta)))

    def _unlimited(self, one: FittedModel) -> FittedModel:
        eta, nll = self.native.fit(list(one.codes), list(one.eta))
        return FittedModel(one.codes, tuple(eta), nll)

    @property
    def ratio_white(self) -> float:
        """Return the statistic of the null test: by how much 2 log L exceeds that of white noise.

        It is that of the better one of the two alternatives `null` and `missing`, and 0 or more.
        """
        return max(2 * (self.white.nll - min(self.null.nll, self.missing.nll)), 0.0)

    def gain(self, one: FittedModel) -> float:
        """Return by how much the 2 log L of model `one` exceeds that of white noise."""
        return 2 * (self.white.nll - one.nll)

    def bic(self, one: FittedModel) -> float:
        """Return the BIC of model `one` minus that of white noise. A lower value is better."""
        return math.log(self.ordinates) * (one.parameters - 1) - self.gain(one)

    @cached_property
    def lead(self) -> float:
        """Return the BIC of the best model without an order minus that of the best model with an order."""
        return -math.inf if self.ordered is None else self.bic(self.plain) - self.bic(self.ordered)

    @cached_property
    def lead_over_rich(self) -> float:
        """Return by how much 2 log L of the best model with an order exceeds that of `rich`."""
        return -math.inf if self.ordered is None else self.gain(self.ordered) - self.gain(self.rich)


def native(data: Binned, h: float, samples: int) -> _native.WhittleFits:
    """Return the native module's object that fits models to the one series in `data`.

    The arguments are those of `CandidateModels`.

    Raises:
        ValueError: no spectrum can be fitted to the data.
    """
    lam = np.ascontiguousarray(data.lam, dtype=np.float64)
    walk = walk_column(lam, samples)
    counts, power = (np.ascontiguousarray(a, dtype=np.float64) for a in (data.counts, data.power[0]))
    return _native.WhittleFits(lam, counts, power, walk, windows(lam, samples), h)


def windows(lam: Array, samples: int) -> Array:
    """Return how far Hann's window smears each bin: the mean square distance in frequency [rad²], (bins,).

    For a block of m samples, the window's mean square is (2π / m)² / 3. A twelfth of (2π / m)² is subtracted:
    the mean square distance within the bin's own band, which reaches halfway to its neighbours. The value is
    0 for the lowest frequencies, which do not come from blocks. Which bins these are depends on `samples`,
    the length of the record.
    """
    level = np.maximum(np.ceil(np.log2(JOIN / 2 / lam)), 0.0)
    depth = max(0, math.ceil(math.log2(max(samples, 1) / WHOLE)))
    step = 2 * np.pi / BLOCK / 2**level
    return np.where(level < depth, step**2 / 4, 0.0)


def walk_column(lam: Array, samples: int) -> Array:
    """Return for each bin the power of a random walk whose steps have the variance 1.

    `samples`: length of the record.
    """
    leak = np.where(leaking(lam, samples), LEAK_OF_CUBIC, 0.0)
    return np.asarray((1 + leak) / (4 * np.sin(lam / 2) ** 2))


def leaking(lam: Array, samples: int) -> NDArray[np.bool_]:
    """Return which bins do not come from blocks with a window, so that a random walk leaks into them.

    These are the lowest frequencies of the record, or all frequencies of a short record.
    """
    level = max(0, math.ceil(math.log2(max(samples, 1) / WHOLE)))
    return np.asarray(lam < JOIN / 2**level if level else np.ones(len(lam), dtype=np.bool_))


def order_in_white(fits: _native.WhittleFits) -> FittedModel:
    """Return the best fit of white noise and an order up to 2. This is the model that the firmware fits."""
    codes = [CODES.index(White), CODES.index(Order)]
    white, alpha, logit, s2 = fits.null_test([])[2][:4]
    starts = [[white, start, logit, s2] for start in (alpha, *ABOVE_ONE)]
    eta, nll = min((fits.fit(codes, start) for start in starts), key=lambda found: found[1])
    return FittedModel(tuple(codes), tuple(eta), nll)


def order_of(one: FittedModel | None) -> float | None:
    """Return the order of a model: α, or d of ARFIMA.

    The result is None if the model has no order, or if the fit stopped at a limit of the order, since the
    true order may lie beyond the limit.
    """
    at = one.place(Order, Arfima) if one is not None else None
    if one is None or at is None:
        return None
    value = one.eta[at]
    return value if LEAST_ORDER + AT_A_LIMIT < value < MOST_ORDER - AT_A_LIMIT else None


def _fitted_model(raw: Raw) -> FittedModel:
    codes, eta, nll = raw
    return FittedModel(tuple(codes), tuple(eta), nll)
