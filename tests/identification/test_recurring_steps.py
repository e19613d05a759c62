"""Tests that recurring steps of the bias are included in the heading's forecast and in the filter of the
exported file.
"""

import math

import fltea
import numpy as np
import pytest
from fltea.records.arrays import Array


def telegraph(rng: np.random.Generator, n: int, level: float, dwell: int) -> Array:
    flips = rng.random(n) < 1 / dwell
    return np.asarray(level * np.where(np.cumsum(flips) % 2, 1.0, -1.0))


@pytest.mark.parametrize("seed", [40, 42, 44])
def test_the_heading_of_popcorn_noise_has_its_jumps(seed: int) -> None:
    rng, n = np.random.default_rng(seed), 60_000
    y = telegraph(rng, n, 0.1, 2000) + rng.normal(0, 0.1, n)
    found = fltea.identify(y, rate_hz=100.0, unit="deg/s", forecast=True)
    assert found.now is not None
    # Telegraph noise jumps between two levels, here with σ = 0.1 and the correlation time τ = 10 s. If the
    # present level is known, the standard deviation of the heading after a time t is at most σ √(2 τ t).
    most = 0.1 * math.sqrt(2 * 10 * 60)
    assert 0.4 * most < found.now.heading_std < 2 * most


def test_a_step_or_two_leave_the_heading_as_it_is() -> None:
    rng, n = np.random.default_rng(1), 60_000
    y = rng.normal(0, 0.1, n)
    y[20_000:] += 0.1
    found = fltea.identify(y, rate_hz=100.0, unit="deg/s", forecast=True)
    assert len(found.bias_steps) == 1
    assert found.now is not None
    assert found.now.heading_std < 0.3
