"""Approximate a part of a noise by a sum of poles, all driven by the same white noise.

A part or a chain of filters has poles of its own, or is approximated by real poles. An order takes two real
poles per decade of frequency. The contribution of each pole is found by a least-squares fit to the magnitude
and phase of the part's frequency response.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fltea.noise.filters import HighPass
from fltea.noise.part import Part
from fltea.noise.pole_sets import is_real, short, size
from fltea.records.arrays import Array, Complex

LINES = math.pi * np.arange(1, 4097) / 4096
"""Frequencies λ at which a spectrum is computed, to derive its minimum-phase response."""
FAST = 0.3
"""Weight of frequencies above 1 rad per sample in the fit of poles. These frequencies matter less than lower
ones, which have weight 1.
"""
DISTINCT = 0.05
"""The distance between two poles is at least this proportion of the distance of one of them from the unit
circle.

Contributions of poles that are closer would mostly cancel each other.
"""
LEAST_SINGULAR, CANCELLING = (1e-8, 1e-6, 1e-4, 1e-2), 1e4
"""Thresholds of the least-squares fit of poles.

LEAST_SINGULAR: the fit neglects singular values below this proportion of the largest one. It is repeated with
the next proportion while the states cancel each other too much for floating-point numbers.
CANCELLING: states cancel each other too much if their total power exceeds the power of their sum by more than
this factor.
"""
DEEPEST = 1e-7
"""A spectrum is raised to this proportion of its mean wherever it is lower. Otherwise its logarithm would be
infinite where a filter has a zero.
"""


class Block(NamedTuple):
    """A group of states of a state-space model, independent of all other states.

    The fields are as in `System`.
    """

    a: Array
    b: Array
    Q: Array
    c: Array
    P0: Array
    signal: bool


def least_phase(power: Array) -> Callable[[Array], Complex]:
    """Return the minimum-phase response whose square is the spectrum `power`, which is given at `LINES`.

    A minimum-phase response is causal and has a causal inverse. Its cepstrum is the cepstrum of the
    spectrum's square root, with the half for negative times folded onto positive times (Oppenheim & Schafer,
    Digital Signal Processing, 1975, section 10.5).
    """
    logs = 0.5 * np.log(np.maximum(power, DEEPEST * power.mean()))
    cepstrum = np.fft.irfft(np.concatenate([logs[:1], logs]))
    cepstrum[1 : len(LINES)] *= 2
    cepstrum[len(LINES) + 1 :] = 0
    found = np.fft.rfft(cepstrum)
    at = np.concatenate([np.zeros(1), LINES])
    return lambda lam: np.exp(np.interp(lam, at, found.real) + 1j * np.interp(lam, at, found.imag))


def high_pass_response(filters: Sequence[Part], lam: Array, h: float) -> Complex:
    """Return the frequency response at λ of the high-passes among the filters."""
    turn = np.exp(-1j * lam)
    found = np.ones(len(lam), dtype=np.complex128)
    for part in filters:
        if isinstance(part, HighPass):
            z = part.all_poles(h)
            found *= math.sqrt(float(np.abs(z).prod())) * (
                (1 - turn[:, None]) / (1 - z * turn[:, None])
            ).prod(axis=1)
    return found


def filter_poles(filters: Sequence[Part], h: float) -> list[complex]:
    """Return the poles of all filters. A complex pair is given by its pole with imaginary part ≥ 0."""
    found: list[complex] = []
    taps = 1 if filters else 0
    for part in filters:
        poles, more = part.filter_poles(h)
        found += poles
        taps += more
    return found + short(taps)


def fitted(
    wanted: Complex, total: Array, poles: Sequence[complex], lam: Array, room: int, *, signal: bool
) -> Block:
    """Return a block of states with some of `poles`, whose frequency response is near `wanted` at `lam`.

    `total`: spectrum of the whole noise, by which the error at each frequency is weighted. `room`: largest
    number of states.
    """
    chosen: list[complex] = []
    for one in poles:
        upper = complex(one.real, abs(one.imag)) if not is_real(one) else complex(one.real)
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
    """Return a block of real states for the complex poles `z`, all driven by the same white noise.

    `share`: complex weight of each pole in the frequency response. A pole has a complex state ξ, which the
    next step changes to z ξ + 2 share w. w is white noise of variance 1. The real states are the real and
    imaginary parts of every ξ. The block's output is Re Σ ξ, a sum over the poles.
    """
    m = 2 * share
    hermitian, plain = m[:, None] * m.conj(), m[:, None] * m
    # Real and imaginary parts of the complex states alternate. The state of a real pole has no imaginary
    # part.
    keep = np.repeat(z.imag != 0, 2)
    keep[0::2] = True
    # `a` is Re z and `b` is -Im z, since a step changes Re ξ to Re z Re ξ - Im z Im ξ plus noise.
    a, b, c = np.repeat(z.real, 2), np.repeat(-z.imag, 2), np.tile([1.0, 0.0], len(z))
    Q = _real_covariance(hermitian, plain, keep)
    P0 = _real_covariance(hermitian / (1 - z[:, None] * z.conj()), plain / (1 - z[:, None] * z), keep)
    return Block(a[keep], b[keep], Q, c[keep], P0, signal)


def _real_covariance(hermitian: Complex, plain: Complex, keep: NDArray[np.bool_]) -> Array:
    """Return the covariance of real states: the real and the imaginary part of each complex state ξ in turn.

    `hermitian`, `plain`: for the vector ξ of all complex states, the expectations of ξ ξ^H (conjugated) and
    of ξ ξ^T (not conjugated). `keep`: marks the real states that the result has.
    """
    result = np.empty((len(keep), len(keep)))
    result[0::2, 0::2] = (hermitian + plain).real / 2
    result[1::2, 1::2] = (hermitian - plain).real / 2
    result[0::2, 1::2] = (plain - hermitian).imag / 2
    result[1::2, 0::2] = (plain + hermitian).imag / 2
    return np.asarray(((result + result.T) / 2)[np.ix_(keep, keep)])
