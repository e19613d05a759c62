"""Tests of the tracker when a sensor moves, changes its offset or rounds samples, or when a fit finds another
noise.
"""

import math
from typing import Any

import numpy as np
import pytest
from fltea.estimator.tracker import EventKind, Tracker, Tracks
from fltea.noise.filters import Sharpening
from fltea.noise.linear_system import System
from fltea.noise.parts import Order, Resonance, White
from fltea.noise.system import system
from fltea.records.arrays import Array
from scipy.signal import butter, lfilter

from tests.rig.tiers import slow
from tests.rig.tracker_support import SYSTEMS, H, fixed, kalman, of, run, simulated, tracker, walk, white

N, AT = 12_000, 4000
RESONANT = of(Resonance(5.0, 20.0, 1.0))
KINDS = [None, "white", "walk", "relaxation", "order", "low-pass", "quantisation, walk"]
kinds = pytest.mark.parametrize("name", KINDS, ids=str)


def measured(name: str | None) -> tuple[Array, float]:
    """Return samples of noise around a bias of 3, and the standard deviation of the noise."""
    y, _ = simulated(SYSTEMS[name or "walk"], N, 5)
    return y + 3, float(y.std())


def made(name: str | None, **rules: Any) -> Tracker:
    return tracker(SYSTEMS[name] if name else None, **rules)


def apart(found: Tracks, clean: Tracks) -> Array:
    """Return the difference between the biases of two trackers, divided by the σ of the second tracker."""
    return np.abs(found.bias - clean.bias) / clean.bias_std


@kinds
def test_it_predicts_while_the_sensor_turns(name: str | None) -> None:
    y, level = measured(name)
    clean = run(made(name), y)
    turned = y.copy()
    turned[AT : AT + 300] += 50 * level * np.sin(np.arange(300) / 30)
    one = made(name, largest_step=10 * level)
    found = run(one, turned)
    assert not clean.moving.any()
    moving = np.flatnonzero(found.moving)
    assert AT <= moving[0] <= AT + 64
    assert AT + 300 <= moving[-1] <= AT + 400
    assert found.moving.sum() == one.figures()[0].moved == moving[-1] - moving[0] + 1
    # What the tracker learned from samples of the turn before it was detected is undone. The bias continues
    # from before the turn.
    still = slice(moving[0] + 1, moving[-1])
    before, during = found.bias_std[AT - 10], found.bias_std[still]
    assert np.all(np.diff(during) >= -1e-12)
    if name not in (None, "walk", "quantisation, walk"):
        assert np.ptp(found.bias[moving[-1] - 100 : moving[-1]]) < 0.5 * before
    else:
        assert np.ptp(found.bias[still]) < 1e-12
        assert during[-1] > 1.5 * before
    assert apart(found, clean)[AT + 1000 :].max() < 1
    np.testing.assert_allclose(found.bias_std[-1], clean.bias_std[-1], rtol=0.05)
    assert one.figures()[0].begun == 0


@pytest.mark.parametrize("hz", [0.3, 12.0, 40.0])
def test_a_line_that_the_system_leaves_out_is_no_motion_and_hides_none(hz: float) -> None:
    rng, t = np.random.default_rng(6), np.arange(N) / 100
    y = rng.standard_normal(N) + 30 * np.sin(2 * np.pi * hz * t)
    one = tracker(None, largest_step=60.0)
    one.run(y[:AT, None])
    one.set(0, SYSTEMS["white"])
    assert not one.run(y[AT : AT + 4000, None]).moving.any()
    assert not one.events
    turned = y[AT + 4000 :, None].copy()
    turned[1000:2000, 0] += 450 * np.sin(np.arange(1000) / 80)
    moving = one.run(turned).moving[:, 0]
    assert moving[1000:2000].mean() > 0.9
    assert not np.delete(moving, np.s_[1000:2100]).any()


@kinds
def test_a_knock_and_a_spike_leave_nothing_behind(name: str | None) -> None:
    y, level = measured(name)
    clean = run(made(name), y)
    for size, length in ((1000, 1), (40, 12)):
        knocked, one = y.copy(), made(name)
        knocked[AT : AT + length] += size * level * np.random.default_rng(8).standard_normal(length)
        found = run(one, knocked)
        assert 1 <= found.moving.sum() <= 128
        assert apart(found, clean)[AT + 500 :].max() < 1
        assert one.figures()[0].begun == 0


def test_what_was_known_when_motion_began_is_known_in_it() -> None:
    y = np.random.default_rng(2).standard_normal(700)
    y[600] = 1000
    found = run(made("white"), y)
    assert found.moving[600]
    # After a disturbance, the tracker computes the covariance of its state anew, but not its Kalman gains.
    np.testing.assert_allclose(found.bias_std[600:650], found.bias_std[599], rtol=0.03)
    assert abs(found.bias[650] - y[:600].mean()) < 0.02


def test_an_outlier_counts_as_six_deviations() -> None:
    y = np.random.default_rng(3).standard_normal(2000)
    clean = run(made("white"), y)
    spiked = y.copy()
    spiked[1000] = 30
    found = run(made("white"), spiked)
    assert not found.moving.any()
    assert 4 / 1300 < (found.bias - clean.bias)[1001] < 9 / 1000


@kinds
@pytest.mark.parametrize("settles", [True, False])
def test_where_the_offset_is_too_far_for_a_step_it_begins_again_if_that_can_be(
    name: str | None, settles: bool
) -> None:
    y, level = measured(name)
    clean = run(made(name), y)
    stepped, one = y.copy(), made(name, largest_step=10 * level, settles=settles, patience=4000)
    stepped[AT:] += 20 * level
    found = run(one, stepped)
    assert one.figures()[0].begun == 1
    assert [event.kind for event in one.events] == [EventKind.MOVES, EventKind.RESTS]
    moving = np.flatnonzero(found.moving)
    begins = 1024 if settles else 4000
    assert begins - 32 <= moving[-1] - AT <= begins + 100
    errors = (found.bias - 20 * level - clean.bias) / found.bias_std
    assert np.abs(errors[AT + 6000 :]).max() < 3


@pytest.mark.parametrize("name", [None, "walk", "white", "low-pass"], ids=str)
def test_heavy_tails_are_no_motion(name: str | None) -> None:
    rng, n = np.random.default_rng(9), 40_000
    state = np.cumsum(rng.standard_normal(n)) * math.sqrt(1e-3)
    if name == "low-pass":
        a = math.exp(-0.02)
        state = lfilter([0.5 * math.sqrt(1 - a * a)], [1, -a], rng.standard_normal(n))
    elif name == "white":
        state = np.zeros(n)
    errors = []
    for v in (rng.standard_normal(n), rng.standard_t(4, n) / math.sqrt(2)):
        noise = lfilter(*butter(2, 0.2), v) if name == "low-pass" else v
        one = made(name)
        found = run(one, state + noise)
        assert found.moving.mean() < 0.01
        assert one.figures()[0].begun == 0
        late = slice(6000, None)
        errors.append(np.sqrt(np.mean((found.bias - state)[late] ** 2)))
        # In white noise, the bias is constant, and its error hardly changes. So nearly all errors, or nearly
        # none, are within 2 σ, and this proportion shows nothing.
        if name != "white":
            assert 0.93 < np.mean(np.abs(found.bias - state)[late] < 2 * found.bias_std[late]) < 0.98
    assert errors[1] < 1.05 * errors[0] or name == "white"
    assert max(errors) < 3 / math.sqrt(6000) or name != "white"


@kinds
@pytest.mark.parametrize("axis", ["constant", "stepping once", "rounded", "rarely another"])
def test_axes_that_hardly_change(name: str | None, axis: str) -> None:
    at = np.arange(3000)
    y = {
        "constant": np.full(3000, 2.5),
        "stepping once": np.where(at < 2000, 2.5, 2.6),
        "rounded": 2.5 + 0.1 * np.round(0.4 * np.random.default_rng(1).standard_normal(3000)),
        "rarely another": 2.5 + 0.1 * (at % 500 == 7),
    }[axis]
    one = made(name)
    found = run(one, y)
    assert one.figures()[0].moved == 0
    # A constant signal has no noise. So without a noise model, the tracker's bank of filters begins at the
    # first change of the signal, and needs 16 samples.
    woken = np.s_[2000:2016] if axis == "stepping once" and name is None else np.s_[:0]
    seen, std = (np.delete(column, woken)[20:] for column in (found.bias, found.bias_std))
    assert np.all(np.isfinite(seen))
    assert seen.min() > 2.38
    assert seen.max() < 2.62
    assert np.all(np.isfinite(std))


def test_an_axis_that_wakes_up_is_at_rest() -> None:
    """In an earlier version, real noise that came after constant samples (without noise) counted as motion
    for ten minutes.
    """
    y = np.zeros(9000)
    y[3000:] = 0.5 + 0.1 * np.random.default_rng(2).standard_normal(6000)
    found = run(tracker(None, largest_step=2.0), y)
    assert not found.moving[3100:].any()
    assert abs(found.bias[-1] - 0.5) < 4 * found.bias_std[-1] < 0.1


@pytest.mark.parametrize("louder", [3.0, 5.0])
def test_noise_that_grows_is_no_step(louder: float) -> None:
    y = np.random.default_rng(3).standard_normal((20_000, 6))
    y[12_000:] *= louder
    one = Tracker([None] * 6)
    for lane in range(6):
        one.set(lane, SYSTEMS["white"])
    one.run(y)
    assert len(one.events) <= 2, one.events


def test_a_step_above_a_small_limit_makes_no_motion_that_flaps() -> None:
    y = 0.1 * np.random.default_rng(4).standard_normal(12_000)
    y[6000:] += 0.1
    one = tracker(white(0.01).with_offset(), largest_step=0.05)
    found = run(one, y)
    assert not found.moving.any()
    assert [event.kind for event in one.events] == [EventKind.STEP]


def test_the_size_of_a_step_without_a_model_is_that_of_the_samples() -> None:
    y = 0.1 * np.random.default_rng(5).standard_normal((12_000, 6))
    y[6000:] += 1.0
    one = Tracker([None] * 6)
    one.run(y)
    steps = [event for event in one.events if event.kind == EventKind.STEP]
    assert len(steps) == 6
    for event in steps:
        assert abs(event.size - 1) < 0.2


def test_of_an_axis_that_never_changes_the_bias_is_the_sample() -> None:
    found = run(Tracker([None]), np.full(100, 2.5))
    assert np.isnan(found.bias[:15]).all()
    np.testing.assert_array_equal(found.bias[15:], 2.5)
    np.testing.assert_array_equal(found.bias_std[15:], 0)


def test_an_offset_that_is_given_is_part_of_the_bias_not_of_the_state() -> None:
    s = walk(1.0, 1e-3)
    y, _ = simulated(s, 2000, 3)
    one, other = Tracker([5.0]), Tracker([0.0])
    for each in (one, other):
        each.set(0, s)
    found, plain = run(one, y + 5), run(other, y)
    np.testing.assert_allclose(found.state, plain.state, atol=1e-9)
    np.testing.assert_allclose(found.bias, plain.bias + 5, atol=1e-9)
    free = Tracker([None])
    free.set(0, s)
    np.testing.assert_allclose(run(free, y + 5).state[1000:], found.bias[1000:], atol=1e-6)


@pytest.mark.parametrize("name", SYSTEMS)
@pytest.mark.parametrize("n", [0, 1, 20, 2000, 2500, 5000, 30_000])
def test_a_system_found_late_is_as_good_as_one_found_before(name: str, n: int) -> None:
    s = SYSTEMS[name]
    y, _ = simulated(s, n + 1, 6)
    late, before = Tracker([0.0 if fixed(s) else None]), tracker(s)
    run(late, y[:-1] + 0.7)
    run(before, y[:-1] + 0.7)
    late.set(0, s)
    found, expected = run(late, y[-1:] + 0.7), run(before, y[-1:] + 0.7)
    assert abs(found.bias - expected.bias)[0] < 0.15 * expected.bias_std[0] + 1e-9
    np.testing.assert_allclose(found.bias_std, expected.bias_std, rtol=0.05)
    np.testing.assert_allclose(found.state_std, expected.state_std, rtol=0.05, atol=1e-9)


@pytest.mark.parametrize("s", [white(1.0).with_offset(), white(1.0).with_offset(1e-10), walk(1.0, 1e-4)])
def test_a_system_found_after_hours(s: System) -> None:
    y = np.random.default_rng(7).standard_normal(10**6) + 0.7
    late, before = Tracker([None]), tracker(s)
    run(late, y)
    run(before, y)
    late.set(0, s)
    found, expected = run(late, np.ones(1)), run(before, np.ones(1))
    assert abs(found.bias - expected.bias)[0] < 0.1 * expected.bias_std[0]
    np.testing.assert_allclose(found.bias_std, expected.bias_std, rtol=0.05)


@pytest.mark.parametrize("name", [slow("white"), slow("order"), "resonance"])
def test_means_of_samples_tell_bounds_of_a_walk_as_the_samples_do(name: str) -> None:
    """Models in which the bias does a random walk, or a walk with bounds (a relaxation), are compared by
    their log likelihoods. The difference of two log likelihoods is about the same for all samples as for the
    means of samples that a tracker remembers.

    The differences are not quite equal, for two reasons. A relaxation changes during the time of one mean.
    Faster parts of the noise are not white in the means.
    """
    bare = {"white": white(1.0), "order": of(Order(0.7, -1.0, 0.3 / H**1.4)), "resonance": RESONANT}[name]
    q, a = 2e-3, math.exp(-1 / 1000)

    def bounded(a: float) -> System:
        return bare.with_relaxation(q / (1 - a * a), a).with_offset()

    y, _ = simulated(bounded(a), 15_000, 11)
    one = Tracker([None])
    run(one, y)
    then = one.remembered(0)
    own = kalman_likelihood(bounded(a), y)
    for other in (bare.with_offset(q), bounded(a**5), bounded(a**0.2)):
        exact = own - kalman_likelihood(other, y)
        of_means = then.likelihood(bounded(a)) - then.likelihood(other)
        assert of_means == pytest.approx(exact, abs=1 + 0.15 * abs(exact))


def test_likelihood_is_that_of_the_innovations() -> None:
    s = SYSTEMS["low-pass"]
    y, _ = simulated(s, 500, 8)
    y[0] = 0
    one = Tracker([None])
    run(one, y)
    exact = kalman_likelihood(s, y)
    then = one.remembered(0)
    run(one, y)
    assert then.likelihood(s) == pytest.approx(exact, rel=1e-6)
    assert then.likelihood(white(float(y.var())).with_offset()) < exact - 50
    assert math.isnan(Tracker([None]).remembered(0).likelihood_of_walks())


def kalman_likelihood(s: System, y: Array) -> float:
    found = kalman(s, y)
    return float(-np.sum(found["innovation"] ** 2 / found["S"] + np.log(found["S"])))


def test_systems_of_which_no_filter_can_be_made_change_nothing() -> None:
    one = tracker(SYSTEMS["walk"])
    run(one, np.arange(100) % 7)
    before, good = one.save(), walk(1.0, 1e-3)
    bad = [
        good._replace(R=0.0),
        good._replace(R=math.nan),
        good._replace(c=np.ones(2)),
        good._replace(Q=np.ones((2, 2))),
        good._replace(pairs=1),
        good._replace(Q=np.full((1, 1), math.nan)),
        good._replace(P0=np.full((1, 1), math.inf)),
        good._replace(a=np.array([math.nan])),
        good._replace(a=np.array([1.5])),
    ]
    many = np.ones(25)
    bad.append(good._replace(a=many, b=0 * many, c=many, signal=many, Q=np.eye(25), P0=np.eye(25)))
    for s in bad:
        with pytest.raises(ValueError, match=r"system|noise model"):
            one.set(0, s)
    with pytest.raises(IndexError):
        one.set(1, good)
    assert one.save() == before


def test_an_order_with_a_slow_pole_pair_behind_a_sharpening_is_filtered_or_refused() -> None:
    """The noise has a fractional order and has passed a filter that changes high frequencies (`Sharpening`).
    For such a noise, the covariance that follows from the means of older samples may be invalid. The tracker
    then ignores these means.

    In an earlier version, it used the invalid covariance, and every bias was NaN.
    """
    parts = [
        White(0.009609324474215877),
        Sharpening(-0.09692657484116714),
        Order(1.1196194747243926, -0.16690594775213122, 0.019831870167406847),
    ]
    y = 0.1 * np.random.default_rng(1).standard_normal(4200)
    for f in (-0.05, -0.16690594775213122, -0.5):
        parts[2] = Order(1.1196194747243926, f, 0.019831870167406847)
        one = Tracker([None])
        run(one, y[:4189])
        one.set(0, system(parts, 0.01, 4189, found=True).with_offset())
        found = run(one, y[4189:])
        assert np.isfinite(found.bias).all()
        assert np.isfinite(found.bias_std).all()
