"""How far the Allan variance of one record spreads about that of its noise, by the noise's spectrum (pure).

The variance of an average of squares follows from their covariance r(k): over M differences of neighbouring
means

    Var σ²(m) = 2 / M Σ (1 - |k| / M) r(k)²,    r(k) = 1/π ∫ S(λ) 2 sin⁴(m λ / 2) / (m² sin²(λ / 2)) cos kλ dλ

(C. A. Greenhall and W. J. Riley, PTTI 2003, equations 7 and 8, there for powers of the frequency). A figure
that is chi-squared with ν degrees of freedom has the variance 2 σ⁴ / ν.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from fltea.records.arrays import Array

Spectrum = Callable[[Array], Array]

POINTS = 16
"""Lags at which the covariance is taken, in an averaging time."""
MOST = 1 << 13
"""Slow frequencies of one averaging time, twice."""
FAST = 1 << 11
"""Fast ones."""


class Line(NamedTuple):
    """A narrow line: a cosine whose amplitude and phase wander."""

    lam: float
    """Frequency in rad a sample, between 0 and π."""
    decay: float
    """Rate at which it forgets its phase, a sample: half its width at half its height in rad a sample."""
    variance: float

    def share(self, m: float) -> float:
        """Return what it has in the Allan variance of m samples."""
        once = np.exp(-self.decay * m)
        sine4 = 3 / 8 - once * np.cos(m * self.lam) / 2 + once**2 * np.cos(2 * m * self.lam) / 8
        return float(self.variance * 2 * sine4 / (m * np.sin(self.lam / 2)) ** 2)

    def coherence(self, terms: float) -> float:
        """Return the sum of its squared correlations over so many terms, of which the first is 1."""
        a = 2 * self.decay
        total = terms / 2 if a * terms < 1e-6 else (1 - -np.expm1(-a * terms) / (a * terms)) / a
        return float(max(total, 1.0))


def allan_degrees(
    spectrum: Spectrum, factors: ArrayLike, variances: ArrayLike, terms: ArrayLike, lines: Sequence[Line] = ()
) -> Array:
    """Return the degrees of freedom of overlapping Allan variances, (k,), 1 or more.

    spectrum: gives S of all but the lines at frequencies 0 < λ < π, (n,) to (n,). factors: samples that are
    averaged, whole numbers. variances: of the whole noise there, as of `model_adev`. terms: differences of
    neighbouring means that a record has.
    """
    grids = _Grids(spectrum)
    found = []
    numbers = (np.asarray(one).tolist() for one in (factors, variances, terms))
    for m, variance, count in zip(*numbers, strict=True):
        squares = _slow_squares(grids, m, count) + _fast_squares(grids, m, count)
        for line in lines:
            share, at = line.share(m), np.array([line.lam])
            squares += share**2 * line.coherence(count)
            squares += 2 * share * float((spectrum(at) * _weights(at, m))[0])
        found.append(count * variance**2 / squares if squares > 0 else count)
    return np.maximum(found, 1.0)


class _Grids:
    """The spectrum in the middles of cells, which many averaging times have in common."""

    def __init__(self, spectrum: Spectrum) -> None:
        self._spectrum = spectrum
        self._known: dict[tuple[float, float, int], tuple[Array, Array]] = {}

    def of(self, low: float, high: float, cells: int) -> tuple[Array, Array]:
        """Return λ from low to high, and S there."""
        key = low, high, cells
        if key not in self._known:
            lam: Array = low + (np.arange(cells, dtype=np.float64) + 0.5) * ((high - low) / cells)
            self._known[key] = lam, self._spectrum(lam)
        return self._known[key]


def _weights(lam: Array, m: float) -> Array:
    return np.asarray(2 * np.sin(m * lam / 2) ** 4 / (m * np.sin(lam / 2)) ** 2)


def _step(m: float) -> int:
    return max(1, int(m) // POINTS)


def _slow_squares(grids: _Grids, m: float, terms: float) -> float:
    """Return Σ (1 - |k| / M) r(k)² of what is slower than the lags at which r is taken."""
    step = _step(m)
    points = min(MOST, 1 << int(np.ceil(np.log2(2 * (terms + 2 * m) / step))))
    lam, S = grids.of(0.0, np.pi / step, points // 2)
    power = S * _weights(lam, m) * (2 / (points * step))
    lags = np.arange(points // 2)
    # Frequencies are the middles of cells.
    r = (np.exp(-1j * np.pi * lags / points) * np.fft.fft(power, points)[: points // 2]).real
    weights = np.maximum(1 - lags * (step / terms), 0.0)
    weights[1:] *= 2
    return float(step * (weights @ r**2))


def _fast_squares(grids: _Grids, m: float, terms: float) -> float:
    """Return the same of what is faster: its covariance is short, at lags 0, m and 2 m."""
    step = _step(m)
    if step == 1:
        return 0.0
    low = np.pi / step
    lam, S = grids.of(low, np.pi, FAST)
    squares = 35 / 128 * (S * 2 / (m * np.sin(lam / 2)) ** 2) ** 2  # the mean of sin⁸
    ends = (36 + 32 * max(1 - m / terms, 0) + 2 * max(1 - 2 * m / terms, 0)) / 70
    return float(squares.mean() * (np.pi - low) / np.pi * ends)
