"""Populations of noises with random parameters. On these noises the coverage of intervals is counted."""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from fltea.noise import parts as p

H = 0.01
"""Sampling period [s]."""
SHORTEST, LONGEST = 6_000, 60_000
"""Least and greatest number of samples of a record: a minute to ten minutes."""
SHORT = 3_000
"""Smallest number of samples of a record in some populations: half a minute."""

Parts = tuple[p.Part, ...]
Rng = np.random.Generator


class Population(NamedTuple):
    """Noises of one kind. `draw`: returns the parts of one noise, from a generator of random numbers."""

    draw: Callable[[Rng], Parts]
    shortest: int = SHORTEST
    """Least number of samples of a record."""
    longest: int = LONGEST
    """Greatest number of samples of a record."""
    steady: bool = False
    """Whether the intervals of the Allan deviation, the drift and the forecasts are checked as well."""


def between(rng: Rng, low: float, high: float) -> float:
    """Return a random number between `low` and `high` whose logarithm is uniformly distributed."""
    return math.exp(rng.uniform(math.log(low), math.log(high)))


def white(rng: Rng) -> p.White:
    """Return white noise of random variance."""
    return p.White(between(rng, 0.01, 100.0))


def relaxation(rng: Rng, R: float, low_hz: float, high_hz: float, low: float, high: float) -> p.Relaxation:
    """Return a relaxation (a first-order Gauss-Markov process) with a random corner frequency and level.

    `low_hz`, `high_hz`: range of the corner frequency [Hz]. `low`, `high`: range of the relaxation's density
    at low frequencies, divided by the density R of the white noise.
    """
    tau_s = 1 / (2 * math.pi * between(rng, low_hz, high_hz))
    phi = math.exp(-H / tau_s)
    return p.Relaxation(math.sqrt(R * between(rng, low, high) * (1 - phi) / (1 + phi)), tau_s)


def _relaxations(*of: tuple[float, float, float, float]) -> Callable[[Rng], Parts]:
    def draw(rng: Rng) -> Parts:
        w = white(rng)
        return w, *(relaxation(rng, w.R, *one) for one in of)

    return draw


def _walk(rng: Rng, R: float) -> p.Walk:
    return p.Walk(2 * math.pi * between(rng, 0.03, 0.5) * math.sqrt(R * H))


def _order(rng: Rng, R: float, low: float, high: float) -> p.Order:
    """Return a part of a noise model: the fractional state with a random order.

    `low`, `high`: range of the variance of the state's steps, divided by the variance R of the white noise.
    If R is 0, it is the range of the variance itself.
    """
    alpha = rng.uniform(0.2, 0.8)
    g = -min(between(rng, 0.01, 0.6), 0.9 * 2**alpha)
    s2 = between(rng, low, high) * (R or 1.0)
    return p.Order(alpha, g / H**alpha, s2 / H ** (2 * alpha))


def _in_white(make: Callable[[Rng, float], p.Part]) -> Callable[[Rng], Parts]:
    def draw(rng: Rng) -> Parts:
        w = white(rng)
        return w, make(rng, w.R)

    return draw


def _alternating(rng: Rng, R: float) -> p.Part:
    tau_s = H * between(rng, 1.5, 8.0)
    phi = math.exp(-H / tau_s)
    return p.Alternating(math.sqrt(R * between(rng, 2.0, 30.0) * (1 - phi) / (1 + phi)), tau_s)


def _arfima(rng: Rng, R: float) -> p.Part:
    phi = rng.uniform(0.3, 0.95)
    return p.Arfima(rng.uniform(0.2, 0.45), phi, R * between(rng, 1.0, 30.0) * (1 - phi) ** 2)


def _resonance(rng: Rng, R: float) -> p.Part:
    hz = rng.uniform(8.0, 35.0)
    return p.Resonance(R * between(rng, 2.0, 10.0), hz, hz * between(rng, 0.15, 0.5))


def _low_pass(rng: Rng) -> Parts:
    w = white(rng)
    low_pass = p.LowPass(between(rng, 8.0, 35.0), between(rng, 1.3, 5.0))
    return w, low_pass, p.Floor(w.R * between(rng, 1e-3, 0.05))


def _quantisation(rng: Rng, R: float) -> p.Part:
    return p.Quantisation(H * math.sqrt(R * between(rng, 0.3, 3.0)))


def _rise(rng: Rng, R: float) -> p.Part:
    return p.Rise(R * between(rng, 2.0, 8.0), rng.uniform(0.3, 1.8))


def _sharpening(rng: Rng, _: float) -> p.Part:
    return p.Sharpening(rng.uniform(0.04, 0.3) if rng.random() < 0.5 else rng.uniform(-0.2, -0.04))


def _high_pass(rng: Rng, _: float) -> p.Part:
    return p.HighPass(between(rng, 0.2, 2.0), 1.0)


def _notch(rng: Rng, _: float) -> p.Part:
    return p.Notch(rng.uniform(10.0, 40.0), rng.uniform(3.0, 8.0))


POPULATIONS: dict[str, Population] = {
    "white": Population(lambda rng: (white(rng),), steady=True),
    "relaxation": Population(_relaxations((0.3, 5.0, 2.0, 100.0)), steady=True),
    "fast relaxation": Population(_relaxations((5.0, 50.0, 0.1, 10.0))),
    "weak fast relaxation": Population(_relaxations((5.0, 60.0, 0.02, 0.4))),
    "two relaxations": Population(_relaxations((0.1, 0.3, 30.0, 300.0), (2.0, 6.0, 2.0, 30.0)), 40_000),
    "slow and weak fast relaxation": Population(_relaxations((0.2, 2.0, 5.0, 100.0), (8.0, 60.0, 0.02, 0.4))),
    "walk": Population(_in_white(_walk), 20_000),
    "order": Population(_in_white(lambda rng, R: _order(rng, R, 0.3, 30.0)), 30_000, steady=True),
    "order, short record": Population(_in_white(lambda rng, R: _order(rng, R, 0.3, 30.0)), SHORT, 4 * SHORT),
    "order, no white": Population(lambda rng: (p.White(0.0), _order(rng, 0.0, 0.1, 10.0)), 10_000),
    "ARFIMA": Population(_in_white(_arfima), 30_000),
    "resonance": Population(_in_white(_resonance)),
    "quantisation": Population(_in_white(_quantisation)),
    "rise": Population(_in_white(_rise)),
    "alternating": Population(_in_white(_alternating)),
    "low-pass": Population(_low_pass),
    "sharpening": Population(_in_white(_sharpening)),
    "high-pass": Population(_in_white(_high_pass), 20_000),
    "notch": Population(_in_white(_notch)),
}
