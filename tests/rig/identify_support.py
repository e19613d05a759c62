"""Noises with known answers, generated without the code under test."""

from typing import NamedTuple

import numpy as np
from fltea.lab.reproduce.simulate import fractional_states
from fltea.records.arrays import Array
from fltea.spectrum.periodogram import Periodogram
from scipy.signal import lfilter

H = 0.01


def recursion(alpha: float, f: float, n: int, series: int, seed: int, warmup: int = 2000) -> Array:
    """Return states of the paper's recursion D^α x = f x + ω, driven by white noise of variance 1, of shape
    (series, n). The first `warmup` states are dropped.
    """
    drive = np.random.default_rng(seed).standard_normal((n + warmup, series)) / H**alpha
    return fractional_states(np.full(n + warmup, alpha), f, drive, H)[warmup:].T


def long_recursion(alpha: float, g: float, n: int, seed: int) -> Array:
    """Return n states of the process that `recursion` computes step by step, here computed by FFT.

    The series is a section of a periodic series four times as long. For many samples the FFT is faster.
    """
    lam = 2 * np.pi * np.arange(1, 2 * n + 1) / (4 * n)
    z = np.exp(-1j * lam)
    transfer = np.concatenate([[0], 1 / ((1 - z) ** alpha - g * z)])
    noise = np.fft.rfft(np.random.default_rng(seed).standard_normal(4 * n))
    return np.asarray(np.fft.irfft(noise * transfer, 4 * n)[:n])


def ar(phi: tuple[float, ...], n: int, series: int, seed: int, warmup: int = 1000) -> Array:
    """Return samples of an autoregressive process, of shape (series, n).

    White noise of variance 1 drives the process.
    """
    noise = np.random.default_rng(seed).standard_normal((n + warmup, series))
    x = np.zeros((n + warmup + len(phi), series))
    for k in range(n + warmup):
        now = k + len(phi)
        x[now] = noise[k] + sum(p * x[now - 1 - i] for i, p in enumerate(phi))
    return x[-n:].T


def white(n: int, series: int, seed: int) -> Array:
    return np.random.default_rng(seed).standard_normal((series, n))


def drawn(spectrum: Array, lam: Array, n: int, seed: int, series: int = 1) -> Periodogram:
    """Draw a periodogram: independent exponentially distributed values whose means are the spectrum."""
    power = np.random.default_rng(seed).exponential(size=(series, len(lam))) * spectrum
    return Periodogram(lam, power[0] if series == 1 else power, H, n)


class Truth(NamedTuple):
    """True figures of a noise: N, K and Q (quantisation noise) in the units of navigation filters, and
    standard deviation and correlation time (σ, τ) of Gauss–Markov parts.

    The Gauss–Markov part with the longest τ comes first.
    """

    N: float
    gauss_markov: tuple[tuple[float, float], ...] = ()
    K: float = 0.0
    Q: float = 0.0


def composite(truth: Truth, n: int, h: float, seed: int) -> Array:
    """Return n samples of the noise with these true figures: a sum of components, each drawn at random."""
    rng = np.random.default_rng((77, seed))
    y = rng.standard_normal(n) * truth.N / np.sqrt(h)
    for sigma, tau in truth.gauss_markov:
        y = y + gauss_markov(rng, n, h, sigma, tau)
    y = y + np.cumsum(rng.standard_normal(n)) * truth.K * np.sqrt(h)
    return np.asarray(y + np.diff(rng.standard_normal(n + 1)) * truth.Q / h)


def gauss_markov(rng: np.random.Generator, n: int, h: float, sigma: float, tau: float) -> Array:
    """Return n samples of a Gauss–Markov process that is stationary from the start."""
    phi, before = np.exp(-h / tau), int(20 * tau / h)
    drive = rng.standard_normal(n + before) * sigma * np.sqrt(1 - phi * phi)
    return np.asarray(lfilter([1], [1, -phi], drive)[before:])
