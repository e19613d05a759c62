"""Compute how much the Allan variance of a single record scatters, from the spectrum of its noise.

An Allan variance is an average of squares, so its variance follows from the covariance r(k) of the terms that
are squared. These terms are the M differences of neighbouring means of m samples:

    Var σ²(m) = 2 / M Σ (1 - |k| / M) r(k)²,    r(k) = 1/π ∫ S(λ) 2 sin⁴(m λ / 2) / (m² sin²(λ / 2)) cos kλ dλ

(C. A. Greenhall and W. J. Riley, PTTI 2003, equations 7 and 8, which are for spectra that are powers of the
frequency). A variable that is chi-squared with ν degrees of freedom, scaled to the mean σ², has the variance
2 σ⁴ / ν. Equating both variances gives the degrees of freedom of the Allan variance.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from fltea.noise.allan_deviation import allan_integrals
from fltea.records.arrays import Array

Spectrum = Callable[[Array], Array]

POINTS = 16
"""Number of lags k within one averaging time at which the covariance r(k) is computed."""
MOST = 1 << 13
"""Largest number of lags for one averaging time. It is twice the number of frequencies at which the spectrum
is computed for these lags.
"""
FAST = 1 << 11
"""Lags that are `step` samples apart represent noise up to the frequency π / step. What noise above π / step
contributes is computed from its spectrum at this number of frequencies.
"""
RUNG_OUT = 8.0
"""Lag after which the covariance of a spectral line counts as 0, in units of 1 / half-width. This unit is the
time for which the line's phase is remembered.
"""


class Line(NamedTuple):
    """A narrow spectral line: a cosine whose amplitude and phase wander."""

    lam: float
    """Frequency in rad per sample, between 0 and π."""
    half: float
    """Half the width of the line at half its height, in rad per sample. It is the rate at which the
    covariance decays.
    """
    variance: float

    def at(self, lam: Array) -> Array:
        """Return the power spectrum of this spectral line at λ, (n,)."""
        return np.asarray(self._height / (1 + ((lam - self.lam) / self.half) ** 2))

    def mean(self, edges: Array) -> Array:
        """Return the mean of this line's spectrum in each interval between neighbouring edges, (n,).

        `edges`: rising frequencies, (n + 1,).
        """
        angles = np.arctan((edges - self.lam) / self.half)
        return np.asarray(self._height * self.half * np.diff(angles) / np.diff(edges))

    @property
    def _height(self) -> float:
        low, high = math.atan(-self.lam / self.half), math.atan((math.pi - self.lam) / self.half)
        return self.variance * math.pi / (self.half * (high - low))

    def seen(self, terms: float) -> float:
        """Return Σ (1 - |k| / M) r(k)², divided by Σ r(k)² over all lags k.

        M (`terms`) is the number of differences in the record, and r the line's covariance; the module
        explains both. The result is small if the line's phase is remembered for longer than the record.
        """
        ringing = 2 * self.half * terms
        return 1 + math.expm1(-ringing) / ringing


def allan_degrees(
    spectrum: Spectrum, factors: ArrayLike, variances: ArrayLike, terms: ArrayLike, lines: Sequence[Line] = ()
) -> Array:
    """Return the degrees of freedom of overlapping Allan variances, (k,). They are 1 or more.

    Args:
        spectrum: a function that returns the spectrum (n,) of all noise except `lines`, at frequencies 0 < λ
            < π, (n,).
        factors: averaging times in samples, (k,), whole numbers.
        variances: Allan variances of the whole noise at these averaging times, the squares of `model_adev`.
        terms: numbers of differences of neighbouring means that the record has, (k,).
        lines: narrow spectral lines of the noise.
    """
    grids = _Grids(spectrum)
    m, variance, count = (np.asarray(one, dtype=np.float64) for one in (factors, variances, terms))
    around = [(line.lam, line.half) for line in lines]
    apart = [_of_line(line, spectrum, m, around) for line in lines]
    squares = np.empty(len(m))
    for i, (factor, number) in enumerate(zip(m.tolist(), count.tolist(), strict=True)):
        shape = _Shape.of(factor, number)
        slow = [line for line in lines if shape.resolves(line)]
        squares[i] = _slow_squares(grids, shape, slow) + _fast_squares(grids, shape)
        for line, (own, both) in zip(lines, apart, strict=True):
            if line not in slow:
                squares[i] += line.seen(number) * own[i] + both[i]
    found = count * variance**2 / np.maximum(squares, np.finfo(np.float64).tiny)
    return np.asarray(np.clip(found, 1.0, None))


def _of_line(
    line: Line, spectrum: Spectrum, factors: Array, around: Sequence[tuple[float, float]]
) -> tuple[Array, Array]:
    """Return Σ r² and Σ 2 r q over all lags, where r is the covariance of a line, and q that of other noise.

    Both have one value for each averaging time in `factors`, (k,).
    """
    own = allan_integrals(lambda lam: line.at(lam) ** 2, factors, 2, around)
    return own, allan_integrals(lambda lam: 2 * line.at(lam) * spectrum(lam), factors, 2, around)


class _Shape(NamedTuple):
    """Grid of lags for computing the covariance r at one averaging time of `m` samples."""

    m: float
    terms: float
    step: int
    """Number of samples from one lag to the next."""
    points: int
    """Number of lags in the FFT that computes the covariance. Its result repeats after so many lags."""

    @classmethod
    def of(cls, m: float, terms: float) -> "_Shape":
        step = max(1, int(m) // POINTS)
        return cls(m, terms, step, min(MOST, 1 << math.ceil(math.log2(2 * (terms + 2 * m) / step))))

    def resolves(self, line: Line) -> bool:
        """Whether the covariance at these lags represents a spectral line.

        There are two conditions. The line's frequency has to be below π / step, as for any sampling. And the
        computed covariance, which repeats itself after the last lag, must not overlap with its repetition:
        either the line's covariance has decayed by then, or the lags span twice the record.
        """
        around = self.points * self.step
        is_short = around >= 2 * (self.terms + 2 * self.m) or line.half * around >= RUNG_OUT
        return line.lam < math.pi / self.step and is_short


class _Grids:
    """Spectra at the midpoints of frequency intervals ("cells").

    The spectra are kept, since they are used at many averaging times.
    """

    def __init__(self, spectrum: Spectrum) -> None:
        self._spectrum = spectrum
        self._known: dict[tuple[float, float, int], tuple[Array, Array]] = {}

    def of(self, low: float, high: float, cells: int) -> tuple[Array, Array]:
        """Return the midpoints λ of `cells` equal intervals from `low` to `high`, and the spectrum there."""
        key = low, high, cells
        if key not in self._known:
            lam: Array = low + (np.arange(cells, dtype=np.float64) + 0.5) * ((high - low) / cells)
            self._known[key] = lam, self._spectrum(lam)
        return self._known[key]


def _weights(lam: Array, m: float) -> Array:
    return np.asarray(2 * np.sin(m * lam / 2) ** 4 / (m * np.sin(lam / 2)) ** 2)


def _slow_squares(grids: _Grids, shape: _Shape, lines: Sequence[Line]) -> float:
    """Return Σ (1 - |k| / M) r(k)² for the noise below the frequency π / step.

    Lags k that are `step` samples apart represent this noise. r(k) is the covariance, at lag k, of the
    differences of neighbouring means; M is the number of differences.
    """
    m, terms, step, points = shape
    lam, S = grids.of(0.0, np.pi / step, points // 2)
    if lines:
        edges = np.linspace(0.0, np.pi / step, points // 2 + 1)
        S = S + sum(line.mean(edges) for line in lines)
    power = S * _weights(lam, m) * (2 / (points * step))
    lags = np.arange(points // 2)
    # An FFT assumes frequencies that are multiples of a cell's width. Those here are the cells' midpoints.
    # The exponential corrects the result for the difference of half a cell.
    r = (np.exp(-1j * np.pi * lags / points) * np.fft.fft(power, points)[: points // 2]).real
    weights = np.maximum(1 - lags * (step / terms), 0.0)
    weights[1:] *= 2
    return float(step * (weights @ r**2))


def _fast_squares(grids: _Grids, shape: _Shape) -> float:
    """Return the sum Σ (1 - |k| / M) r(k)² for the noise above the frequency π / step.

    Lags k that are `step` samples apart are too coarse for this noise. r(k) is the covariance, at lag k, of
    the differences of neighbouring means; M is the number of differences. The covariance of fast noise is
    confined to lags near 0, m and 2 m.
    """
    m, terms, step, _ = shape
    if step == 1:
        return 0.0
    low = np.pi / step
    lam, S = grids.of(low, np.pi, FAST)
    squares = 35 / 128 * (S * 2 / (m * np.sin(lam / 2)) ** 2) ** 2  # 35/128 is the mean of sin⁸
    ends = (36 + 32 * max(1 - m / terms, 0) + 2 * max(1 - 2 * m / terms, 0)) / 70
    return float(squares.mean() * (np.pi - low) / np.pi * ends)
