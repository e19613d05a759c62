"""A sentence of parts as a linear system, for the filter that tracks a sensor's bias (pure).

    x_k+1 = A x_k + w_k,   cov w = Q
    y_k   = offset + c x_k + v_k,   var v = R

A is diagonal, but for pairs of coordinates of a complex pole: a sample costs a filter a few products for each
coordinate. Relaxations and the walk are exact. An order is a sum of relaxations, two a decade, whose spectrum
is within a few per cent of its own; a resonance and a low-pass have their own poles. Coordinates are signal,
which belongs to the state, or coloured noise, which a bias has nothing of.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fltea.noise.parts import (
    FILTERS,
    Arfima,
    LowPass,
    Order,
    Part,
    Relaxation,
    Resonance,
    Walk,
    White,
    spectrum,
)

Array = NDArray[np.float64]

SIGNAL = (Relaxation, Walk, Order, Arfima)
A_DECADE = 2
"""Relaxations that stand for an order."""
POINTS_A_DECADE = 12
MOST_POLES = 6
"""Of a low-pass; more of them look the same below its corner."""
LEAST_WHITE = 1e-4
"""White noise of a measurement, over all noise: a filter cannot do without any."""
SLOW = 3.0
"""A relaxation whose corner is so many times below that of a low-pass goes through it unchanged."""
DIFFUSE = 1e4
"""Variance before the first sample of what is not known then, over that of the noise."""
MATTERS = 0.1
"""Of the noise's spectrum: what is weaker than that is made up less exactly."""
FAST_NOISE = (0.0, 0.3, 0.6, 0.8, -0.3, -0.6, -0.8, -0.9, -0.97)
"""Coefficients of the AR(1) parts that stand for coloured noise of any shape."""


class System(NamedTuple):
    """n coordinates; those of a pole pair are neighbours, and come first."""

    pairs: int
    """The number of pole pairs."""
    a: Array
    """Diagonal of A, (n,)."""
    b: Array
    """Imaginary parts of the poles, (n,): A[i, i + 1] = b[i], A[i + 1, i] = -b[i]; 0 without a pair."""
    Q: Array
    """Covariance of a step, (n, n)."""
    c: Array
    """What a sample has of each coordinate, (n,)."""
    signal: Array
    """1 where the coordinate belongs to the state, else 0; (n,)."""
    P0: Array
    """Covariance before the first sample, (n, n)."""
    R: float
    walks: bool
    """Whether the state has no mean, so that an offset cannot be told from it."""

    @property
    def A(self) -> Array:
        """The transition, (n, n)."""
        result = np.diag(self.a)
        for i in range(0, 2 * self.pairs, 2):
            result[i, i + 1], result[i + 1, i] = self.b[i], -self.b[i]
        return result

    def with_offset(self, q: float = 0.0, *, of_state: bool = False) -> "System":
        """Return the same with an offset of which nothing is known, as its last coordinate.

        It walks by steps of variance q. of_state: what walks is part of the state.
        """
        n = len(self.a)
        Q, P0 = np.zeros((n + 1, n + 1)), np.zeros((n + 1, n + 1))
        Q[:n, :n], P0[:n, :n] = self.Q, self.P0
        Q[n, n] = q
        P0[n, n] = DIFFUSE * (self.R + float(self.c @ self.P0 @ self.c))
        a, b, c, signal = (
            np.append(self.a, 1.0),
            np.append(self.b, 0.0),
            np.append(self.c, 1.0),
            np.append(self.signal, float(of_state)),
        )
        return System(self.pairs, a, b, Q, c, signal, P0, self.R, self.walks or of_state)

    def spectrum(self, lam: Array) -> Array:
        """Return the spectrum of y at λ > 0, in rad a sample: what the system makes of its parts."""
        n = len(self.a)
        turn = np.exp(1j * np.asarray(lam))[:, None, None] * np.eye(n)
        row = np.linalg.solve(
            np.swapaxes(turn - self.A, 1, 2), np.broadcast_to(self.c[:, None], (len(lam), n, 1))
        )
        row = row[:, :, 0]
        return np.asarray(np.einsum("ki,ij,kj->k", row, self.Q, row.conj()).real + self.R)


class _Block(NamedTuple):
    """Coordinates that have nothing to do with the others."""

    a: Array
    b: Array
    Q: Array
    c: Array
    P0: Array
    signal: bool


def system(parts: Sequence[Part], h: float, samples: int) -> System:
    """Return the system of a noise made of parts; h: sampling period in s.

    samples: of the record; what is slower than it is left out of an order.

    Raises:
        ValueError: a part is not stationary.
    """
    filters = [part for part in parts if isinstance(part, FILTERS)]
    exact: list[_Block] = []
    by_fit: list[Part] = []
    noise: list[Part] = []
    lows = [part for part in filters if isinstance(part, LowPass)]
    corner_hz = lows[0].corner_hz if lows else math.inf if not filters else 0.25 / h
    for part in parts:
        if isinstance(part, Walk):
            exact.append(_real(1.0, part.K**2 * h, 0.0))
        elif isinstance(part, Relaxation) and _is_slow(part, corner_hz):
            a = math.exp(-h / part.tau_s)
            exact.append(_real(a, part.sigma**2 * -math.expm1(-2 * h / part.tau_s), part.sigma**2))
        elif isinstance(part, SIGNAL):
            by_fit.append(part)
        elif not isinstance(part, FILTERS):
            noise.append(part)
    lam = _grid(samples)
    nothing = np.zeros(len(lam))
    wanted = spectrum([White(0.0), *by_fit, *filters], lam, h) if by_fit else nothing
    blocks, R = _of_noise(noise, filters, lam, h)
    if by_fit:
        around = float(_spectrum_of(blocks, R, lam).max())
        rates = _rates(float(lam[0]))
        poles = np.array([0.0, *np.exp(-rates), *(-np.exp(-rates[rates > 0.1]))])
        blocks += _fitted(wanted, around, poles, lam, signal=True)
    blocks += exact
    return _joined(blocks, R, samples)


def white(R: float) -> System:
    """Return the system of white noise, which has no state."""
    return _joined([], R, 1)


def walk(R: float, q: float) -> System:
    """Return the system of a random walk with steps of variance q in white noise."""
    return _joined([_real(1.0, q, 0.0)], R, 1)


def relaxing(R: float, a: float, variance: float) -> System:
    """Return the system of a relaxation of coefficient a in white noise."""
    return _joined([_real(a, variance * (1 - a * a), variance)], R, 1)


def _joined(blocks: Sequence[_Block], R: float, samples: int) -> System:
    ordered = sorted(blocks, key=lambda one: not one.b.any())
    n = sum(len(one.a) for one in ordered)
    Q, P0 = np.zeros((n, n)), np.zeros((n, n))
    at = 0
    for one in ordered:
        inside = slice(at, at + len(one.a))
        Q[inside, inside], P0[inside, inside] = one.Q, one.P0
        at += len(one.a)

    def column(name: str) -> Array:
        return np.concatenate([np.zeros(0), *(getattr(one, name) for one in ordered)])

    signal = np.concatenate([np.zeros(0), *(np.full(len(one.a), float(one.signal)) for one in ordered)])
    a, b, c = column("a"), column("b"), column("c")
    moving = (a == 1.0) & (signal == 1.0)
    level = R + float(c @ P0 @ c) + float(Q[moving][:, moving].sum()) * samples
    for i in np.flatnonzero(moving):
        P0[i, i] = DIFFUSE * level
    return System(int(np.count_nonzero(b)) // 2, a, b, Q, c, signal, P0, R, bool(moving.any()))


def _of_noise(
    noise: Sequence[Part], filters: Sequence[Part], lam: Array, h: float
) -> tuple[list[_Block], float]:
    """Return the blocks of what is no signal, and the variance of its white part."""
    lows = [part for part in filters if isinstance(part, LowPass)]
    whole = spectrum(noise or [White(0.0)], lam, h) if not filters else spectrum([*noise, *filters], lam, h)
    level = float(whole.mean())
    plain = all(isinstance(part, White | Resonance) for part in noise)
    if not filters and plain:
        R = sum(part.R for part in noise if isinstance(part, White))
        pairs = [_resonating(part, h) for part in noise if isinstance(part, Resonance)]
        return pairs, max(R, LEAST_WHITE * level, 1e-300)
    blocks: list[_Block] = []
    R = sum(part.R for part in noise if isinstance(part, White))
    if lows and R > 0 and lows[0].corner_hz < 0.5 / h:
        low = min(max(lows[0].poles, 1.0), float(MOST_POLES))
        share = low - math.floor(low)
        blocks = [
            _low_passed(lows[0].corner_hz, poles, R * part, h)
            for poles, part in ((math.floor(low), 1 - share), (math.ceil(low), share))
            if part > 0
        ]
        whole = np.maximum(whole - _spectrum_of(blocks, 0.0, lam), 0.0)
    least = LEAST_WHITE * max(level, 1e-300)
    found = _fitted(whole, level, np.array(FAST_NOISE), lam, signal=False)
    white = sum(float(one.Q[0, 0]) for one in found if one.a[0] == 0.0)
    return blocks + [one for one in found if one.a[0] != 0.0], max(white, least)


def _is_slow(part: Relaxation, corner_hz: float) -> bool:
    return SLOW / (2 * math.pi * part.tau_s) < corner_hz


def _real(a: float, q: float, variance: float, *, signal: bool = True) -> _Block:
    one = np.ones(1)
    return _Block(a * one, 0 * one, np.array([[q]]), one, np.array([[variance]]), signal)


def _resonating(part: Resonance, h: float) -> _Block:
    """Return the two coordinates of a resonance: those of its complex pole, driven together."""
    at = 2 * math.pi * part.frequency_hz * h
    z = complex(math.exp(-math.pi * part.width_hz * h)) * complex(math.cos(at), math.sin(at))
    # Its spectrum is s2 over |1 - z e^-iλ|² |1 - z* e^-iλ|², of this height at its frequency.
    turn = complex(math.cos(at), -math.sin(at))
    s2 = part.height * abs(1 - z * turn) ** 2 * abs(1 - z.conjugate() * turn) ** 2
    return _pairs(np.array([z]), np.array([z / (z - z.conjugate())]), np.array([[s2]]), np.array([[s2]]))


def _low_passed(corner_hz: float, n: int, R: float, h: float) -> _Block:
    """Return white noise behind Butterworth's filter of n poles, sampled, by its own poles."""
    corner = 2 * math.pi * corner_hz * h
    angles = np.pi * (2 * np.arange(1, n + 1) + n - 1) / (2 * n)
    p = corner * np.exp(1j * angles)
    gaps = p[:, None] - p[None, :] + np.eye(n)
    residues = corner**n / gaps.prod(axis=1)
    upper, real = p.imag > 1e-9 * corner, np.abs(p.imag) <= 1e-9 * corner
    chosen = upper | real
    p, weight = p[chosen], residues[chosen]
    ends = p[:, None] + p.conj()[None, :]
    same = p[:, None] + p[None, :]
    block = _pairs(np.exp(p), weight, R * np.expm1(ends) / ends, R * np.expm1(same) / same)
    if not real.any():
        return block
    # A real pole is a pair without an imaginary part: its second coordinate is left out.
    keep = np.array([k for k in range(len(block.a)) if not (k % 2 and real[chosen][k // 2])])
    # The filter of an odd number of poles has one of them, which counts once.
    c = block.c.copy()
    c[2 * np.flatnonzero(real[chosen])] /= 2
    order = sorted(range(len(keep)), key=lambda k: real[chosen][keep[k] // 2])
    keep = keep[order]
    return _Block(
        block.a[keep],
        block.b[keep],
        block.Q[np.ix_(keep, keep)],
        c[keep],
        block.P0[np.ix_(keep, keep)],
        False,
    )


def _pairs(z: Array, weight: Array, hermitian: Array, plain: Array) -> _Block:
    """Return y = 2 Re Σ weight ξ, ξ' = z ξ + w, E w w* = hermitian, E w w^T = plain, as real coordinates."""
    n = len(z)
    stationary = hermitian / (1 - z[:, None] * z.conj()[None, :]), plain / (1 - z[:, None] * z[None, :])

    def real(h: Array, p: Array) -> Array:
        result = np.zeros((2 * n, 2 * n))
        result[0::2, 0::2] = (h + p).real / 2
        result[1::2, 1::2] = (h - p).real / 2
        result[0::2, 1::2] = (p - h).imag / 2
        result[1::2, 0::2] = (p + h).imag / 2
        return result

    a, b, c = np.repeat(z.real, 2), np.zeros(2 * n), np.zeros(2 * n)
    # Re ξ' = Re z Re ξ - Im z Im ξ
    b[0::2], b[1::2] = -z.imag, -z.imag
    c[0::2], c[1::2] = 2 * weight.real, -2 * weight.imag
    return _Block(a, b, real(hermitian, plain), c, real(*stationary), False)


def _fitted(wanted: Array, around: float, poles: Array, lam: Array, *, signal: bool) -> list[_Block]:
    """Return AR(1) parts whose spectra make up `wanted`, as well as it matters beside noise of this power."""
    scale = wanted + MATTERS * around
    shapes = (1 - poles**2) / np.abs(1 - poles * np.exp(-1j * lam[:, None])) ** 2
    variances = nonnegative(shapes / scale[:, None], wanted / scale)
    return [
        _real(float(a), float(v * (1 - a * a)), float(v), signal=signal)
        for a, v in zip(poles, variances, strict=True)
        if v > 0
    ]


def nonnegative(matrix: Array, target: Array) -> Array:
    """Return x ≥ 0 that minimises |matrix x - target|², by the active set (Lawson & Hanson, 1974, 23)."""
    norms = np.sqrt((matrix**2).sum(axis=0))
    A = matrix / norms
    gram, right = A.T @ A, A.T @ target
    x = np.zeros(A.shape[1])
    active = np.zeros(A.shape[1], dtype=bool)
    for _ in range(3 * A.shape[1]):
        slope = right - gram @ x
        slope[active] = -np.inf
        best = int(slope.argmax())
        if slope[best] <= 1e-10 * math.sqrt(len(target)):
            break
        active[best] = True
        while True:
            at = np.flatnonzero(active)
            solved = np.linalg.lstsq(A[:, at], target, rcond=None)[0]
            if (solved > 0).all():
                break
            falling = solved <= 0
            steps = x[at][falling] / np.maximum(x[at][falling] - solved[falling], 1e-300)
            x[at] += float(steps.min()) * (solved - x[at])
            active[at[falling][steps <= steps.min()]] = False
            x[~active] = 0
        x[:] = 0
        x[at] = solved
    return np.asarray(x / norms)


def _grid(samples: int) -> Array:
    low = min(math.pi / max(samples, 64), 0.02)
    count = round(POINTS_A_DECADE * math.log10(math.pi / low))
    near = math.pi * (1 - np.geomspace(1e-6, 0.3, 8))
    return np.unique(np.concatenate([np.geomspace(low, 0.7 * math.pi, count), near]))


def _rates(low: float) -> Array:
    """Return the rates of relaxations, in 1 a sample, which stand for an order."""
    high = 3.0
    count = 1 + math.ceil(A_DECADE * math.log10(high / (low / 2)))
    return np.geomspace(low / 2, high, count)


def _spectrum_of(blocks: Sequence[_Block], R: float, lam: Array) -> Array:
    return _joined(blocks, R, 1).spectrum(lam) if blocks else np.full(len(lam), R)
