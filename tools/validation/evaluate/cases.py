"""The noises on which the estimators are judged: y = x + v of known α, f and s2/R (pure).

All have the same power, that of the paper's gyroscope, since the filter's Q is an absolute number. Memory is
unlimited: how far back the noise remembers is its own matter, and a shorter window of the estimator is an
error that its user has too.
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
"""Sampling period in s."""
POWER = 0.02
"""Variance of y, (deg/s)²: the paper's gyroscope has 0.0178 to 0.0235."""
EDGE = 0.95
"""Cases lie within this share of the stationary region."""

ORDERS = (0.2, 0.4, 0.6, 0.8)
PARAMETERS = (-0.3, -1.0, -3.0, -10.0)
STEP_RATIOS = (0.03, 0.3, 3.0, 30.0)
LENGTHS = (3_000, 20_000, 60_000)


class Case(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One noise; α, f and s2/R, or None all three for white noise."""

    alpha: float | None = None
    f: float | None = None
    """in s^-α"""
    step_ratio: float | None = None
    """s2/R: variance of a whole step of x over that of the white v"""

    @property
    def name(self) -> str:
        """In words."""
        if self.alpha is None:
            return "white noise"
        return f"α = {self.alpha:g}, f = {self.f:g}, s2/R = {self.step_ratio:g}"

    @property
    def columns(self) -> Row:
        """What the rows of a table have of it; nothing stands for its truth if it is white."""
        share = {"x_share": self.noise.x_share}
        return {"noise": self.name, **msgspec.structs.asdict(self), **share}

    @property
    def noise(self) -> "Noise":
        """Its model at a sampling period of `H`."""
        if self.alpha is None or self.f is None or self.step_ratio is None:
            return Noise(0.0, 0.0, POWER, 0.0)
        g = spectrum.g_of(self.alpha, self.f, H)
        if not spectrum.stationary(self.alpha, g):
            raise ValueError(f"{self.name} is not stationary")
        gain = float(mean(spectrum.fractional(LAM, self.alpha, g)))
        R = POWER / (1 + self.step_ratio * gain)
        return Noise(g, self.step_ratio * R, R, 1 - R / POWER)


class Noise(msgspec.Struct, frozen=True):
    """What follows from a case."""

    g: float
    """h^α f"""
    s2: float
    """(deg/s)²"""
    R: float
    """(deg/s)²"""
    x_share: float
    """of the power of y"""


def grid(orders: Sequence[float], fs: Sequence[float], ratios: Sequence[float]) -> tuple[Case, ...]:
    """White noise, and all combinations that are stationary, and not barely so."""
    inside = [
        (alpha, f) for alpha in orders for f in fs if spectrum.g_of(alpha, f, H) > -EDGE * float(2.0**alpha)
    ]
    return (Case(), *(Case(alpha, f, ratio) for alpha, f in inside for ratio in ratios))


def samples(case: Case, seeds: int, n: int, record: int = 0) -> Array:
    """Draw y of all seeds, (n, seeds); the samples of a seed do not depend on how many there are.

    record: another number gives other samples of the same noise.
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
    """A seed for each noise, so that errors of neighbours on the map are independent."""
    return tuple(round(1e4 * abs(value or 0.0)) for value in (case.alpha, case.f, case.step_ratio))
