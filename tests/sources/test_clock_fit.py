"""Compares the clock fit with a plain least-squares fit by numpy."""

import math

import numpy as np
import pytest
from fltea import _native
from fltea.sources.clock_fit import fit_clock
from hypothesis import given
from hypothesis import strategies as st


@given(st.integers(0, 1 << 32), st.integers(3, 60), st.floats(-1e-2, 1e-2))
def test_it_is_the_line_of_least_squares(seed: int, arrivals: int, slope: float) -> None:
    rng = np.random.default_rng(seed)
    device = np.arange(arrivals) + rng.uniform(0, 0.9, arrivals)
    delay = 0.002 + slope * device + rng.exponential(1e-3, arrivals)
    found = fit_clock(device.tolist(), delay.tolist())
    (expected, offset), covariance = np.polyfit(device, delay, 1, cov="unscaled")
    left = delay - expected * device - offset
    std = math.sqrt(covariance[0, 0] * float(left @ left) / (arrivals - 2))
    assert found.slope == pytest.approx(expected, rel=1e-9, abs=1e-12)
    assert found.slope_std == pytest.approx(std, rel=1e-6)
    assert found.at(2.5) == pytest.approx(expected * 2.5 + offset, rel=1e-9, abs=1e-12)


def test_two_arrivals_give_a_line_without_an_error() -> None:
    found = fit_clock([0.0, 2.0], [1.0, 2.0])
    assert (found.slope, found.slope_std, found.at(4.0)) == (0.5, math.inf, 3.0)


@pytest.mark.parametrize(("device", "delay"), [([], []), ([1.0], [1.0]), ([1.0, 2.0], [1.0])])
def test_fewer_are_refused(device: list[float], delay: list[float]) -> None:
    with pytest.raises(ValueError, match="two arrivals"):
        fit_clock(device, delay)


def test_the_clock_of_live_samples_is_this_fit() -> None:
    """`Timebase` assumes beforehand that both clocks run almost equally fast. This has no visible effect
    here, since the arrivals are exact.
    """
    seq = list(range(6001))
    device_us = [10_000 * one for one in seq]
    host_ns = [round(10_000_000 * 1.0001 * one) + 5_000 for one in seq]
    timebase = _native.Timebase(0)
    timebase.add(seq, device_us, host_ns)
    ends = [one for one in seq if one % 100 == 0][:-1]
    delays = [host_ns[one] * 1e-9 - device_us[one] * 1e-6 for one in ends]
    fit = fit_clock([device_us[one] * 1e-6 for one in ends], delays)
    assert timebase.clock_ppm == pytest.approx((1 / (1 + fit.slope) - 1) * 1e6, rel=1e-3)
