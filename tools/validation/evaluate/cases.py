"""The noises on which the estimators are evaluated: a state x plus white noise v, y = x + v.

Known are the state's α and f, and s2/R: the variance of its steps divided by that of v. All noises have the
power of the paper's gyroscope, since the filter's Q is an absolute number. The noises have unlimited memory.
If the estimator's memory is shorter, the resulting error belongs to the estimator.
"""

import math
from collections.abc import Sequence

import msgspec
import numpy as np
from fltea.noise import spectra as spectrum
from fltea.records.arrays import Array

from tools.validation.evaluate.cramer_rao import LAM, mean
from tools.validation.recursions import FractionalState
from tools.validation.runner import Row

H = 0.01
"""Sampling period [s]."""
POWER = 0.02
"""Variance of y [(deg/s)²]. The axes of the paper's gyroscope have variances of 0.0178 to 0.0235."""
EDGE = 0.95
"""A noise with g = h^α f (h: sampling period) is stationary down to g = -2^α. The cases have |g| of at most
EDGE times 2^α.
"""

ORDERS = (0.2, 0.4, 0.6, 0.8)
PARAMETERS = (-0.3, -1.0, -3.0, -10.0)
STEP_RATIOS = (0.03, 0.3, 3.0, 30.0)
LENGTHS = (3_000, 20_000, 60_000)


class Case(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One noise, given by α, f and s2/R (see the module). All three are None for white noise."""

    alpha: float | None = None
    f: float | None = None
    """Parameter f [s^-α]."""
    step_ratio: float | None = None
    """s2/R: variance of one step of x divided by the variance of the white noise v."""

    @property
    def name(self) -> str:
        """The case as a text for people."""
        if self.alpha is None:
            return "white noise"
        return f"α = {self.alpha:g}, f = {self.f:g}, s2/R = {self.step_ratio:g}"

    @property
    def columns(self) -> Row:
        """Return the columns by which the rows of tables describe the case.

        For white noise, the true parameters are left empty.
        """
        share = {"x_share": self.noise.x_share}
        return {"noise": self.name, **msgspec.structs.asdict(self), **share}

    @property
    def noise(self) -> "Noise":
        """The noise model of the case at the sampling period `H`."""
        if self.alpha is None or self.f is None or self.step_ratio is None:
            return Noise(0.0, 0.0, POWER, 0.0)
        g = spectrum.g_of(self.alpha, self.f, H)
        if not spectrum.stationary(self.alpha, g):
            raise ValueError(f"{self.name} is not stationary")
        gain = float(mean(spectrum.fractional(LAM, self.alpha, g)))
        R = POWER / (1 + self.step_ratio * gain)
        return Noise(g, self.step_ratio * R, R, 1 - R / POWER)


class Noise(msgspec.Struct, frozen=True):
    """The noise model of a case."""

    g: float
    """g = h^α f, where h is the sampling period."""
    s2: float
    """(deg/s)²"""
    R: float
    """(deg/s)²"""
    x_share: float
    """Variance of x as a proportion of the variance of y."""


def grid(orders: Sequence[float], fs: Sequence[float], ratios: Sequence[float]) -> tuple[Case, ...]:
    """Return the test noises.

    They are white noise, and a fractional noise for each combination of parameters that makes it clearly
    stationary.
    """
    inside = [
        (alpha, f) for alpha in orders for f in fs if spectrum.g_of(alpha, f, H) > -EDGE * float(2.0**alpha)
    ]
    return (Case(), *(Case(alpha, f, ratio) for alpha, f in inside for ratio in ratios))


def samples(case: Case, seeds: int, n: int, record: int = 0) -> Array:
    """Draw y for all seeds, as an array (n, seeds).

    The samples of a seed do not depend on the number of seeds.

    `record`: another number gives other samples of the same noise.
    """
    noise, y = case.noise, np.empty((n, seeds))
    state = None if case.alpha is None else FractionalState(case.alpha, noise.g, n)
    for seed in range(seeds):
        rng = np.random.default_rng([seed, record, *_key(case)])
        y[:, seed] = math.sqrt(noise.R) * rng.standard_normal(n)
        if state is not None:
            y[:, seed] += math.sqrt(noise.s2) * state.draw(rng)
    return y


def _key(case: Case) -> tuple[int, ...]:
    """Return the part of a noise's seed that depends on its parameters.

    Each noise has other random numbers. Otherwise noises with similar parameters would have similar errors.
    """
    return tuple(round(1e4 * abs(value or 0.0)) for value in (case.alpha, case.f, case.step_ratio))
