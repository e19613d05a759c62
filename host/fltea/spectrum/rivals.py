"""The fractional model beside its rivals: choice by BIC, and a test of what each leaves over (pure).

The rivals are white noise, AR(1), AR(2) and the sum of two AR(1), each in white noise. BIC (Schwarz 1978)
hardly ever calls white noise anything else; AIC does so in every seventh series.
"""

import math

import msgspec
import numpy as np
from numpy.typing import NDArray

from fltea.spectrum.likelihood_ratio import NullFits, null_fits
from fltea.spectrum.models import (
    AR2,
    FULL,
    TWO_AR1,
    ar1_parameters,
    ar2_parameters,
    coordinates,
    logit,
    parameters,
    two_ar1_parameters,
)
from fltea.spectrum.periodogram import AT_ONCE, Binned, Periodogram, binned
from fltea.spectrum.warm import Search
from fltea.spectrum.whittle import Fit, fit

Array = NDArray[np.float64]


class Rival(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A fitted model."""

    log_likelihood: float
    """above that of white noise"""
    bic: float
    """below that of white noise: the lower, the better"""
    residual_ks: float
    """of the cumulative periodogram over the spectrum; above 1.36 the model is rejected at 5 %"""
    parameters: dict[str, float]
    """variances in the square of the unit of y; *_hz: where its spectrum bends or peaks"""


class Contest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """All models on the same ordinates."""

    models: dict[str, Rival]
    """white, ar1, ar2, two_ar1, fractional"""
    best: str
    """the one of lowest BIC"""
    ratio_white: float
    """2 log L of the fractional model with α <= 1 above white noise"""
    ratio_ar1: float
    """the same above AR(1)"""

    @property
    def best_rival(self) -> str:
        """The one of lowest BIC that is neither white nor fractional."""
        names = (name for name in self.models if name not in ("white", "fractional"))
        return min(names, key=lambda name: self.models[name].bic)


class Fits(msgspec.Struct, frozen=True):
    """What `contest` is made from."""

    data: Binned
    null: NullFits
    full: Fit
    ar2: Fit
    two_ar1: Fit


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
    return Fits(data, null, search(data, FULL, inside), ar2, two_ar1)


def contest(p: Periodogram, fits: Fits) -> Contest:
    """Compare the fits to the one series p."""
    white = fits.null.white
    models = {}
    for name, f in (
        ("white", white),
        ("ar1", fits.null.ar1),
        ("ar2", fits.ar2),
        ("two_ar1", fits.two_ar1),
        ("fractional", fits.full),
    ):
        gain = float(white.nll[0] - f.nll[0])
        extra = f.model.parameters - white.model.parameters
        models[name] = Rival(
            gain,
            extra * math.log(fits.data.ordinates) - 2 * gain,
            _farthest(_over_spectrum(p, f), p.weight),
            _described(name, f, p.h),
        )
    return Contest(
        models,
        min(models, key=lambda name: models[name].bic),
        float(fits.null.likelihood_ratio[0]),
        float(fits.null.ratio_to_ar1[0]),
    )


def residual_ks(power: Array, spectrum: Array, weight: Array | None = None) -> float:
    """√m times the largest distance between the cumulative sum of I/S, scaled to 1, and a straight line.

    Of a right model the ratios are exponential and alike, and the sum is a Brownian bridge (Bartlett 1955).
    weight: effective ordinates of each line, of which there are then m in all.
    """
    return _farthest(np.asarray(power / spectrum), weight)


def _farthest(ratio: Array, weight: Array | None = None) -> float:
    """`residual_ks` of I/S, (m,), which is overwritten."""
    if weight is not None:
        # A line of weight w adds w I/S, with the variance w: the bridge has W = sum of w in place of m.
        sums, line = np.cumsum(ratio * weight), weight.cumsum()
        return float(np.abs(sums / sums[-1] - line / line[-1]).max()) * math.sqrt(line[-1])
    sums = np.cumsum(ratio, out=ratio)
    m = len(sums)
    farthest = 0.0
    for begin in range(0, m, AT_ONCE):
        part = sums[begin : begin + AT_ONCE]
        line = np.arange(begin + 1, begin + len(part) + 1) / m
        farthest = max(farthest, float(np.abs(part / sums[-1] - line).max()))
    return farthest * math.sqrt(m)


def _over_spectrum(p: Periodogram, f: Fit) -> Array:
    """I/S of the one series, block by block: computing a spectrum takes many times as much as it has."""
    found = np.empty_like(p.lam)
    for begin in range(0, len(found), AT_ONCE):
        part = slice(begin, begin + AT_ONCE)
        found[part] = p.power[part] / f.spectrum(p.lam[part])[0]
    return found


def bend_hz(phi: float, h: float) -> float:
    """Where the spectrum of AR(1) with φ > 0 has fallen by half, in Hz; at most Nyquist's frequency."""
    if phi <= 0:
        return 0.5 / h
    return float(2 * np.arcsin(min((1 - phi) / (2 * math.sqrt(phi)), 1.0)) / (2 * math.pi * h))


def _described(name: str, f: Fit, h: float) -> dict[str, float]:
    scale, theta = float(f.scale[0]), f.theta[0]
    if name == "white":
        return {"R": scale}
    if name == "ar1":
        phi, weight = (float(v) for v in ar1_parameters(theta))
        return {"phi": phi, "bend_hz": bend_hz(phi, h), "s2": weight * scale, "R": (1 - weight) * scale}
    if name == "ar2":
        phi1, phi2, weight = (float(v) for v in ar2_parameters(theta))
        described = {"phi1": phi1, "phi2": phi2, "s2": weight * scale, "R": (1 - weight) * scale}
        under = phi1 * phi1 + 4 * phi2
        if under < 0:
            return described | {
                "resonance_hz": math.atan2(math.sqrt(-under), phi1) / (2 * math.pi * h),
                "damping": -math.log(-phi2) / 2,
            }
        return described | {"bend_hz": bend_hz((phi1 + math.sqrt(under)) / 2, h)}
    if name == "two_ar1":
        phi1, phi2, first, second = (float(v) for v in two_ar1_parameters(theta))
        slow, fast = sorted([(phi1, first), (phi2, second)], reverse=True)
        return {
            "phi_slow": slow[0],
            "bend_slow_hz": bend_hz(slow[0], h),
            "s2_slow": slow[1] * scale,
            "phi_fast": fast[0],
            "bend_fast_hz": bend_hz(fast[0], h),
            "s2_fast": fast[1] * scale,
            "R": (1 - first - second) * scale,
        }
    q = parameters(theta)
    alpha, g, weight = float(q.alpha), float(q.g), float(q.weight)
    bend = float(2 * np.arcsin(min((-g) ** (1 / max(alpha, 1e-3)) / 2, 1.0)) / (2 * math.pi * h))
    return {"alpha": alpha, "g": g, "bend_hz": bend, "s2": weight * scale, "R": (1 - weight) * scale}
