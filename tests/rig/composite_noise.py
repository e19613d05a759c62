"""Composite noises from recursions in time, without any of the code that fits them."""

from typing import NamedTuple

import numpy as np
from fltea.records.arrays import Array
from scipy.signal import lfilter


class Truth(NamedTuple):
    """N, K and Q as filters have them, and (σ, τ) of each Gauss–Markov part, the slowest first."""

    N: float
    gauss_markov: tuple[tuple[float, float], ...] = ()
    K: float = 0.0
    Q: float = 0.0


def noise(truth: Truth, n: int, h: float, seed: int) -> Array:
    """One series (n,)."""
    rng = np.random.default_rng((77, seed))
    y = rng.standard_normal(n) * truth.N / np.sqrt(h)
    for sigma, tau in truth.gauss_markov:
        y = y + gauss_markov(rng, n, h, sigma, tau)
    y = y + np.cumsum(rng.standard_normal(n)) * truth.K * np.sqrt(h)
    return np.asarray(y + np.diff(rng.standard_normal(n + 1)) * truth.Q / h)


def gauss_markov(rng: np.random.Generator, n: int, h: float, sigma: float, tau: float) -> Array:
    """One part, stationary from the start."""
    phi, before = np.exp(-h / tau), int(20 * tau / h)
    drive = rng.standard_normal(n + before) * sigma * np.sqrt(1 - phi * phi)
    return np.asarray(lfilter([1], [1, -phi], drive)[before:])
