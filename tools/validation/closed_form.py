"""Spectra and samples of noises by closed formulas in numpy, which share no code with the native fits.

Each noise is a sum of parts, such as white noise, a random walk or a resonance.
"""

import math
from collections.abc import Iterable, Sequence

import numpy as np
from fltea.noise import parts as p
from fltea.records.arrays import Array

AROUND = 4
"""Length of the periodic noise from which a record is cut, divided by the length of the record."""


def closed_form(parts: Iterable[p.Part], lam: Array, h: float) -> Array:
    """Return the spectrum of the sum of the parts, as an array (len(lam),).

    `lam`: frequencies [rad a sample]. `h`: sampling period [s].
    """
    total, gain, floor = np.zeros_like(lam), np.ones_like(lam), 0.0
    for part in parts:
        if isinstance(part, p.FILTERS):
            gain = gain * _gain(part, lam, h)
        elif isinstance(part, p.Floor):
            floor += part.R
        else:
            total = total + _density(part, lam, h)
    return np.asarray(gain * total + floor)


def samples(parts: Sequence[p.Part], n: int, h: float, rng: np.random.Generator) -> Array:
    """Draw n Gaussian samples with the spectrum of the parts.

    They are cut out of a longer periodic noise (a circle).
    """
    circle = AROUND * n
    lam = 2 * np.pi * np.arange(1, circle // 2 + 1) / circle
    waves = np.zeros(circle // 2 + 1, dtype=np.complex128)
    waves[1:] = rng.standard_normal(circle // 2) + 1j * rng.standard_normal(circle // 2)
    waves[1:] *= np.sqrt(closed_form(parts, lam, h) * circle / 2)
    y = np.fft.irfft(waves, circle)[:n]
    is_high_passed = any(isinstance(part, p.HighPass) for part in parts)
    walks = [part.K for part in parts if isinstance(part, p.Walk) and not is_high_passed]
    # In periodic noise a random walk ends where it began, so its steps have the mean 0. True steps have a
    # random mean. It is drawn here, and added as a ramp.
    return np.asarray(
        y + sum(K * math.sqrt(h / circle) * rng.standard_normal() for K in walks) * np.arange(n)
    )


def _density(part: p.Part, lam: Array, h: float) -> Array:
    z = np.exp(-1j * lam)
    match part:
        case p.White(R):
            found = np.full_like(lam, R)
        case p.Relaxation(sigma, tau_s) | p.Alternating(sigma, tau_s):
            phi = math.exp(-h / tau_s)
            pole = phi if isinstance(part, p.Relaxation) else -phi
            found = sigma**2 * (1 - phi**2) / np.abs(1 - pole * z) ** 2
        case p.Walk(K):
            found = K**2 * h / np.abs(1 - z) ** 2
        case p.Order(alpha, f, Q):
            found = h ** (2 * alpha) * Q / np.abs((1 - z) ** alpha - h**alpha * f * z) ** 2
        case p.Arfima(d, phi, s2):
            found = s2 * np.abs(1 - z) ** (-2 * d) / np.abs(1 - phi * z) ** 2
        case p.Resonance(height, frequency_hz, width_hz):
            theta, r = 2 * math.pi * frequency_hz * h, math.exp(-math.pi * width_hz * h)

            def poles(z: Array) -> Array:
                both = (1 - r * np.exp(1j * theta) * z) * (1 - r * np.exp(-1j * theta) * z)
                return np.asarray(np.abs(both) ** 2)

            found = height * poles(np.exp(-1j * np.array([theta]))) / poles(z)
        case p.Quantisation(Q):
            found = (Q / h) ** 2 * np.abs(1 - z) ** 2
        case p.Rise(power, delta):
            found = power * (np.abs(1 - z) / 2) ** (2 * delta)
        case _:
            raise AssertionError(f"tools/validation/closed_form.py has no spectrum of {part}")
    return np.asarray(found)


def _gain(part: p.Part, lam: Array, h: float) -> Array:
    match part:
        case p.LowPass(corner_hz, poles):
            turns = (lam, 2 * np.pi - lam, 2 * np.pi + lam)
            corner = 2 * math.pi * corner_hz * h
            found = sum(1 / (1 + np.minimum(one / corner, 1e3) ** (2 * poles)) for one in turns)
        case p.HighPass(corner_hz, poles):
            ratio = math.sin(math.pi * corner_hz * h) / np.sin(lam / 2)
            found = 1 / (1 + np.minimum(ratio, 1e12) ** (2 * poles))
        case p.Sharpening(s):
            found = (1 + 2 * s - 2 * s * np.cos(lam)) ** 2
        case p.Notch(frequency_hz, width_hz):
            t, t0 = np.tan(lam / 2), math.tan(math.pi * frequency_hz * h)
            stopped = (t**2 - t0**2) ** 2
            found = stopped / (stopped + (t0 * width_hz / frequency_hz * t) ** 2)
        case p.Mean(samples):
            found = (np.sin(samples * lam / 2) / (samples * np.sin(lam / 2))) ** 2
        case _:
            raise AssertionError(f"tools/validation/closed_form.py has no spectrum of {part}")
    return np.asarray(found)
