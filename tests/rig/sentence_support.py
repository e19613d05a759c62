"""Sentences of noise by closed forms in numpy, without the native code, and samples of them."""

import math
import re
from collections.abc import Iterable, Sequence

import msgspec
import numpy as np
import pytest
from fltea.noise import parts as p
from fltea.records.arrays import Array
from fltea.spectrum.evidence import Evidence
from fltea.spectrum.periodogram import Binned
from fltea.spectrum.verdict import Verdict, winner
from hypothesis import strategies as st
from identify_support import H

AROUND = 4
"""The circle on which samples are drawn over the record."""


def order(alpha: float, share: float, Q: float) -> p.Order:
    return p.Order(alpha, -share * 2**alpha / H**alpha, Q)


positive, hz = st.floats(0.01, 100), st.floats(0.3, 45.0)
PARTS: dict[str, st.SearchStrategy[p.Part]] = {
    "relaxation": st.builds(p.Relaxation, positive, st.floats(0.002, 100)),
    "alternating": st.builds(p.Alternating, positive, st.floats(0.002, 10)),
    "walk": st.builds(p.Walk, positive),
    "order": st.builds(order, st.floats(0.05, 1.95), st.floats(0.001, 0.95), positive),
    "arfima": st.builds(p.Arfima, st.floats(0.05, 0.95), st.floats(0.0, 0.99), positive),
    "resonance": st.builds(p.Resonance, positive, hz, st.floats(0.1, 5)),
    "quantisation": st.builds(p.Quantisation, positive),
    "rise": st.builds(p.Rise, positive, st.floats(0.1, 2)),
    "floor": st.builds(p.Floor, positive),
    "low-pass": st.builds(p.LowPass, st.floats(1, 90), st.floats(1.01, 20)),
    "high-pass": st.builds(p.HighPass, st.floats(0.01, 9.9), st.floats(1.01, 8)),
    "sharpening": st.builds(p.Sharpening, st.floats(-0.24, 1)),
    "notch": st.builds(p.Notch, hz, st.floats(0.5, 10)),
    "mean": st.builds(p.Mean, st.integers(2, 10)),
}
"""Any of each kind, at 100 Hz."""


def closed_form(parts: Iterable[p.Part], lam: Array, h: float) -> Array:
    """The spectrum at λ in rad a sample."""
    total, gain, floor = np.zeros_like(lam), np.ones_like(lam), 0.0
    for part in parts:
        if isinstance(part, p.FILTERS):
            gain = gain * _gain(part, lam, h)
        elif isinstance(part, p.Floor):
            floor += part.R
        else:
            total = total + _density(part, lam, h)
    return np.asarray(gain * total + floor)


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
            raise AssertionError(part)
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
            raise AssertionError(part)
    return np.asarray(found)


def samples(parts: Sequence[p.Part], n: int, h: float, seed: int) -> Array:
    """Gaussian samples (n,) with the spectrum of the parts, cut out of a circle."""
    rng, circle = np.random.default_rng((28, seed)), AROUND * n
    lam = 2 * np.pi * np.arange(1, circle // 2 + 1) / circle
    waves = np.zeros(circle // 2 + 1, dtype=np.complex128)
    waves[1:] = rng.standard_normal(circle // 2) + 1j * rng.standard_normal(circle // 2)
    waves[1:] *= np.sqrt(closed_form(parts, lam, h) * circle / 2)
    y = np.fft.irfft(waves, circle)[:n]
    is_high_passed = any(isinstance(part, p.HighPass) for part in parts)
    walks = [part.K for part in parts if isinstance(part, p.Walk) and not is_high_passed]
    # The mean of a walk's steps is the one wave that a circle does not have.
    return np.asarray(
        y + sum(K * math.sqrt(h / circle) * rng.standard_normal() for K in walks) * np.arange(n)
    )


def bins(parts: Sequence[p.Part], n: int, h: float, seed: int | None, size: int = 130) -> Binned:
    """Bins of a periodogram as theory has it, of n samples; seed None: the spectrum itself."""
    edges = np.geomspace(25 / n, np.pi, size + 1)
    lam = (edges[1:] + edges[:-1]) / 2
    counts = np.maximum(1.0, np.diff(edges) * n / (2 * np.pi))
    power = closed_form(parts, lam, h)
    if seed is not None:
        power = power * np.random.default_rng((29, seed)).gamma(counts) / counts
    return Binned(lam, counts, power[np.newaxis])


def sound(e: Evidence, verdict: Verdict) -> None:
    """Text, figures and winner are of one result, and no bound is printed as an estimate."""
    assert verdict.text == f"{verdict.what} {verdict.why} {verdict.next}"
    for sentence in (verdict.what, verdict.why, verdict.next):
        assert sentence[0].isupper() or sentence[0].isdigit()
        assert sentence.endswith(".")
        assert "  " not in sentence
    assert "0.00 Hz" not in verdict.text
    msgspec.json.encode(verdict)
    order = verdict.order
    orders = [float(one) for one in re.findall(r"of the order (\d\.\d+)", verdict.text)]
    if order.alpha.value is None:
        assert order.f.value is None
    elif orders:
        assert orders == [pytest.approx(order.alpha.value, abs=0.0051)]
    if not verdict.has_order:
        assert order == type(order)()
        assert not orders
    has_order = any(isinstance(part, p.Order | p.Arfima) for part in winner(e, verdict).parts(e.frontier.h))
    assert has_order == (verdict.has_order and (verdict.kind == "fractional" or e.frontier.lead > 0))
    for interval in (order.alpha, order.f, order.F, order.s2, order.R):
        low, value, high = interval.low, interval.value, interval.high
        assert low is None or high is None or value is None or low <= value <= high
