"""Composite models of noise as navigation filters have them, fitted and chosen (pure).

White noise, up to four Gauss–Markov parts, with or without a random walk and quantisation noise: the models
that GMWM fits to wavelet variances (Guerrier et al., *J. Am. Stat. Assoc.* 108, 2013). Here they are fitted
by Whittle's likelihood, as all other models are, and chosen by BIC. A corner below the lowest frequency is no
corner that the data have: such a part is a random walk to them. One above half the sample rate is white.
"""

import math
from collections.abc import Iterable, Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from fltea.spectrum.composite_fit import (
    Kind,
    Lines,
    Point,
    at,
    bounds,
    likelihood,
    lines,
    score,
    slopes,
)
from fltea.spectrum.composite_intervals import Estimate, interval, of_walk
from fltea.spectrum.periodogram import Binned
from fltea.spectrum.relaxations import sum_parameters
from fltea.spectrum.whittle import Fit

Array = NDArray[np.float64]

MOST = 4
"""Gauss–Markov parts."""
CORNERS_A_DECADE = 3
"""Corners a decade at which a further part starts."""
KEPT_STARTS = 3
NEW_PARTS = (0.1, 1.0)
"""Plateaus of a further part over the spectrum at its corner, as starts."""
AT_END = 1e-3
"""The distance in log corner from an end of the data below which a corner is at it."""
MARGIN = 2.0
"""BIC that a further part has to gain: a dozen models are compared, and BIC reckons with two."""


class GaussMarkov(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A part with dx/dt = -x / τ + noise of density q; at h, x_k = φ x_{k-1} + noise of variance s2."""

    sigma: Estimate
    """Standard deviation of x, in the unit of y."""
    tau_s: Estimate
    """Correlation time."""
    q: float
    """2 σ² / τ, in the square of the unit a second."""
    phi: float
    s2: float
    """The variance in the square of the unit."""


class Composite(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The composite model of lowest BIC. With y in deg/s the unit of Q is deg; else the unit of y times s."""

    name: str
    N: Estimate
    """White noise, per √Hz: its Allan deviation is N / √τ."""
    gauss_markov: tuple[GaussMarkov, ...]
    """The slowest first."""
    K: Estimate | None
    """Random walk, a second and √Hz: K √(τ / 3)."""
    Q: Estimate | None
    """Quantisation noise: √3 Q / τ."""
    bic: dict[str, float]
    """BIC of all models that were compared, above that of white noise: the lower, the better."""
    h_s: float
    from_hz: float
    """Lowest frequency that was fitted: nothing is known of what is slower."""
    low_pass_hz: float | None = None
    """Corner of the filter that all of it has gone through; the parts are those before it."""
    drift_rate: Estimate | None = None
    """The slope of the line through the record, in the unit a second; if 0 is within, it may be noise."""

    def spectrum(self, lam: Array) -> Array:
        """Return the spectrum at λ in rad a sample, (len(lam),)."""
        kind = Kind(len(self.gauss_markov), self.K is not None, self.Q is not None)
        h = self.h_s
        parameters = [self.N.value**2 / h, *(one.sigma.value**2 for one in self.gauss_markov)]
        parameters += [h / one.tau_s.value for one in self.gauss_markov]
        parameters += [self.K.value**2 * h] if self.K else []
        parameters += [(self.Q.value / h) ** 2] if self.Q else []
        return slopes(at(lam), kind, np.log(np.maximum(parameters, 1e-300)))[0]


def composite(data: Binned, h: float, samples: int, sums: Sequence[Fit] = ()) -> Composite:
    """Fit the one series of `data`, of a record of so many samples at a sampling period of h s.

    sums: fits of sums of 1, 2, ... AR(1), as starts.
    """
    seen = lines(data, samples)
    found = compared(seen, sums)
    white = _bic(seen, Kind(0, False, False), found[Kind(0, False, False)])
    bic = {kind: _bic(seen, kind, point) - white for kind, point in found.items()}
    kind = _simplest(bic)
    by_name = {one.name: value for one, value in bic.items()}
    return _in_units(seen, h, kind, found[kind], by_name)


def compared(data: Lines, sums: Sequence[Fit] = ()) -> dict[Kind, Point]:
    """Return the best point of every model whose corners are all where the data are."""
    found: dict[Kind, Point] = {}
    for walk, quantised in ((False, False), (True, False), (False, True), (True, True)):
        worse = 0
        last: Point | None = None
        lowest = math.inf
        for count in range(MOST + 1):
            kind = Kind(count, walk, quantised)
            starts = [_level(data, kind)] if count == 0 else _grown(data, kind, last)
            starts += _of_sums(sums, kind)
            starts += [eta for other, point in found.items() for eta in _extended(data, other, point, kind)]
            last = min((score(data, kind, eta) for eta in starts), key=lambda point: point.nll)
            if not _has_such_corners(data, kind, last):
                break
            found[kind] = last
            now = _bic(data, kind, last)
            worse = worse + 1 if now >= lowest else 0
            lowest = min(lowest, now)
            if worse == 2:
                break
    return found


def _simplest(bic: dict[Kind, float]) -> Kind:
    """Return the one of lowest BIC, unless a smaller one is nearly as good."""
    lowest = min(bic.values())
    return min((kind for kind in bic if bic[kind] <= lowest + MARGIN), key=lambda k: (k.parameters, bic[k]))


def _bic(data: Lines, kind: Kind, point: Point) -> float:
    return 2 * point.nll + kind.parameters * math.log(data.counts.sum())


def _level(data: Lines, kind: Kind) -> Array:
    """Return white noise for the upper half of lanes, and for the others what leaves it so."""
    power = data.power
    white = math.log(np.average(power[len(power) // 2 :], weights=data.counts[len(power) // 2 :]))
    walk = math.log(max(power[0], power[1]) * data.lam[0] ** 2)
    return np.array([white] + [walk] * kind.walk + [white - 2] * kind.quantised)


def _grown(data: Lines, kind: Kind, last: Point | None) -> list[Array]:
    """Return starts of one part more: the best of corners all over the data."""
    if last is None:
        return []
    smaller = kind._replace(gauss_markov=kind.gauss_markov - 1)
    low, high = math.log10(data.lam[0]), math.log10(np.pi)
    corners = 10.0 ** np.linspace(low, high, 2 + round(CORNERS_A_DECADE * (high - low)))[1:-1]
    level = slopes(at(corners), smaller, last.eta)[0]
    starts = []
    for share in NEW_PARTS:
        for rate, there in zip(corners.tolist(), level.tolist(), strict=True):
            variance = share * there * math.tanh(rate / 2)  # of a plateau σ² (1 + φ) / (1 - φ)
            starts.append(_with_part(smaller, last.eta, math.log(variance), math.log(rate)))
    return sorted(starts, key=lambda eta: likelihood(data, kind, eta))[:KEPT_STARTS]


def _with_part(smaller: Kind, eta: Array, variance: float, rate: float) -> Array:
    count = smaller.gauss_markov
    parts = (eta[: 1 + count], [variance], eta[1 + count : 1 + 2 * count], [rate], eta[1 + 2 * count :])
    return np.concatenate(parts)


def _of_sums(sums: Sequence[Fit], kind: Kind) -> list[Array]:
    """Return starts from the plain sum of as many parts, if all of them are Gauss–Markov."""
    count = kind.gauss_markov
    if not 1 <= count <= len(sums) or kind.walk or kind.quantised:
        return []
    found = sums[count - 1]
    p = sum_parameters(found.theta[:1], count)
    poles, shares, scale = p.poles[0], p.shares[0], float(found.scale[0])
    if (poles <= 0).any():
        return []
    rate = -np.log(poles)
    variance = shares * scale / -np.expm1(-2 * rate)
    return [
        np.concatenate([[math.log(max(float(p.white[0]), 1e-12) * scale)], np.log(variance), np.log(rate)])
    ]


def _extended(data: Lines, other: Kind, point: Point, kind: Kind) -> Iterable[Array]:
    """Return starts from a model without a random walk or without quantisation noise."""
    if other.gauss_markov != kind.gauss_markov:
        return
    walk, quantised = kind.walk - other.walk, kind.quantised - other.quantised
    if walk < 0 or quantised < 0 or walk + quantised != 1:
        return
    level = slopes(at(data.lam[[0, -1]]), other, point.eta)[0]
    if quantised:
        yield np.append(point.eta, math.log(0.1 * float(level[1])))
        return
    last = 1 + 2 * kind.gauss_markov
    yield np.insert(point.eta, last, math.log(0.3 * float(level[0]) * data.lam[0] ** 2))


def _has_such_corners(data: Lines, kind: Kind, point: Point) -> bool:
    """Return whether all corners are where the data are."""
    low, high = bounds(data, kind)
    corners = slice(1 + kind.gauss_markov, 1 + 2 * kind.gauss_markov)
    rates = point.eta[corners]
    return bool(((rates > low[corners] + AT_END) & (rates < high[corners] - AT_END)).all())


def _in_units(data: Lines, h: float, kind: Kind, point: Point, bic: dict[str, float]) -> Composite:
    count = kind.gauss_markov
    slowest = np.argsort(point.eta[1 + count : 1 + 2 * count])

    def estimate(i: int, factor: float, power: float) -> Estimate:
        return interval(data, kind, point, i).scaled(factor, power)

    parts = []
    for k in slowest.tolist():
        sigma, tau = estimate(1 + k, 1.0, 0.5), estimate(1 + count + k, h, -1.0)
        phi, variance = math.exp(-h / tau.value), sigma.value**2
        s2 = -variance * math.expm1(-2 * h / tau.value)
        parts.append(GaussMarkov(sigma, tau, 2 * variance / tau.value, phi, s2))
    K = of_walk(data, kind, point, 1 + 2 * count).scaled(h**-0.5, 0.5) if kind.walk else None
    return Composite(
        name=kind.name,
        N=estimate(0, math.sqrt(h), 0.5),
        gauss_markov=tuple(parts),
        K=K,
        Q=estimate(kind.parameters - 1, h, 0.5) if kind.quantised else None,
        bic=bic,
        h_s=h,
        from_hz=float(data.lam[0]) / (2 * math.pi * h),
    )
