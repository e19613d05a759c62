"""Convert a noise model to a linear state-space model (a system), for the filter that tracks a sensor's bias.

`fltea.noise.linear_system` defines the system. Relaxations, the random walk and resonances are described
exactly, all other parts by poles that are fitted (`fltea.noise.poles`). A state is either signal, which is
part of the bias, or coloured noise, which is not part of the bias.

Every sensor has white noise, which its own filter may turn into a relaxation (a first-order Gauss-Markov
process). So if a noise model has hardly any white noise, its fastest relaxation counts as filtered white
noise, and not as signal (`filtered_noise`). The same holds for an order near 1 that is as fast. Other orders,
and 1/f noise, remain signals, since they have a longer memory than any sensor's filter.
"""

import functools
import math
import statistics
from collections.abc import Sequence
from typing import TypeGuard

import numpy as np

from fltea.noise.filters import HighPass
from fltea.noise.left_open import mean_order
from fltea.noise.linear_system import DIFFUSE, System
from fltea.noise.part import Part
from fltea.noise.parts import (
    FILTERS,
    SLOW,
    Alternating,
    Arfima,
    Floor,
    Order,
    Relaxation,
    Resonance,
    Walk,
    White,
    spectrum,
)
from fltea.noise.pole_sets import MOST_TAPS, size
from fltea.noise.poles import (
    LINES,
    Block,
    driven,
    filter_poles,
    fitted,
    high_pass_response,
    least_phase,
)
from fltea.records.arrays import Array, Complex, merged

MOST = 23
"""Largest number of states of a system, not counting the offset."""
POINTS_A_DECADE = 16
LEAST_WHITE = 1e-4
"""Without white noise, no Kalman filter works. So R, the variance of the white noise, is at least this
proportion of the variance of all noise that is no part of the bias. R is also at least this proportion of the
variance that the noise of one step adds to a sample.
"""
NO_MATTER = 0.02
"""A relaxation is described as if it had not passed the sensor's filters, if that changes the spectrum by
less than this proportion at every frequency.
"""
STOPPED = 1e-4
"""In the fits of poles, a high-pass reduces the noise's power at most to this proportion. Deeper attenuation
is neglected.
"""
SLOWEST_FILTER_S, SLOWEST_FILTER = 0.5, 20
"""Longest time constant of a sensor's own filter: SLOWEST_FILTER_S seconds or SLOWEST_FILTER samples,
whichever is longer.
"""
NEARLY_ONE = 0.9
"""A part with an order above this value may really be a relaxation, which has the order 1."""
TINY = 1e-300


def system(parts: Sequence[Part], h: float, samples: int, *, found: bool = False) -> System:
    """Return the linear state-space model of a noise that is made of parts.

    Args:
        parts: the parts of the noise.
        h: sampling period [s].
        samples: length of the record. Noise of a fractional order is described only down to frequencies that
            such a record shows.
        found: whether the parts were estimated from that record. Then the order is uncertain, and a mean over
            the likely orders is used (`fltea.noise.left_open`).

    Raises:
        ValueError: a part is not stationary.
    """
    filters = [part for part in parts if isinstance(part, FILTERS)]
    lam = _grid(samples)
    through: Complex | float = 1.0
    if filters:
        through = _response(filters, lam, h)
    order = next((part for part in parts if isinstance(part, Order | Arfima)), None)
    if found and order is not None:
        R, power = mean_order(parts, order, LINES, h, samples)
        through = through * least_phase(power / spectrum([order], LINES, h))(lam)
        parts = [White(R), *(part for part in parts if not isinstance(part, White))]
    total = _total(parts, lam, h)
    of_sensor = filtered_noise(parts, h)
    high_passed = any(isinstance(part, HighPass) for part in filters)
    # Use `statistics.median`, since numpy's median would first import masked arrays, which takes 0.02 s.
    usual = statistics.median(total.tolist())
    stopped = np.abs(1 - spectrum([White(1.0), *filters], lam, h)) / (total + NO_MATTER * usual)
    exact: list[Block] = []
    by_fit: list[Part] = []
    noise: list[Part] = []
    for part in parts:
        if isinstance(part, Walk) and not high_passed:
            exact.append(_real(1.0, part.K**2 * h, 0.0))
        elif part is of_sensor and isinstance(part, Relaxation):
            noise.append(part)
        elif isinstance(part, Relaxation) and (stopped * spectrum([part], lam, h) < NO_MATTER).all():
            # The relaxation is so slow that the sensor's filters do not change it, so it is described
            # exactly.
            exact.append(_relaxing(math.exp(-h / part.tau_s), part.sigma**2, signal=True))
        elif isinstance(part, SLOW):
            by_fit.append(part)
        elif not isinstance(part, FILTERS):
            noise.append(part)
    behind = filter_poles(filters, h)
    blocks, R = _of_noise(noise, filters, behind, total, lam, h, MOST - len(exact) - 4 * len(by_fit))
    room = MOST - len(exact) - sum(len(one.a) for one in blocks)
    for k, part in enumerate(by_fit):
        share = room // (len(by_fit) - k)
        poles = [*part.own_poles(lam, h, share - min(size(behind), share // 2)), *behind]
        signal = part is not of_sensor
        blocks.append(fitted(part.response(lam, h) * through, total, poles, lam, share, signal=signal))
        room -= len(blocks[-1].a)
    return _joined([*blocks, *exact], R, samples)


def filtered_noise(parts: Sequence[Part], h: float) -> Relaxation | Order | None:
    """Return the part that is a sensor's white noise after a filter; None if there is no such part.

    It is a relaxation, or noise of an order α near 1, which is hardly different from a relaxation. It is at
    least as fast as the slowest filter of a sensor. At half the sample rate, where low-passes pass least, its
    spectrum is above that of all white noise together. (So white noise is visible at no frequency.) Of
    several such parts, it is the one with the highest spectrum at half the sample rate.
    """
    at = np.array([math.pi])
    slowest = max(SLOWEST_FILTER_S, SLOWEST_FILTER * h)
    fast = [part for part in parts if _decays_within(part, slowest)]
    if not fast:
        return None
    most = max(fast, key=lambda part: float(spectrum([part], at, h)[0]))
    white = sum(part.R for part in parts if isinstance(part, White | Floor))
    return most if float(spectrum([most], at, h)[0]) > white else None


def _decays_within(part: Part, t_s: float) -> TypeGuard[Relaxation | Order]:
    # an order near 1 is like a relaxation: its spectrum is flat below |f|^(1/α) in rad/s
    if isinstance(part, Order):
        return part.alpha > NEARLY_ONE and part.f < 0 and abs(part.f) ** (-1 / part.alpha) <= t_s
    return isinstance(part, Relaxation) and part.tau_s <= t_s


def _joined(blocks: Sequence[Block], R: float, samples: int) -> System:
    n = sum(len(one.a) for one in blocks)
    Q, P0 = np.zeros((n, n)), np.zeros((n, n))
    at = 0
    for one in blocks:
        inside = slice(at, at + len(one.a))
        Q[inside, inside], P0[inside, inside] = one.Q, one.P0
        at += len(one.a)

    def column(name: str) -> Array:
        return np.concatenate([np.zeros(0), *(getattr(one, name) for one in blocks)])

    signal = np.concatenate([np.zeros(0), *(np.full(len(one.a), float(one.signal)) for one in blocks)])
    a, b, c = column("a"), column("b"), column("c")
    R = max(R, LEAST_WHITE * float(c @ Q @ c))
    moving = (a == 1.0) & (signal == 1.0)
    level = R + float(c @ P0 @ c) + float(Q[moving][:, moving].sum()) * samples
    P0[moving, moving] = DIFFUSE * level
    order = np.argsort(b == 0.0, kind="stable")
    square = np.ix_(order, order)
    pairs = int(np.count_nonzero(b)) // 2
    return System(
        pairs, a[order], b[order], Q[square], c[order], signal[order], P0[square], R, bool(moving.any())
    )


def _of_noise(
    noise: Sequence[Part],
    filters: Sequence[Part],
    behind: Sequence[complex],
    total: Array,
    lam: Array,
    h: float,
    room: int,
) -> tuple[list[Block], float]:
    """Return blocks of states for the coloured noise, and the variance of the white noise.

    Both are no part of the bias.
    """
    blocks: list[Block] = []
    coloured: list[Part] = []
    poles = list(behind)
    R = 0.0
    for part in noise:
        if isinstance(part, Floor) or (isinstance(part, White) and not filters):
            R += part.R
        elif isinstance(part, Resonance) and not filters:
            blocks.append(_resonating(part, h))
        elif isinstance(part, Relaxation | Alternating) and not filters:
            sign = -1 if isinstance(part, Alternating) else 1
            blocks.append(_relaxing(sign * math.exp(-h / part.tau_s), part.sigma**2, signal=False))
        else:
            coloured.append(part)
            poles += part.own_poles(lam, h, MOST_TAPS)
    exact = _joined(blocks, R, 1)
    level = R + float(exact.c @ exact.P0 @ exact.c)
    others = _without_high_passes(filters)
    power = spectrum([White(0.0), *coloured, *others], LINES, h) if coloured else np.zeros(len(LINES))
    level += float(power.mean())
    if coloured and level > 0:
        # Behind filters, half of the smallest value of the coloured noise's spectrum counts as white noise.
        # It is only half, since the rest must stay positive at every frequency. If one of the filters is a
        # high-pass, the smallest value is 0.
        white = 0.5 * float(power.min()) if others and len(others) == len(filters) else 0.0
        response = least_phase(power - white)(lam) * high_pass_response(filters, lam, h)
        blocks.append(fitted(response, total, poles, lam, room - len(exact.a), signal=False))
        R += white
    return blocks, max(R, LEAST_WHITE * level, TINY)


def _response(filters: Sequence[Part], lam: Array, h: float) -> Complex:
    """Return the frequency response at λ of filters through which noise passes one after the other.

    High-passes are computed separately: they act at lower frequencies than the grid `LINES` resolves.
    """
    rest = least_phase(spectrum([White(1.0), *_without_high_passes(filters)], LINES, h))(lam)
    return np.asarray(rest * high_pass_response(filters, lam, h))


def _total(parts: Sequence[Part], lam: Array, h: float) -> Array:
    """Return the spectrum of a noise at λ, by which the fits of poles weight their errors.

    Where a high-pass leaves almost nothing, the result is the proportion STOPPED of the spectrum without it.
    """
    found = spectrum(parts, lam, h)
    high = [part for part in parts if isinstance(part, HighPass)]
    if not high:
        return found
    whole = spectrum(_without_high_passes(parts), lam, h)
    return np.asarray(np.maximum(found, STOPPED * whole))


def _without_high_passes(parts: Sequence[Part]) -> list[Part]:
    return [part for part in parts if not isinstance(part, HighPass)]


def _real(a: float, q: float, variance: float) -> Block:
    one = np.ones(1)
    return Block(a * one, 0 * one, np.array([[q]]), one, np.array([[variance]]), True)


def _relaxing(a: float, variance: float, *, signal: bool) -> Block:
    return _real(a, variance * (1 - a * a), variance)._replace(signal=signal)


def _resonating(part: Resonance, h: float) -> Block:
    """Return the block of two states that describe a resonance."""
    z, turn = part.pole(h), np.exp(-2j * math.pi * part.frequency_hz * h)
    # The resonance's poles are z and the conjugate z*. Its spectrum is s2 / (|1 - z e^-iλ|² |1 - z* e^-iλ|²).
    # s2 = s² is the variance of the white noise that drives it. It follows from the spectrum's height.
    s = math.sqrt(part.height) * abs(1 - z * turn) * abs(1 - z.conjugate() * turn)
    return driven(np.array([z]), np.array([s * z / (z - z.conjugate())]), signal=False)


# the cached result is the same for all axes and devices with records of this length
@functools.lru_cache(maxsize=8)
def _grid(samples: int) -> Array:
    low = min(math.pi / max(samples, 64), 0.02)
    count = round(POINTS_A_DECADE * math.log10(math.pi / low))
    return merged(np.geomspace(low, math.pi, count), np.linspace(0.05, math.pi, 64))
