"""Parts of a noise as poles that one white noise drives (pure).

A part or a chain of filters has poles of its own, or real ones that stand for it: two a decade for an order.
What each contributes is found by least squares, from magnitude and phase of the part's response.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fltea.noise.parts import (
    Alternating,
    Arfima,
    HighPass,
    LowPass,
    Mean,
    Notch,
    Order,
    Part,
    Quantisation,
    Relaxation,
    Resonance,
    Rise,
    Walk,
)
from fltea.noise.spectra import g_of, step_variance
from fltea.records.arrays import Array, Complex

LINES = math.pi * np.arange(1, 4097) / 4096
"""λ of a spectrum from which a response is found."""
A_DECADE = 2
"""Poles that stand for an order."""
FASTEST = 3.0
"""Rate of a pole, in 1 a sample."""
MOST_POLES = 6
"""Of a low-pass; more of them look the same below its corner."""
MOST_TAPS = 10
"""Of a short filter."""
SMALL = 0.005
"""What is wrong with a short filter, which needs no poles, because it has some: their size is its root."""
FAST = 0.3
"""Weight of frequencies above 1 rad a sample, where less depends on the fit."""
DISTINCT = 0.05
"""Of two poles, over the distance of one from the circle: nearer ones would only cancel each other."""
LEAST_SINGULAR, CANCELLING = (1e-8, 1e-6, 1e-4, 1e-2), 1e4
"""Singular values that count, over the largest; and the power of all coordinates over that of their sum
beyond which they cancel each other, which no filter's numbers survive."""
DEEPEST = 1e-7
"""Of a spectrum, over its mean: the logarithm of a filter's zero."""


class Block(NamedTuple):
    """Coordinates that have nothing to do with the others."""

    a: Array
    b: Array
    Q: Array
    c: Array
    P0: Array
    signal: bool


def response_of(part: Part, lam: Array, h: float) -> Complex:
    """Return the response of a part of the state to the white noise of variance 1 that drives it."""
    turn = np.exp(-1j * lam)
    if isinstance(part, Order):
        s = math.sqrt(step_variance(part.alpha, part.Q, h))
        return np.asarray(s / ((1 - turn) ** part.alpha - g_of(part.alpha, part.f, h) * turn))
    if isinstance(part, Arfima):
        return np.asarray(math.sqrt(part.s2) * (1 - turn) ** -part.d / (1 - part.phi * turn))
    if isinstance(part, Walk):
        return np.asarray(part.K * math.sqrt(h) / (1 - turn))
    assert isinstance(part, Relaxation)
    a = math.exp(-h / part.tau_s)
    return np.asarray(part.sigma * math.sqrt(1 - a * a) / (1 - a * turn))


def least_phase(power: Array) -> Callable[[Array], Complex]:
    """Return the causal response, with a causal inverse, of this spectrum at equidistant λ up to π.

    Its logarithm has the cepstrum of the spectrum's, folded (Oppenheim & Schafer, Digital Signal Processing,
    1975, section 10.5).
    """
    logs = 0.5 * np.log(np.maximum(power, DEEPEST * power.mean()))
    cepstrum = np.fft.irfft(np.concatenate([logs[:1], logs]))
    cepstrum[1 : len(LINES)] *= 2
    cepstrum[len(LINES) + 1 :] = 0
    found = np.fft.rfft(cepstrum)
    at = np.concatenate([np.zeros(1), LINES])
    return lambda lam: np.exp(np.interp(lam, at, found.real) + 1j * np.interp(lam, at, found.imag))


def high_pass_poles(part: HighPass, h: float) -> Complex:
    """Return all poles of a high-pass, which has a whole number of them here; its zeros are as many at 1.

    Where |1 - 1/z|² = -(1 - z)²/z is one of the roots s² of 1 + (c/s²)^n, |z| < 1.
    """
    n = min(max(round(part.poles), 1), MOST_POLES)
    c = (2 * math.sin(min(math.pi * part.corner_hz * h, math.pi / 2))) ** 2
    half = 1 - c * np.exp(1j * math.pi * (2 * np.arange(n) + 1) / n) / 2
    z = half + np.sqrt(half**2 - 1 + 0j)
    return np.asarray(np.where(np.abs(z) < 1, z, 1 / z))


def high_pass_response(filters: Sequence[Part], lam: Array, h: float) -> Complex:
    """Return the response of the high-passes among filters at λ."""
    turn = np.exp(-1j * lam)
    found = np.ones(len(lam), dtype=np.complex128)
    for part in filters:
        if isinstance(part, HighPass):
            z = high_pass_poles(part, h)
            found *= math.sqrt(float(np.abs(z).prod())) * (
                (1 - turn[:, None]) / (1 - z * turn[:, None])
            ).prod(axis=1)
    return found


def filter_poles(filters: Sequence[Part], h: float) -> list[complex]:
    """Return the poles of filters, the upper ones of pairs."""
    found: list[complex] = []
    taps = 1 if filters else 0
    for part in filters:
        if isinstance(part, LowPass):
            n = math.ceil(min(max(part.poles, 1.0), MOST_POLES))
            angles = np.pi * (n + 1 + 2 * np.arange((n + 1) // 2)) / (2 * n)
            found += list(np.exp(2 * math.pi * part.corner_hz * h * np.exp(1j * angles)))
            if part.poles != n:
                taps += 2
        elif isinstance(part, HighPass):
            found += [z for z in high_pass_poles(part, h).tolist() if z.imag > -1e-12]
        elif isinstance(part, Notch):
            # The analog one's, by the bilinear transform.
            centre = math.tan(math.pi * part.frequency_hz * h)
            s = np.roots([1.0, centre * part.width_hz / part.frequency_hz, centre**2])
            found += list((1 + s) / (1 - s))
        else:
            taps += part.samples if isinstance(part, Mean) else 3
    return found + _short(taps)


def _short(taps: int) -> list[complex]:
    """Return poles that can be any filter of so many taps, or nearly."""
    if taps < 2:
        return [0.0] * taps
    n = (taps + 2) // 2 * 2
    return [
        SMALL ** (1 / n) * complex(np.exp(2j * math.pi * k / n)) for k in range(min(n, MOST_TAPS) // 2 + 1)
    ]


def own_poles(part: Part, lam: Array, h: float, room: int) -> list[complex]:
    """Return the poles that a part has, or the real ones that stand for it."""
    if isinstance(part, Relaxation):
        return [math.exp(-h / part.tau_s)]
    if isinstance(part, Alternating):
        return [-math.exp(-h / part.tau_s)]
    if isinstance(part, Resonance):
        return [pole_of(part, h)]
    if isinstance(part, Quantisation):
        return _short(2)
    if isinstance(part, Rise):
        return [-0.4, -0.8, *_spread(1e-2, room - 2)]
    if isinstance(part, Arfima):
        return [part.phi, 0.0, *_spread(float(lam[0]) / 2, room - 2)]
    if isinstance(part, Order):
        slowest = float(lam[0]) / 2
        found = [*_poles_of_order(part.alpha, g_of(part.alpha, part.f, h), slowest), 0.0]
        return [*found, *_spread(slowest, room - size(found))]
    return []


def _poles_of_order(alpha: float, g: float, slowest: float) -> list[complex]:
    """Return the poles z of (1 - 1/z)^α = g / z, or one that is nearly one; none slower than this."""
    rate = (-g) ** (1 / alpha) if g < 0 < alpha else 0.0
    if alpha > 1:
        w = 1 - rate * complex(np.exp(1j * math.pi / alpha))
        for _ in range(20 if rate > slowest else 0):
            w -= ((1 - w) ** alpha - g * w) / (-alpha * (1 - w) ** (alpha - 1) - g)
        return [1 / w] if abs(w) > 1 + slowest else []
    v = 1.0
    for _ in range(40 if g < 0 else 0):
        v = min((1 + v) ** alpha / -g, 1e6)
    found: list[complex] = [math.exp(-rate)] if rate > slowest else []
    return [*found, -1 / v] if v > 1 else found


def pole_of(part: Resonance, h: float) -> complex:
    """Return the upper pole of a resonance."""
    return complex(np.exp(complex(-part.width_hz, 2 * part.frequency_hz) * math.pi * h))


def _spread(low: float, room: int) -> list[complex]:
    """Return poles of rates from `low` on, in 1 a sample, evenly by their logarithms."""
    count = 1 + math.ceil(A_DECADE * math.log10(FASTEST / low))
    return list(np.exp(-np.geomspace(low, FASTEST, max(min(count, room), 1))))


def size(poles: Sequence[complex]) -> int:
    """Return the number of coordinates."""
    return sum(1 if _is_real(one) else 2 for one in poles)


def _is_real(pole: complex) -> bool:
    return abs(complex(pole).imag) < 1e-9


def fitted(
    wanted: Complex, total: Array, poles: Sequence[complex], lam: Array, room: int, *, signal: bool
) -> Block:
    """Return poles with a response that is fitted to this one, as well as it matters in the whole noise."""
    chosen: list[complex] = []
    for one in poles:
        upper = complex(one.real, abs(one.imag)) if not _is_real(one) else complex(one.real)
        apart = all(abs(upper - known) > DISTINCT * (1 - abs(known)) for known in chosen)
        if apart and size(chosen) + size([upper]) <= room:
            chosen.append(upper)
    z = np.array(chosen)
    real = z.imag == 0
    turn = np.exp(-1j * lam)[:, None]
    one, other = 1 / (1 - z * turn), 1 / (1 - z.conj() * turn)
    columns = np.concatenate([one + other, 1j * (one - other)[:, ~real]], axis=1)
    weight = np.where(lam > 1, FAST, 1.0) / np.sqrt(total)
    columns, target = columns * weight[:, None], wanted * weight
    columns = np.concatenate([columns.real, columns.imag])
    norms = np.sqrt((columns**2).sum(axis=0))
    for least in LEAST_SINGULAR:
        found = np.linalg.lstsq(columns / norms, np.concatenate([target.real, target.imag]), rcond=least)[0]
        share = (found / norms)[: len(z)].astype(complex)
        share[~real] += 1j * (found / norms)[len(z) :]
        block = driven(z, share, signal=signal)
        if float(np.trace(block.P0)) < CANCELLING * float(block.c @ block.P0 @ block.c):
            break
    return block


def driven(z: Complex, share: Complex, *, signal: bool) -> Block:
    """Return y = Re Σ ξ, ξ' = z ξ + 2 share w, with one white noise w of variance 1, as real coordinates."""
    m = 2 * share
    hermitian, plain = m[:, None] * m.conj(), m[:, None] * m
    # A real pole has no imaginary coordinate.
    keep = np.repeat(z.imag != 0, 2)
    keep[0::2] = True
    # Re ξ' = Re z Re ξ - Im z Im ξ
    a, b, c = np.repeat(z.real, 2), np.repeat(-z.imag, 2), np.tile([1.0, 0.0], len(z))
    Q = _real_covariance(hermitian, plain, keep)
    P0 = _real_covariance(hermitian / (1 - z[:, None] * z.conj()), plain / (1 - z[:, None] * z), keep)
    return Block(a[keep], b[keep], Q, c[keep], P0, signal)


def _real_covariance(hermitian: Complex, plain: Complex, keep: NDArray[np.bool_]) -> Array:
    """Return the covariance of real and imaginary parts, by turns, of E ξ ξ* and E ξ ξ'."""
    result = np.empty((len(keep), len(keep)))
    result[0::2, 0::2] = (hermitian + plain).real / 2
    result[1::2, 1::2] = (hermitian - plain).real / 2
    result[0::2, 1::2] = (plain - hermitian).imag / 2
    result[1::2, 0::2] = (plain + hermitian).imag / 2
    return np.asarray(((result + result.T) / 2)[np.ix_(keep, keep)])
