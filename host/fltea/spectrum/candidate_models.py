"""The sentences of one spectrum that compete: the best without an order, and the best with one (pure).

Each is sought by the same native search (host/native/sentence_search.hpp), which adds parts for as long as
they gain more than their price in 2 log L. At BIC's price, log of the ordinates a parameter, chance adds
none; but in much data a sum of many relaxations costs more than what it gains over an order, so that BIC
alone would call it an order. So there is a second sentence without an order at a lower price, and an order
has to be ahead of both.
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
"""2 log L that chance may gain with each further parameter that was sought."""
LEAST_ORDER, MOST_ORDER = 0.15, 0.85
"""Orders that are fitted: below, little of one is left, and above it is as good as a relaxation."""
AT_A_LIMIT = 0.01
ABOVE_ONE = 1.2, 1.6
"""Orders at which the search for those up to 2 begins, too."""
WITHOUT_WHITE, NO_WHITE = (0.25, 0.5), 12.0
"""Orders at which the fit of the reported one begins once more, without white noise: with so much less of it,
in the logarithm."""
AHEAD = 6.0
"""In 2 log L, by which ARFIMA has to be ahead of the state."""
LEAK_OF_CUBIC = 1 / 9
"""The leak of a random walk without its cubic: the mean square of the step from the last sample to the first
over what the walk does in a record, which it has more at all frequencies of the whole."""

Raw = tuple[list[int], list[float], float]


class Sentence(NamedTuple):
    """Parts by their numbers in the native module, white noise first, with coordinates as fitted."""

    codes: tuple[int, ...]
    eta: tuple[float, ...]
    nll: float
    """-log L."""

    @property
    def parameters(self) -> int:
        """The number of parameters, as BIC counts them: m of a mean, and a notch's place, were sought too."""
        return sum(map(free_of, self.codes)) + sum(kind.row().sought for kind in self.kinds)

    @property
    def kinds(self) -> tuple[type[Part], ...]:
        """The kinds of the parts."""
        return tuple(map(kind_of, self.codes))

    def words(self) -> Iterator[tuple[int, int]]:
        """Yield the number of each part, and the place of its first coordinate."""
        at = 0
        for code in self.codes:
            yield code, at
            at += free_of(code)

    def parts(self, h: float) -> tuple[Part, ...]:
        """Return the parts in their units."""
        return tuple(part_of(code, self.eta[at : at + free_of(code)], h) for code, at in self.words())

    def spectrum(self, lam: Array, h: float) -> Array:
        """Return the spectrum at λ > 0, (len(lam),)."""
        return spectrum_of(self.codes, self.eta, lam, h)

    def without(self, kind: type[Part]) -> "Sentence":
        """Return it without the parts of a kind, all else being as it was; its -log L is that with them."""
        words = [(code, at) for code, at in self.words() if kind_of(code) is not kind]
        eta = [self.eta[at + k] for code, at in words for k in range(free_of(code))]
        return Sentence(tuple(code for code, _ in words), tuple(eta), self.nll)

    def place(self, *kinds: type[Part]) -> int | None:
        """Return where the coordinates of the first part of these kinds begin."""
        return next((at for code, at in self.words() if kind_of(code) in kinds), None)


class Fits:
    """What a later look at the same axis begins at, without the data.

    raw: of the sentences. elsewhere: fits of the reported order that belong to its interval, near or far;
    None: not looked for yet. ends: how the fit at an end of a coordinate's interval differs from the
    best, by codes, place and side. beside: fits with one more part for the interval of N, by their codes.
    """

    def __init__(self, raw: list[Raw], last: "Fits | None" = None) -> None:
        self.raw = raw
        self.elsewhere: list[list[float]] | None = None if last is None else last.elsewhere
        self.ends: dict[tuple[tuple[int, ...], int, int], list[float]] = {} if last is None else last.ends
        self.beside: dict[tuple[int, ...], list[float]] = {} if last is None else last.beside


class CandidateModels:
    """The sentences fitted to one series. Of `samples`: the length of the record, for what a walk leaks.

    white; null and missing: the null test's alternatives, an order up to 1 in white noise, and white noise
    through a high-pass of one pole; plain: the best by BIC without an order; rich: the same at a lower price;
    pure: the best with an order and without relaxations or walks; ordered: the best with an order. pure and
    ordered are None where nothing looks like an order.

    Raises:
        ValueError: no spectrum can be fitted to the data.
    """

    def __init__(self, data: Binned, h: float, samples: int, last: Fits | None = None) -> None:
        self.data, self.h, self.samples = data, h, samples
        self.native = native(data, h, samples)
        self.ordinates = float(data.counts.sum())
        found = self.native.search(last.raw if last is not None else [])
        self.fits = Fits(found, last)
        self.white, self.null, self.plain, self.rich = (_sentence(one) for one in found[:4])
        self.pure, self.ordered = (_sentence(one) if one[0] else None for one in found[4:6])
        self.missing = _sentence(found[6])

    @cached_property
    def order(self) -> Sentence | None:
        """The sentence whose order is reported: of the best with one, without the limits of the search.

        ARFIMA has no f, and is reported only where it is ahead of white noise and the state.
        """
        if self.ordered is None:
            return None
        found = min(self._starts(self._unlimited(self.ordered)), key=lambda one: one.nll)
        if found.place(Order) is None:
            state = self._unlimited(self.null)
            if 2 * (state.nll - found.nll) < AHEAD:
                return state
        return found

    def _starts(self, found: Sentence) -> Iterator[Sentence]:
        """Yield the fit of an order, and those that are reached from where it has no white noise, if it has.

        An order in white noise and another one without have the same spectrum, very nearly.
        """
        yield found
        at = found.place(Order)
        if at is None or self.fits.elsewhere is not None:
            return
        for order in WITHOUT_WHITE:
            eta = [found.eta[0] - NO_WHITE, *found.eta[1:at], order, *found.eta[at + 1 :]]
            yield self._unlimited(found._replace(eta=tuple(eta)))

    def _unlimited(self, one: Sentence) -> Sentence:
        eta, nll = self.native.fit(list(one.codes), list(one.eta))
        return Sentence(one.codes, tuple(eta), nll)

    @property
    def ratio_white(self) -> float:
        """2 log L of the better of the null test's alternatives above white noise."""
        return max(2 * (self.white.nll - min(self.null.nll, self.missing.nll)), 0.0)

    def gain(self, one: Sentence) -> float:
        """Return 2 log L above that of white noise."""
        return 2 * (self.white.nll - one.nll)

    def bic(self, one: Sentence) -> float:
        """Return BIC above that of white noise: the lower, the better."""
        return math.log(self.ordinates) * (one.parameters - 1) - self.gain(one)

    @cached_property
    def lead(self) -> float:
        """By how much the best with an order is ahead of the best without one, after BIC's price."""
        return -math.inf if self.ordered is None else self.bic(self.plain) - self.bic(self.ordered)

    @cached_property
    def lead_over_rich(self) -> float:
        """By how much its 2 log L is ahead of the sentence at the lower price."""
        return -math.inf if self.ordered is None else self.gain(self.ordered) - self.gain(self.rich)


def native(data: Binned, h: float, samples: int) -> _native.Sentences:
    """Return the native fits of the one series of `data`; arguments as of `CandidateModels`.

    Raises:
        ValueError: no spectrum can be fitted to the data.
    """
    lam = np.ascontiguousarray(data.lam, dtype=np.float64)
    walk = walk_column(lam, samples)
    counts, power = (np.ascontiguousarray(a, dtype=np.float64) for a in (data.counts, data.power[0]))
    return _native.Sentences(lam, counts, power, walk, windows(lam, samples), h)


def windows(lam: Array, samples: int) -> Array:
    """Return the mean square of the frequencies that a line sees around its own, (bins,), by Hann's window.

    That of a block of m samples is (2π / m)² / 3. A twelfth of (2π / m)² is left out, since lines are taken
    to fill the space between them. What is below the octaves of a record of so many samples is of no blocks.
    """
    level = np.maximum(np.ceil(np.log2(JOIN / 2 / lam)), 0.0)
    depth = max(0, math.ceil(math.log2(max(samples, 1) / WHOLE)))
    step = 2 * np.pi / BLOCK / 2**level
    return np.where(level < depth, step**2 / 4, 0.0)


def walk_column(lam: Array, samples: int) -> Array:
    """Return what a random walk with steps of variance 1 has in bins of a record of so many samples."""
    leak = np.where(leaking(lam, samples), LEAK_OF_CUBIC, 0.0)
    return np.asarray((1 + leak) / (4 * np.sin(lam / 2) ** 2))


def leaking(lam: Array, samples: int) -> NDArray[np.bool_]:
    """Return which bins of a record of so many samples are of its lowest octave, into which a walk leaks."""
    level = max(0, math.ceil(math.log2(max(samples, 1) / WHOLE)))
    return np.asarray(lam < JOIN / 2**level if level else np.ones(len(lam), dtype=np.bool_))


def order_in_white(fits: _native.Sentences) -> Sentence:
    """Return white noise and the best order up to 2, which is what a board fits."""
    codes = [CODES.index(White), CODES.index(Order)]
    white, alpha, logit, s2 = fits.null_test([])[2][:4]
    starts = [[white, start, logit, s2] for start in (alpha, *ABOVE_ONE)]
    eta, nll = min((fits.fit(codes, start) for start in starts), key=lambda found: found[1])
    return Sentence(tuple(codes), tuple(eta), nll)


def order_of(one: Sentence | None) -> float | None:
    """Return α, or d of ARFIMA; None without one, or at a limit, where it stands for what is beyond."""
    at = one.place(Order, Arfima) if one is not None else None
    if one is None or at is None:
        return None
    value = one.eta[at]
    return value if LEAST_ORDER + AT_A_LIMIT < value < MOST_ORDER - AT_A_LIMIT else None


def _sentence(raw: Raw) -> Sentence:
    codes, eta, nll = raw
    return Sentence(tuple(codes), tuple(eta), nll)
