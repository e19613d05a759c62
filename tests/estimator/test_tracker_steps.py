"""Tests of steps of a bias: how soon they are detected, how the estimate follows them, and what is not a
step.
"""

import math

import numpy as np
import pytest
from fltea.estimator.tracker import EventKind, Tracker, TrackerEvent, TrackerRules
from fltea.noise.linear_system import System
from fltea.records.arrays import Array
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter

from tests.rig.tracker_support import SYSTEMS, kalman, lanes, relaxing, simulated, walk, white

LANES = 24
WHITE = white(1.0).with_offset()


def of(s: System, n: int = LANES, **rules: float) -> Tracker:
    """Return a tracker of `n` axes that uses the state-space model `s` for the noise of each axis."""
    one = Tracker([None] * n, TrackerRules(**rules))  # type: ignore[arg-type]
    for lane in range(n):
        one.set(lane, s)
    return one


def steps(one: Tracker) -> list[TrackerEvent]:
    return [event for event in one.events if event.kind == EventKind.STEP]


@pytest.mark.parametrize("before", [12_000, 100_000])
@pytest.mark.parametrize("size", [1.0, 0.3])
def test_a_step_is_seen_about_as_soon_as_any_test_can_see_it(size: float, before: int) -> None:
    """By Lorden's bound, no test that has one false alarm a week detects a step of size δ in white noise of
    standard deviation σ sooner than after 30 (σ/δ)² samples on average. The tracker may need 1.8 times that.
    """
    rng = np.random.default_rng(1)
    one = of(WHITE)
    one.run(rng.standard_normal((before, LANES)))
    assert not steps(one)
    n, bound = round(300 / size**2), 30 / size**2
    found = one.run(size + rng.standard_normal((n, LANES)))
    seen = {event.axis: event for event in steps(one)}
    assert len(seen) == LANES == len(steps(one))
    delays = sorted(event.row + 1 for event in seen.values())
    assert np.median(delays) < 1.8 * bound
    errors = np.abs(found.bias - size)
    first = [int(np.flatnonzero(lane <= 0.2 * size)[0]) for lane in errors.T]
    assert np.median(first) < 2 * bound
    for event in seen.values():
        assert abs(event.size - size) < 4.5 * event.size_std
        assert event.size_std < 0.5 * size
        assert abs(event.row + 1 - event.ago) < 30 / size**2
    late = errors[n // 2 :] / found.bias_std[n // 2 :]
    assert np.mean(late < 2) > 0.85
    assert late.max() < 5


def test_the_bias_after_a_step_is_that_of_the_samples_since_then() -> None:
    rng = np.random.default_rng(2)
    y = rng.standard_normal((14_000, 1))
    y[12_000:] += 1.5
    one = of(WHITE, 1)
    found = one.run(y)
    (event,) = steps(one)
    since = 14_000 - (event.row + 1 - event.ago)
    assert found.bias[-1, 0] == pytest.approx(y[-since:].mean(), abs=0.01)
    assert found.bias_std[-1, 0] == pytest.approx(1 / math.sqrt(since), rel=0.05)
    # The tracker's σ becomes larger at once, before the estimate has been wrong for long.
    assert found.bias_std[event.row + 1, 0] > 10 * found.bias_std[11_999, 0]


def test_a_system_found_later_knows_of_the_step() -> None:
    rng = np.random.default_rng(3)
    y = rng.standard_normal((30_000, 1))
    y[12_000:] += 1.0
    one = of(WHITE, 1)
    one.run(y[:-1])
    one.set(0, white(1.0).with_offset(1e-9))
    found = one.run(y[-1:])
    assert found.bias[0, 0] == pytest.approx(y[12_000:].mean(), abs=0.01)


NOISES = {
    "white": (WHITE, lambda rng, n: rng.standard_normal(n)),
    "walk": (
        walk(1.0, 4e-4),
        lambda rng, n: rng.standard_normal(n) + np.cumsum(0.02 * rng.standard_normal(n)),
    ),
    "relaxation": (
        relaxing(0.995).with_offset(),
        lambda rng, n: (
            rng.standard_normal(n) + lfilter([math.sqrt(1 - 0.995**2)], [1, -0.995], rng.standard_normal(n))
        ),
    ),
    "walk that nobody knows of": (
        WHITE,
        lambda rng, n: rng.standard_normal(n) + np.cumsum(1e-4 * rng.standard_normal(n)),
    ),
    "a glitch a second": (WHITE, lambda rng, n: rng.standard_normal(n) + 30.0 * (np.arange(n) % 100 == 7)),
    "heavy tails": (WHITE, lambda rng, n: rng.standard_t(4, n) / math.sqrt(2)),
}


@pytest.mark.parametrize("name", NOISES)
def test_there_are_no_false_steps(name: str) -> None:
    """For each kind of noise, this test processes half an hour of six axes, which is three hours of one axis.

    All six kinds of noise make 18 hours, about a tenth of a week. So if an axis had one false step a week,
    one in ten runs of these tests would show it.
    """
    s, noise = NOISES[name]
    rng = np.random.default_rng(4)
    y = np.stack([noise(rng, 180_000) for _ in range(6)], axis=1)
    one = of(s, 6)
    found = one.run(y)
    assert len(steps(one)) == 0
    assert not found.moving.any()


def test_a_drift_is_no_step_and_its_error_is_in_the_deviation() -> None:
    n = 100_000
    y = np.random.default_rng(5).standard_normal((n, 6)) + 2e-5 * np.arange(n)[:, None]
    one = of(WHITE, 6)
    found = one.run(y)
    assert len(steps(one)) <= 6
    off = np.abs(found.bias - 2e-5 * np.arange(n)[:, None]) / found.bias_std
    assert np.mean(off[20_000:] < 3) > 0.9


def test_what_grows_beyond_a_step_is_motion_and_what_it_taught_is_undone() -> None:
    """A turn of the sensor that begins slowly first looks like a series of steps of the bias."""
    rng = np.random.default_rng(6)
    turn = np.zeros(20_000)
    turn[12_000:14_000] = 100 * np.sin(np.pi * np.arange(2000) / 2000)
    y = rng.standard_normal((20_000, 3))
    clean = of(WHITE, 3, largest_step=20.0).run(y)
    y[:, 2] += turn
    one = of(WHITE, 3, largest_step=20.0)
    found = one.run(y)
    assert found.moving[12_400:13_900].all()
    assert not found.moving[14_200:].any()
    assert one.figures()[2].steps == 0
    off = np.abs(found.bias - clean.bias) / clean.bias_std
    assert off[14_200:].max() < 3
    assert off[12_500:13_900].max() < 3


@pytest.mark.parametrize("level", [100.0, -100.0])
def test_a_constant_turn_is_motion_of_all_axes_until_it_ends(level: float) -> None:
    rng = np.random.default_rng(7)
    y = rng.standard_normal((20_000, 3))
    y[12_000:15_000] += [0.005 * level, -0.005 * level, level]
    one = of(WHITE, 3, largest_step=20.0, settles=False)
    found = one.run(y)
    assert found.moving[12_032:15_000].all()
    assert not found.moving[15_100:].any()
    assert np.abs(found.bias[12_100:] / found.bias_std[12_100:]).max() < 4
    begins, ends = one.events
    assert (begins.kind, ends.kind) == (EventKind.MOVES, EventKind.RESTS)
    assert begins.axis == ends.axis == 2
    assert abs(ends.samples - 3000) < 160
    assert ends.size == pytest.approx(100, abs=5)


def test_a_turn_that_the_record_begins_with_is_over_when_the_rate_is_nearer_to_zero() -> None:
    y = np.random.default_rng(8).standard_normal((20_000, 1))
    y[:8000] += 100
    one = of(WHITE, 1, largest_step=20.0, settles=False)
    found = one.run(y)
    assert one.figures()[0].begun == 1
    assert abs(found.bias[-1, 0]) < 4 * found.bias_std[-1, 0]


def test_the_accelerometer_shows_motion_that_the_gyroscope_does_not() -> None:
    rng = np.random.default_rng(9)
    y, accel = rng.standard_normal((12_000, 3)), 0.02 * rng.standard_normal((12_000, 3)) + [0, 0, 9.81]
    accel[6000:7000, 0] += np.linspace(0, 5, 1000)  # the sensor is tilted slowly
    accel[7000:, 0] += 5
    one = of(WHITE, 3)
    found = one.run(y, accel)
    assert found.moving[6100:6990].all()
    assert not found.moving[:6000].any()
    assert not found.moving[7100:].any()
    assert {event.axis for event in one.events} == {-1}


@settings(max_examples=20)
@given(cuts=st.lists(st.integers(0, 6000), max_size=6), saved=st.integers(0, 6000))
def test_cuts_and_snapshots_change_nothing(cuts: list[int], saved: int) -> None:
    y, accel = eventful()
    rules = TrackerRules(ahead=100, checked=(100, 1000), largest_step=20.0)
    whole, cut = Tracker([None, None], rules), Tracker([None, None], rules)
    for one in (whole, cut):
        one.set(1, SYSTEMS["relaxation"])
    expected, told = lanes(whole.run(y, accel)), [*whole.events]
    found, events, low = [], [], 0
    for high in sorted({*cuts, saved, 6000}):
        found.append(lanes(cut.run(y[low:high], accel[low:high])))
        events += [event._replace(row=event.row + low) for event in cut.events]
        if high == saved:
            again = Tracker([None, None], rules)
            again.load(cut.save())
            cut = again
        low = high
    np.testing.assert_array_equal(np.concatenate(found, 1), expected)
    assert events == told
    assert {event.kind for event in told} == set(EventKind)
    assert cut.save() == whole.save()


def eventful() -> tuple[Array, Array]:
    """Return samples of two axes and an accelerometer with steps, a turn and a tilt."""
    rng = np.random.default_rng(10)
    y = rng.standard_normal((6000, 2))
    y[1500:, 1] += 8
    y[2500:2900, 0] += 100 * np.sin(np.arange(400) / 30)
    y[4200:, 1] -= 9
    accel = 0.02 * rng.standard_normal((6000, 3))
    accel[5000:5200] += np.linspace(0, 3, 200)[:, None]
    accel[5200:] += 3
    return y, accel


@pytest.mark.parametrize("name", ["relaxation", "walking offset", "order", "low-pass"])
def test_the_bias_is_the_mean_of_what_comes(name: str) -> None:
    """The tracker's bias is the mean of the next samples, as a Kalman filter in numpy predicts it."""
    s, ahead = SYSTEMS[name], 50
    y, _ = simulated(s, 500, 1)
    y[0] = 0
    one = Tracker([None], TrackerRules(ahead=ahead))
    one.set(0, s)
    found = one.run(y[:, None])
    x, P, A = np.zeros(len(s.a)), s.P0.copy(), s.A
    for value in y:
        e, S = value - s.c @ x, s.c @ P @ s.c + s.R
        x, P = x + P @ s.c / S * e, P - np.outer(P @ s.c, P @ s.c) / S
        last, covariance = x, P
        x, P = A @ x, A @ P @ A.T + s.Q
    powers = [np.linalg.matrix_power(A, k) for k in range(ahead + 1)]
    sums = np.cumsum(powers[:ahead], axis=0)  # element k: A^0 + … + A^k, with the transition A
    row = s.bias @ sum(powers[1:]) / ahead
    added = sum(s.bias @ one_sum @ s.Q @ one_sum.T @ s.bias for one_sum in sums) / ahead**2
    assert found.bias[-1, 0] == pytest.approx(row @ last, rel=1e-6, abs=1e-9)
    assert found.bias_std[-1, 0] == pytest.approx(math.sqrt(row @ covariance @ row + added), rel=1e-6)
    assert kalman(s, y)["bias"][-1] != pytest.approx(found.bias[-1, 0], rel=1e-6) or name == "walking offset"


@pytest.mark.parametrize("name", ["white", "walking offset", "relaxation", "order", "low-pass"])
def test_the_check_of_the_bias_holds_for_the_right_noise_and_fails_for_another(name: str) -> None:
    s = SYSTEMS[name]
    y, _ = simulated(s, 60_000, 11)
    right, wrong = (Tracker([None], TrackerRules(ahead=100, checked=(100, 1000))) for _ in range(2))
    right.set(0, s)
    wrong.set(0, s._replace(Q=s.Q / 9, R=s.R / 9, P0=s.P0 / 9))
    for one in (right, wrong):
        one.run(y[:, None])
    for short, long in zip(right.figures()[0].checked, wrong.figures()[0].checked, strict=True):
        assert short.rms == pytest.approx(1, abs=4 / math.sqrt(2 * short.pieces))
        assert long.rms is not None
        assert long.rms > 2
