"""Random noises with and without an order, on which the odds of an order are calibrated and validated.

All noises include white noise of variance 1. Relaxations (first-order Gauss-Markov processes) have random or
regular corner frequencies. Random corners have at least ten periods in the record and are at most about a
third of the sample rate; their logarithms are uniformly distributed. Each regular corner is the one before
times a fixed factor, and the densities of these relaxations fall about as that of 1/f noise. None of these
noises is in the gallery.
"""

import math
from collections.abc import Callable

import numpy as np
from fltea.records.arrays import Array

from tools.validation.evaluate.composites import mixture
from tools.validation.gallery.parts import Fractional, Part, Relaxation, White

RATE_HZ = 100.0
ORDERS, STEP_RATIOS = (0.2, 0.85), (-1.0, 1.0)
"""ORDERS: range of α, which is uniformly distributed. STEP_RATIOS: range of log10(s2/R), also uniform, where
s2 is the variance of the state's steps and R that of the white noise.
"""
LEAST_F = -0.5
"""The state is D^α x = f x + ω. Let g = h^α f, where h is the sampling period. F = g + α is uniformly
distributed between LEAST_F and α. At F = α, f is 0: nothing draws the state back to 0.
"""
PERIODS, FASTEST_HZ = 10, 30.0
DENSITIES = (-0.5, 2.0)
"""Range of log10 of the ratio of a relaxation's density to that of the white noise."""
MOST_RANDOM, MOST_REGULAR = 4, 5
STEPS, SLOPES, LEVELS = (0.5, 1.2), (0.6, 1.4), (-0.5, 1.5)
"""Ranges for regular relaxations.

The density of a relaxation with the corner c is about 10^level c^-slope [c in Hz]. STEPS: distance between
corners [decades]. SLOPES: values of slope. LEVELS: values of level.
"""
SCATTER = 0.1
"""Standard deviation with which log10 of the densities of regular relaxations scatters about a straight line.
"""

Draw = Callable[[np.random.Generator, int], tuple[Part, ...]]


def order(rng: np.random.Generator, n: int) -> tuple[Part, ...]:
    """Return noise of fractional order in white noise.

    The weight of a sample in the next one, F = h^α f + α (h: sampling period), may be positive or negative.
    """
    alpha = float(rng.uniform(*ORDERS))
    g = float(rng.uniform(LEAST_F, alpha)) - alpha
    ratio = float(10 ** rng.uniform(*STEP_RATIOS))
    return White(), Fractional(alpha, g * RATE_HZ**alpha, ratio)


def random_sum(rng: np.random.Generator, n: int) -> tuple[Part, ...]:
    """Return one to four relaxations with random corners, in white noise."""
    low = math.log(_slowest_hz(n))
    return (
        White(),
        *(
            Relaxation(
                float(np.exp(rng.uniform(low, math.log(FASTEST_HZ)))), float(10 ** rng.uniform(*DENSITIES))
            )
            for _ in range(rng.integers(1, MOST_RANDOM + 1))
        ),
    )


def regular_sum(rng: np.random.Generator, n: int) -> tuple[Part, ...]:
    """Return two to five relaxations that resemble 1/f noise, in white noise."""
    count, step = int(rng.integers(2, MOST_REGULAR + 1)), float(rng.uniform(*STEPS))
    first = float(rng.uniform(math.log10(_slowest_hz(n)) - 0.3, math.log10(FASTEST_HZ) - 0.3 - step))
    slope, level = float(rng.uniform(*SLOPES)), float(rng.uniform(*LEVELS))
    corners = [10 ** (first + k * step) for k in range(count)]
    return (
        White(),
        *(
            Relaxation(corner, 10 ** (level + SCATTER * rng.standard_normal()) * corner**-slope)
            for corner in corners
            if corner < FASTEST_HZ
        ),
    )


def sum_and_rise(rng: np.random.Generator, n: int) -> tuple[Part, ...]:
    """Return one to three relaxations and a part that rises with frequency."""
    return mixture(rng)


POPULATIONS: dict[str, tuple[Draw, float]] = {
    "order": (order, 0.5),
    "random sum": (random_sum, 0.25),
    "regular sum": (regular_sum, 0.125),
    "sum and rise": (sum_and_rise, 0.125),
}
"""For each population: the function that draws its noises, and its weight among all noises.

Noises with and without an order have the same total weight.
"""


def drawn(parts: tuple[Part, ...], n: int, rng: np.random.Generator) -> Array:
    """Return `n` samples of a noise."""
    return np.asarray(sum(part.draw(n, RATE_HZ, rng) for part in parts))


def _slowest_hz(n: int) -> float:
    return PERIODS * RATE_HZ / n
