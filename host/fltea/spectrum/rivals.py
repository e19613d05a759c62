"""The fractional model and its rivals: choice by BIC, and a test of what each leaves over (pure).

The rivals are white noise, AR(2), noise that rises with frequency, and sums of AR(1), each in white noise.
BIC (Schwarz 1978) hardly ever calls white noise anything else; AIC does so in every seventh series. A sum of
so many relaxations as there are decades looks like a fractional order: more of them are tried as long as the
fractional model is ahead.
"""

import math
from collections.abc import Iterable

import msgspec
import numpy as np
from numpy.typing import NDArray

from fltea.noise.spectra import fractional as fractional_spectrum
from fltea.spectrum.arfima import ARFIMA, LEAST_ORDER, MOST_ORDER, arfima_parameters
from fltea.spectrum.likelihood_ratio import NullFits, null_fits, p_value
from fltea.spectrum.models import (
    AR2,
    FULL,
    TWO_AR1,
    ar1_parameters,
    ar2_parameters,
    coordinates,
    held,
    logit,
    parameters,
)
from fltea.spectrum.periodogram import AT_ONCE, Binned, Periodogram, binned
from fltea.spectrum.pole_pair import peak_of, pole_pair
from fltea.spectrum.relaxations import MOST, NAMES, corner_hz, grown, sum_of, sum_parameters
from fltea.spectrum.residuals import farthest
from fltea.spectrum.rising import RISING, rising_parameters
from fltea.spectrum.warm import Search
from fltea.spectrum.whittle import Fit, fit

Array = NDArray[np.float64]

LOOKED_AT = 0.05
"""The null test's level below which all rivals are fitted; above it only the oldest are."""
ORDERS = (LEAST_ORDER, 0.3, 0.5, 0.7, MOST_ORDER)
AT_A_LIMIT = 0.01
NO_COLOUR = 1e-3
"""φ of a part that is white."""
ORDERED = ("fractional", "arfima")
"""Models with an order."""
APART = 6.0
"""The difference in 2 log L from which on two models count as different."""


class Rival(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A fitted model in the contest."""

    log_likelihood: float
    """The log likelihood above that of white noise."""
    bic: float
    """BIC above that of white noise: the lower, the better."""
    residual_ks: float
    """The distance of the cumulative periodogram over the spectrum; above 1.36 is rejected at 5 %."""
    parameters: dict[str, float]
    """Variances in the square of the unit of y; *_hz: corners and peaks, which may be above half the sample
    rate."""
    span: float = 1.0
    """Highest density over the lowest, of the frequencies that were fitted."""


class Contest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """All models on the same ordinates."""

    models: dict[str, Rival]
    """White, ar1, ar2, two_ar1, fractional; if white noise is rejected rising, arfima and more sums too."""
    best: str
    """The one of lowest BIC."""
    ratio_white: float
    """2 log L of the fractional model with α <= 1 above white noise."""
    order_gain: float = 0.0
    """2 log L of the best with an order from `LEAST_ORDER` to `MOST_ORDER` above white noise: the fractional
    model, or ARFIMA."""
    order: float = 0.5
    """The order of that model."""
    order_of: str = "fractional"
    """Which of the two it is: fractional or arfima."""

    @property
    def best_rival(self) -> str:
        """The one of lowest BIC that is neither white nor of an order."""
        return self._lowest(name for name in self.models if name not in ("white", *ORDERED))

    @property
    def best_sum(self) -> str:
        """The sum of relaxations of lowest BIC."""
        return self._lowest(self._sums() or [name for name in NAMES[1:] if name in self.models])

    def sum_within(self, apart: float) -> str:
        """Return the smallest sum of which 2 log L is at most so much below that of the order."""
        names = self._sums()
        near = (one for one in names if 2 * self.models[one].log_likelihood >= self.order_gain - apart)
        return next(near, self.best_sum)

    @property
    def sum_gain(self) -> float:
        """The highest 2 log L of any sum of relaxations above white noise."""
        return 2 * max((self.models[name].log_likelihood for name in self._sums()), default=0.0)

    def _sums(self) -> list[str]:
        """Return sums of which all parts are relaxations: one of φ < 0 is none."""
        found = []
        for name in NAMES[1:]:
            p = self.models[name].parameters if name in self.models else {}
            poles = [value for key, value in p.items() if key.startswith("phi")]
            if poles and min(poles) > -NO_COLOUR:
                found.append(name)
        return found

    def _lowest(self, names: Iterable[str]) -> str:
        return min(names, key=lambda name: self.models[name].bic)


class Fits(msgspec.Struct, frozen=True):
    """The fits that `contest` compares."""

    data: Binned
    null: NullFits
    full: Fit
    ar2: Fit
    sums: tuple[Fit, ...]
    """The sums of 1, 2, ... relaxations."""
    rising: Fit | None
    bounded: Fit
    """The fractional state of an order from `LEAST_ORDER` to `MOST_ORDER`."""
    arfima: Fit | None
    """Fitted where `rising` is."""

    @property
    def order(self) -> Fit:
        """The better of the two that have such an order; one within the limits before one at them."""
        both = [self.bounded] if self.arfima is None else [self.bounded, self.arfima]
        return min(both, key=lambda one: (not is_order(one), float(one.nll[0])))

    def named(self) -> dict[str, Fit]:
        """Return all fits but `bounded` by name."""
        found = {"white": self.null.white, "ar1": self.sums[0], "ar2": self.ar2, "fractional": self.full}
        found |= {NAMES[i + 1]: one for i, one in enumerate(self.sums)}
        if self.rising is not None and self.arfima is not None:
            found |= {"rising": self.rising, "arfima": self.arfima}
        return found


def bic(found: Fit, data: Binned) -> float:
    """Return BIC of one series, of which only differences count."""
    return 2 * float(found.nll[0]) + found.model.parameters * math.log(data.ordinates)


def fit_all(
    p: Periodogram, search: Search = fit, data: Binned | None = None, null: NullFits | None = None
) -> Fits:
    """Fit every model to one series; data, null: its bins and the fits of the null test, if there are any."""
    data = binned(p) if data is None else data
    null = null_fits(data, search) if null is None else null
    phi, weight = ar1_parameters(null.ar1.theta)
    inside = np.stack([coordinates(1.0, phi - 1, weight), null.alternative.theta], axis=1)
    # AR(1) is within both of its rivals: with φ2 = 0, and with a second part that has no share.
    pole, part = np.hsplit(null.ar1.theta, 2)
    ar2 = search(data, AR2, np.stack([pole, 0 * pole, part], axis=-1))
    two_ar1 = search(data, TWO_AR1, np.stack([pole, 0 * pole, part, logit(0 * part)], axis=-1))
    full = search(data, FULL, inside)
    sums: tuple[Fit, ...] = (null.ar1, two_ar1)
    rising, arfima, bounded = None, None, full
    if p_value(float(null.likelihood_ratio[0]), data.ordinates) < LOOKED_AT:
        bounded, arfima = _between(data, full, search), search(data, ARFIMA)
        lowest = min(float(bounded.nll[0]), float(arfima.nll[0]))
        sums = _more_sums(data, sums, lowest, search)
        rising = search(data, RISING)
    return Fits(data, null, full, ar2, sums, rising, bounded, arfima)


def _more_sums(data: Binned, sums: tuple[Fit, ...], lowest: float, search: Search) -> tuple[Fit, ...]:
    """Return further sums while the last was better, or an order of -log L `lowest` is ahead."""
    while len(sums) < MOST:
        better = bic(sums[-1], data) < bic(sums[-2], data)
        relaxing = [float(one.nll[0]) for one in sums if _relaxes(one)]
        ahead = not relaxing or 2 * (min(relaxing) - lowest) > APART
        if not (better or ahead):
            break
        count = len(sums)
        sums = (*sums, search(data, sum_of(count + 1), grown(data, sums[-1], count)))
    return sums


def _relaxes(found: Fit) -> bool:
    """Return whether all parts of a sum are relaxations: one of φ < 0 is none."""
    return bool(sum_parameters(found.theta, found.theta.shape[1] // 2).poles.min() > -NO_COLOUR)


def _between(data: Binned, full: Fit, search: Search) -> Fit:
    """Return the best model of an order that differs clearly from white noise and from a relaxation."""
    if LEAST_ORDER <= float(parameters(full.theta[0]).alpha) <= MOST_ORDER:
        return full
    return min((search(data, held("alpha", order)) for order in ORDERS), key=lambda f: float(f.nll[0]))


def contest(p: Periodogram, fits: Fits) -> Contest:
    """Compare the fits to the one series p."""
    white = fits.null.white
    models = {}
    for name, f in fits.named().items():
        gain = float(white.nll[0] - f.nll[0])
        extra = f.model.parameters - white.model.parameters
        models[name] = Rival(
            gain,
            extra * math.log(fits.data.ordinates) - 2 * gain,
            farthest(_over_spectrum(p, f), p.weight),
            _described(name, f, fits.data, p.h),
            _span(f.spectrum(fits.data.lam)[0]),
        )
    return Contest(
        models,
        min(models, key=lambda name: models[name].bic),
        float(fits.null.likelihood_ratio[0]),
        2 * float(white.nll[0] - fits.order.nll[0]),
        _order(fits.order),
        fits.order.model.name,
    )


def is_order(found: Fit) -> bool:
    """Return whether α or d is within its limits: at one of them it stands for what lies beyond."""
    return LEAST_ORDER + AT_A_LIMIT < _order(found) < MOST_ORDER - AT_A_LIMIT


def _span(density: Array) -> float:
    return float(density.max() / max(density.min(), 1e-300))


def _order(found: Fit) -> float:
    """Return α, or the d of ARFIMA."""
    if found.model.held.name:
        return found.model.held.value
    of = arfima_parameters(found.theta[0])[0] if found.model is ARFIMA else parameters(found.theta[0]).alpha
    return float(of)


def _over_spectrum(p: Periodogram, f: Fit) -> Array:
    """Yield I/S of the one series block by block, which takes less memory."""
    found = np.empty_like(p.lam)
    for begin in range(0, len(found), AT_ONCE):
        part = slice(begin, begin + AT_ONCE)
        found[part] = p.power[part] / f.spectrum(p.lam[part])[0]
    return found


def _described(name: str, f: Fit, data: Binned, h: float) -> dict[str, float]:
    scale, theta = float(f.scale[0]), f.theta[0]
    if name == "white":
        return {"R": scale}
    if name == "arfima":
        order, phi, weight = (float(v) for v in arfima_parameters(theta))
        return {"d": order, "phi": phi, "s2": weight * scale, "R": (1 - weight) * scale}
    if name == "rising":
        delta, weight = (float(v) for v in rising_parameters(theta))
        return {"delta": delta, "s2": weight * scale, "R": (1 - weight) * scale}
    if name == "ar2":
        phi1, phi2, weight = (float(v) for v in ar2_parameters(theta))
        described = {"phi1": phi1, "phi2": phi2, "s2": weight * scale, "R": (1 - weight) * scale}
        return described | pole_pair(data, phi1, phi2, h)
    if name in NAMES:
        return _described_sum(theta, scale, h)
    q = parameters(theta)
    alpha, g, weight = float(q.alpha), float(q.g), float(q.weight)
    bend = float(2 * np.arcsin(min((-g) ** (1 / max(alpha, 1e-3)) / 2, 1.0)) / (2 * math.pi * h))
    found = {"alpha": alpha, "g": g, "bend_hz": bend, "s2": weight * scale, "R": (1 - weight) * scale}
    ends = fractional_spectrum(np.array([np.pi / 1000, np.pi]), alpha, g)
    found["rise"] = float(ends[1] / ends[0])
    return found | peak_of(data, lambda lam: fractional_spectrum(lam, alpha, g), h)


def _described_sum(theta: Array, scale: float, h: float) -> dict[str, float]:
    count = len(theta) // 2
    p = sum_parameters(theta[np.newaxis], count)
    order = np.argsort(-p.poles[0])
    found = {"R": float(p.white[0]) * scale}
    for i, k in enumerate(order.tolist(), start=1):
        phi, s2 = float(p.poles[0, k]), float(p.shares[0, k]) * scale
        number = "" if count == 1 else f"_{i}"
        found |= {f"phi{number}": phi, f"s2{number}": s2}
        if phi > 0:
            found[f"bend{number}_hz"] = corner_hz(phi, h)
    return found
