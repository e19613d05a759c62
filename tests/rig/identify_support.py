"""Noises with known answers, made without the code under test."""

import numpy as np
from fltea.lab.reproduce.simulate import fractional_states
from fltea.records.arrays import Array
from fltea.spectrum.periodogram import Periodogram

H = 0.01


def recursion(alpha: float, f: float, n: int, series: int, seed: int, warmup: int = 2000) -> Array:
    """States of the fractional recursion with unit innovations, (series, n), after a warm-up."""
    drive = np.random.default_rng(seed).standard_normal((n + warmup, series)) / H**alpha
    return fractional_states(np.full(n + warmup, alpha), f, drive, H)[warmup:].T


def long_recursion(alpha: float, g: float, n: int, seed: int) -> Array:
    """The same, (n,), of its transfer function on a circle four times as long: fast for long series."""
    lam = 2 * np.pi * np.arange(1, 2 * n + 1) / (4 * n)
    z = np.exp(-1j * lam)
    transfer = np.concatenate([[0], 1 / ((1 - z) ** alpha - g * z)])
    noise = np.fft.rfft(np.random.default_rng(seed).standard_normal(4 * n))
    return np.asarray(np.fft.irfft(noise * transfer, 4 * n)[:n])


def ar(phi: tuple[float, ...], n: int, series: int, seed: int, warmup: int = 1000) -> Array:
    """AR process with unit innovations, (series, n)."""
    noise = np.random.default_rng(seed).standard_normal((n + warmup, series))
    x = np.zeros((n + warmup + len(phi), series))
    for k in range(n + warmup):
        now = k + len(phi)
        x[now] = noise[k] + sum(p * x[now - 1 - i] for i, p in enumerate(phi))
    return x[-n:].T


def white(n: int, series: int, seed: int) -> Array:
    return np.random.default_rng(seed).standard_normal((series, n))


def drawn(spectrum: Array, lam: Array, n: int, seed: int, series: int = 1) -> Periodogram:
    """A periodogram as theory has it: independent exponentials with the spectrum for their means."""
    power = np.random.default_rng(seed).exponential(size=(series, len(lam))) * spectrum
    return Periodogram(lam, power[0] if series == 1 else power, H, n)
