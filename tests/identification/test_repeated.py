"""Tests that samples that were delivered twice are found.

Such samples are not confused with values that are equal because of rounding, filters or vibration.
"""

import functools

import numpy as np
import pytest
from fltea.identification.repeated import PARTS, repeats
from fltea.records.arrays import Array
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter

from tests.rig.identify_support import H, ar, white


def low_passed(hz: float, n: int, axes: int, seed: int) -> Array:
    """Apply a low-pass with two real poles at `hz` to a series, as a sensor's own filter does."""
    pole = float(np.exp(-2 * np.pi * hz * H))
    y = ar((2 * pole, -(pole**2)), n, axes, seed)
    return y / y.std(axis=1, keepdims=True)


def counted(y: Array, sigma_lsb: float) -> Array:
    return np.rint(y * sigma_lsb + 0.2)


def repeated(y: Array, every: int) -> Array:
    y = y.copy()
    for i in range(every - 1, y.shape[1], every):
        y[:, i] = y[:, i - 1]
    return y


def found(y: Array, count: float | None = 1.0) -> bool:
    result = repeats((axis, count) for axis in y)
    assert 0 <= result.expected <= max(result.same, result.expected) <= result.pairs
    return result.found


NOISES = {
    "white": lambda n, axes, seed: white(n, axes, seed),
    "5 Hz": lambda n, axes, seed: low_passed(5, n, axes, seed),
    "20 Hz": lambda n, axes, seed: low_passed(20, n, axes, seed),
    "AR(.95)": lambda n, axes, seed: ar((0.95,), n, axes, seed) * 0.31,
    "t4": lambda n, axes, seed: np.random.default_rng(seed).standard_t(4, (axes, n)) / 2**0.5,
    "shared": lambda n, axes, seed: (white(n, axes, seed) + white(n, 1, seed + 99)) / 2**0.5,
    "shared, 5 Hz": lambda n, axes, seed: (
        (low_passed(5, n, axes, seed) + low_passed(5, n, 1, seed + 99)) / 2**0.5
    ),
    "wandering": lambda n, axes, seed: white(n, axes, seed) * np.exp(np.sin(np.arange(n) / 3000) / 2),
}


@functools.cache
def noise_of(kind: str, n: int) -> Array:
    """Return three axes for each of five kinds of sensor."""
    return NOISES[kind](n, 15, 1)


@pytest.mark.parametrize("noise", NOISES)
@pytest.mark.parametrize("sigma_lsb", [0.3, 0.5, 0.7, 1.0, 2.0, 5.0])
@pytest.mark.parametrize("axes", [1, 2, 3])
def test_what_was_not_repeated(noise: str, sigma_lsb: float, axes: int) -> None:
    y = counted(noise_of(noise, 20_000), sigma_lsb)
    assert not any(found(y[i : i + axes]) for i in range(0, 15, 3))


@pytest.mark.parametrize("sigma_lsb", [0.3, 0.5, 0.7, 1.0, 2.0, 5.0])
@pytest.mark.parametrize("noise", ["white", "t4", "20 Hz"])
def test_every_tenth_is_found(noise: str, sigma_lsb: float) -> None:
    y = repeated(counted(noise_of(noise, 60_000), sigma_lsb), 10)
    assert all(found(y[i : i + 3]) for i in range(0, 15, 3))


@pytest.mark.parametrize("sigma_lsb", [1.0, 2.0, 5.0])
def test_every_tenth_is_found_on_one_axis_and_on_slow_ones(sigma_lsb: float) -> None:
    assert found(repeated(counted(white(60_000, 1, 1), sigma_lsb), 10))
    assert found(repeated(counted(low_passed(5, 60_000, 3, 2), sigma_lsb), 10))


@pytest.mark.parametrize("held", [2, 3, 10, 30])
def test_a_sensor_that_is_read_too_fast(held: int) -> None:
    y = counted(white(6000, 3, 1), 1.0)
    assert found(np.repeat(y, held, axis=1)[:, :6000])


@pytest.mark.parametrize("spread", [0.1, 0.3, 0.5])
def test_small_steps_with_heavy_tails_are_no_repeats_of_one_axis(spread: float) -> None:
    """In this slow noise with coarse counts, nine in ten samples equal the one before, and some steps are of
    two counts, because of heavy tails. Such samples are not called repeated.
    """
    steps = np.random.default_rng(1).standard_t(5, 300_000) * spread / 1.29
    y = lfilter([1], [1, -0.999], steps)[np.newaxis]
    assert not found(np.rint(y))


def test_numbers_too_small_to_be_squared() -> None:
    y = white(500, 2, 1) * 1e-300
    seen = repeats([(axis, None) for axis in y])
    assert not seen.found


def test_how_many_are_by_chance() -> None:
    y = counted(white(60_000, 3, 1), 1.0)
    by_chance = float(np.prod([(np.unique(a, return_counts=True)[1] ** 2).sum() / 60_000**2 for a in y]))
    clean, tenth = repeats((axis, 1.0) for axis in y), repeats((axis, 1.0) for axis in repeated(y, 10))
    assert clean.same == pytest.approx(by_chance * 60_000, rel=0.1)
    assert tenth.same - tenth.expected == pytest.approx(6000, rel=0.05)
    assert tenth.expected == pytest.approx(0.9 * by_chance * 60_000, rel=0.25)


def test_a_few_of_unrounded_samples() -> None:
    y = white(6000, 3, 1)
    assert not found(y, None)
    y[:, 1000:4001:500] = y[:, 999:4000:500]
    assert found(y, None)
    assert found(y[:1], None)


def test_axes_that_do_not_move_tell_nothing() -> None:
    y = counted(white(6000, 2, 1), 1.0)
    still = np.zeros((1, 6000))
    assert repeats((axis, 1.0) for axis in still) is None
    assert repeats([]) is None
    assert repeats((axis, None) for axis in white(2 * PARTS, 3, 1)) is None
    assert not found(np.concatenate([y, still]))
    assert found(np.concatenate([repeated(y, 5), still]))


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6), st.floats(0.2, 8), st.floats(1e-3, 1e3), st.integers(1, 4))
def test_no_alarm_at_any_scale(seed: int, sigma_lsb: float, scale: float, axes: int) -> None:
    y = counted(white(3000, axes, seed), sigma_lsb)
    result = repeats((axis * scale, scale) for axis in y)
    assert result is None or not result.found
