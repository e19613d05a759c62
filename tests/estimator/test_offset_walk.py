"""Tests of the random walk of the offset, which the tracker adds to the noise that the spectrum shows. The
walk makes the interval of the heading wider.
"""

import math

import numpy as np
import pytest
from fltea.estimator.offset_walk import system_of
from fltea.estimator.tracker import Tracker
from fltea.noise.heading import ahead, heading_std, rested
from fltea.noise.linear_system import System
from fltea.noise.parts import Part, Relaxation, Walk, White
from fltea.noise.system import system
from fltea.records.arrays import Array
from fltea.spectrum.drift_rate import drift_rate
from scipy.signal import lfilter

H, N, R = 0.01, 60_000, 0.01
WHITE = White(R)


def noise(seed: int, n: int = N) -> Array:
    return np.random.default_rng(seed).normal(3.0, math.sqrt(R), n)


def relaxing(seed: int, sigma: float, tau_s: float, n: int = N) -> Array:
    a = math.exp(-H / tau_s)
    driven = np.random.default_rng((seed, 1)).normal(0, sigma * math.sqrt(1 - a * a), n + 20_000)
    return np.asarray(lfilter([1.0], [1.0, -a], driven)[20_000:])


def found_in(y: Array, *parts: Part) -> System:
    tracker = Tracker([None])
    tracker.run(y[:, None])
    return system_of(parts, H, len(y), tracker.remembered(0))[0]


def predicted(s: System, y: Array, t_s: float) -> tuple[float, float]:
    """Return the heading error that the state-space model `s` predicts for `t_s` seconds after the samples y,
    and the standard deviation of this prediction.
    """
    tracker = Tracker([None])
    tracker.set(0, s)
    tracker.run(y[:, None])
    origin, x = tracker.x(0)
    at = ahead(s, H, t_s)
    return float(at.row @ x) + origin * t_s, at.std(rested(s, len(y)))


def width(s: System, t_s: float, *truth: Part) -> float:
    """Return the ratio of two σ of the heading after `t_s` seconds: the one by the state-space model `s`, and
    the one by a filter that knows the true noise.
    """
    known = system(truth, H, N)
    known = known if known.walks else known.with_offset()
    return heading_std(s, rested(s, N), H, t_s) / heading_std(known, rested(known, N), H, t_s)


@pytest.mark.parametrize("seed", range(4))
def test_a_ramp_goes_on_within_its_band(seed: int) -> None:
    slope = 0.05 / 600
    y = noise(seed) + slope * H * np.arange(N)
    heading, std = predicted(found_in(y, WHITE), y, 300.0)
    seen = 300 * (3.0 + slope * (N * H + 150))
    assert abs(heading - seen) < 2.6 * std
    # the σ is small compared with 4.3 deg, by which the ramp of the offset changes the heading
    assert std < 1.0


def test_the_slope_is_that_of_the_verdict_with_its_interval() -> None:
    y = noise(5) + 0.05 / 600 * H * np.arange(N)
    s = found_in(y, WHITE)
    verdict = drift_rate(y, H, lambda lam: np.full(len(lam), R))
    tracker = Tracker([None])
    tracker.set(0, s)
    tracker.run(y[:, None])
    ramp = len(s.a) - 1
    per_s = math.log(s.a[ramp]) / H
    slope, P = per_s * float(tracker.x(0)[1][ramp]), rested(s, N)
    assert verdict.value is not None
    assert verdict.low is not None
    assert verdict.high is not None
    assert slope == pytest.approx(verdict.value, rel=0.03)
    half = 1.96 * abs(per_s) * math.sqrt(P[ramp, ramp])
    # The tracker's interval of the slope of the drift is wider than that of the verdict, since for the
    # tracker the offset may also do a random walk.
    assert 1 <= half / ((verdict.high - verdict.low) / 2) < 1.3


def test_an_offset_that_stays_has_no_slope_and_hardly_a_wider_band() -> None:
    widths = [width(found_in(noise(seed), WHITE), 300.0, WHITE) for seed in range(8)]
    assert np.median(widths) < 1.3


@pytest.mark.parametrize("seed", range(3))
def test_a_walk_of_the_spectrum_may_have_bounds(seed: int) -> None:
    """In a record of ten minutes, the spectrum of a relaxation with the correlation time 10 s may look like
    that of a random walk.
    """
    y = noise(seed) + relaxing(seed, 0.05, 10.0)
    s = found_in(y, WHITE, Walk(0.05 * math.sqrt(2 / 10)))
    assert not s.walks
    assert width(s, 300.0, WHITE, Relaxation(0.05, 10.0)) < 2.0


def test_a_relaxation_of_the_spectrum_may_be_a_walk() -> None:
    """In a record of ten minutes, the spectrum of a random walk may look like that of a relaxation with the
    correlation time 9 s, and the reverse.
    """
    walking = noise(1) + np.cumsum(np.random.default_rng(2).normal(0, 2e-3, N))
    for parts in ([WHITE, Relaxation(0.047, 9.4)], [WHITE, Relaxation(0.06, 20.0)]):
        s = found_in(walking, *parts)
        assert s.walks
        assert width(s, 300.0, WHITE, Walk(0.02)) == pytest.approx(1, abs=0.3)
    bounded = noise(3) + relaxing(3, 0.05, 8.0)
    s = found_in(bounded, WHITE, Relaxation(0.05, 8.0))
    assert width(s, 300.0, WHITE, Relaxation(0.05, 8.0)) < 1.7


def test_a_walk_has_none() -> None:
    y = noise(1) + np.cumsum(np.random.default_rng(2).normal(0, 3e-4, N))
    s = found_in(y, WHITE, Walk(3e-3))
    assert s.walks
    assert width(s, 300.0, WHITE, Walk(3e-3)) == pytest.approx(1, abs=0.25)


def test_a_line_is_straight_and_says_nothing_of_the_constant() -> None:
    s, slope = system([WHITE], H, N).with_offset().with_ramp(1e-5, N), 1e-5
    assert s.c @ s.P0 @ s.c == pytest.approx(s.P0[0, 0] - s.P0[1, 1], rel=1e-9)
    x = math.sqrt(s.P0[1, 1]) * np.array([-1.0, 1.0])
    line = np.array([s.c @ (s.a**k * x) for k in (0, N // 2, N)])
    assert line[0] == pytest.approx(0, abs=1e-6)
    assert np.abs(line[1:]) == pytest.approx([slope * N / 2, slope * N], rel=0.01)
    np.testing.assert_array_equal(s.bias, [1.0, 1.0])
    np.testing.assert_array_equal(s.signal, [0.0, 0.0])
    with pytest.raises(ValueError, match="only an offset"):
        system([WHITE, Relaxation(0.1, 1.0)], H, N).with_ramp(1e-5, N)
