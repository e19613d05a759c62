"""Composite spectra in logarithms of physical parameters: slopes, and Fisher scoring (pure).

White noise, Gauss–Markov parts, a random walk and quantisation noise. The native families have shares of a
scale for coordinates, which end at 1e-7; a random walk of 4e-8 of the white noise shows in three hours at
100 Hz. Logarithms have no such end, and intervals are wanted of these parameters and no others.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fltea.spectrum.octaves import JOIN, WHOLE
from fltea.spectrum.periodogram import Binned

Array = NDArray[np.float64]

STEPS = 60
CONVERGED = 1e-7
"""The gain of -log L in a step at which the search has converged."""
SMALLEST = -30.0
"""Logarithm of the smallest part over the mean power."""
LARGEST = 30.0
LEAK_OF_CUBIC = 1 / 9
"""The leak of a random walk without its cubic: the mean square of the step from the last sample to the first
over what the walk does in a record: so much more power it has at all frequencies of the
whole. Of a short record the cubic is taken out only where the walk is large; where it is not the whole step
leaks, but is lost in other noise."""


class Lines(NamedTuple):
    """What is fitted, and what a walk and quantisation noise of unit variance have there; (bins,) each."""

    lam: Array
    counts: Array
    power: Array
    walk: Array
    rising: Array
    leaks: NDArray[np.bool_]
    """Bins of the lowest octave."""


class Kind(NamedTuple):
    """Which parts a model has besides white noise."""

    gauss_markov: int
    walk: bool
    quantised: bool

    @property
    def parameters(self) -> int:
        """The number of parameters, as BIC counts them."""
        return 1 + 2 * self.gauss_markov + self.walk + self.quantised

    @property
    def name(self) -> str:
        """The name of the model in words."""
        parts = ["white"]
        if self.gauss_markov:
            parts.append(f"{self.gauss_markov} Gauss–Markov")
        return " + ".join(parts + ["random walk"] * self.walk + ["quantisation"] * self.quantised)


class Point(NamedTuple):
    """Logarithms of the parameters of one spectrum, and -log L there."""

    eta: Array
    """Log R; log σ² of each Gauss–Markov part; log h/τ of each; log s2 of the walk; log of the variance of
    the noise whose differences are quantisation noise."""
    nll: float


def lines(data: Binned, samples: int) -> Lines:
    """Return the lines of the one series of `data`, of a record of so many samples."""
    level = max(0, math.ceil(math.log2(samples / WHOLE)))
    leaks = data.lam < JOIN / 2**level if level else np.ones(len(data.lam), dtype=np.bool_)
    rising = 4 * np.sin(data.lam / 2) ** 2
    walk = (1 + np.where(leaks, LEAK_OF_CUBIC, 0.0)) / rising
    return Lines(data.lam, data.counts, data.power[0], walk, rising, np.asarray(leaks))


def at(lam: Array) -> Lines:
    """Return frequencies at which a spectrum is wanted, without what leaks."""
    rising = 4 * np.sin(lam / 2) ** 2
    none = np.zeros_like(lam)
    return Lines(lam, none, none, 1 / rising, rising, np.zeros(len(lam), dtype=np.bool_))


def slopes(data: Lines, kind: Kind, eta: Array) -> tuple[Array, Array]:
    """Return the spectrum (bins,) and its slopes by eta (p, bins)."""
    count = kind.gauss_markov
    half = data.rising
    parts = np.empty((len(eta), len(half)))
    parts[0] = np.exp(eta[0])
    rate = np.exp(eta[1 + count : 1 + 2 * count])[:, np.newaxis]
    phi, left = np.exp(-rate), -np.expm1(-rate)
    gap = -np.expm1(-2 * rate)  # 1 - φ²
    distance = left**2 + phi * half
    gauss_markov = np.exp(eta[1 : 1 + count])[:, np.newaxis] * gap / distance
    parts[1 : 1 + count] = gauss_markov
    last = 1 + 2 * count
    if kind.walk:
        parts[last] = np.exp(eta[last]) * data.walk
    if kind.quantised:
        parts[-1] = np.exp(eta[-1]) * half
    spectrum = parts[0] + gauss_markov.sum(axis=0) + parts[last:].sum(axis=0)
    parts[1 + count : last] = gauss_markov * rate * phi * (2 * phi / gap + (half - 2 * left) / distance)
    return spectrum, parts


def likelihood(data: Lines, kind: Kind, eta: Array) -> float:
    """Return -log L of the one series of `data`."""
    spectrum, _ = slopes(data, kind, eta)
    return float((np.log(spectrum) + data.power / spectrum) @ data.counts)


def bounds(data: Lines, kind: Kind, slowest: float = 1.0) -> tuple[Array, Array]:
    """Return the lowest and highest eta: corners are where the data are, or so many times slower."""
    power = np.log(np.average(data.power, weights=data.counts))
    low = np.full(kind.parameters, power + SMALLEST)
    high = np.full(kind.parameters, power + LARGEST)
    corners = slice(1 + kind.gauss_markov, 1 + 2 * kind.gauss_markov)
    low[corners], high[corners] = np.log(data.lam[0] / slowest), np.log(np.pi)
    return low, high


def score(
    data: Lines, kind: Kind, start: Array, held: int | None = None, ends: tuple[Array, Array] | None = None
) -> Point:
    """Return the best point that is reached from `start`, by Fisher scoring with Levenberg's damping.

    held: the parameter that keeps its value. ends: lowest and highest eta; None: those of `bounds`.
    """
    low, high = bounds(data, kind) if ends is None else ends
    eta = np.clip(start, low, high)
    if held is not None:
        eta[held] = start[held]
    damping = 1e-3
    spectrum, parts = slopes(data, kind, eta)
    nll = float((np.log(spectrum) + data.power / spectrum) @ data.counts)
    for _ in range(STEPS):
        relative = parts / spectrum
        gradient = relative @ ((1 - data.power / spectrum) * data.counts)
        free = ~(((eta <= low) & (gradient > 0)) | ((eta >= high) & (gradient < 0)))
        if held is not None:
            free[held] = False
        if not free.any():
            break
        some = relative[free]
        information = (some * data.counts) @ some.T
        better = False
        while damping < 1e9:
            diagonal = damping * np.diag(information) + 1e-9
            step = np.linalg.solve(information + np.diag(diagonal), gradient[free])
            # A step of a factor of e³ is as far as slopes are to be trusted.
            step *= min(1.0, 3.0 / np.abs(step).max(initial=1e-300))
            trial = eta.copy()
            trial[free] -= step
            trial = np.where(free, np.clip(trial, low, high), eta)
            spectrum_there, parts_there = slopes(data, kind, trial)
            there = float((np.log(spectrum_there) + data.power / spectrum_there) @ data.counts)
            if there <= nll:
                better = True
                break
            damping *= 8
        if not better:
            break
        gained, nll = nll - there, there
        eta, spectrum, parts = trial, spectrum_there, parts_there
        damping = max(damping / 6, 1e-9)
        if gained < CONVERGED:
            break
    return Point(eta, nll)
