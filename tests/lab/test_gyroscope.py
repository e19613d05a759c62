import math

import numpy as np
import pytest
from fltea.lab.reference.gyroscope import INVALID, AxisEstimate, GyroscopeEstimator
from fltea.settings.estimator import EstimatorConfig, OrderSettings, ParameterSettings, StateSettings

R = 0.0235  # (deg/s)², x axis of section 7.1
AXES = ("x", "y", "z")


def white(shape: int | tuple[int, ...], seed: int = 0, variance: float = R) -> np.ndarray:
    return np.random.default_rng(seed).normal(0, math.sqrt(variance), shape)


def test_permuted_axes_give_permuted_estimates() -> None:
    rows = white((150, 3)) * [1, 1.2, 0.8]
    forward = GyroscopeEstimator(AXES, [R, R, 2 * R], [0, 0.1, 0.2], 0.01)
    backward = GyroscopeEstimator(AXES[::-1], [2 * R, R, R], [0.2, 0.1, 0], 0.01)
    for row in rows:
        assert forward.step(row) == backward.step(row[::-1])


def test_an_axis_depends_on_no_other() -> None:
    y = white(150)
    together = GyroscopeEstimator(("x", "wild"), [R, R], [0, 0], 0.01)
    alone = GyroscopeEstimator(("x",), [R], [0], 0.01)
    for value, wild in zip(y, white(150, 1) + 3, strict=True):
        assert together.step([value, wild])["x"] == alone.step([value])["x"]


def test_the_bias_is_taken_off_first() -> None:
    with_bias = GyroscopeEstimator(("x",), [R], [2.5], 0.01)
    without = GyroscopeEstimator(("x",), [R], [0], 0.01)
    for value in white(150):
        assert with_bias.step([value + 2.5])["x"] == pytest.approx(without.step([value])["x"], rel=1e-6)


def test_a_missing_sample_is_a_prediction() -> None:
    estimator = GyroscopeEstimator(("x",), [R], [0], 0.01)
    before = [estimator.step([value])["x"] for value in white(100)][-1]
    missing = estimator.step(None)["x"]
    assert missing.valid
    assert (missing.alpha, missing.f) == (before.alpha, before.f)
    assert (missing.alpha_std, missing.f_std) == (before.alpha_std, before.f_std)
    assert math.isnan(missing.innovation_dps)
    assert math.isfinite(missing.state_dps)
    assert missing.innovation_std_dps > math.sqrt(R)
    assert estimator.step([0.1])["x"].valid


@pytest.mark.parametrize("bad", [[0.1, math.nan], [math.inf, 0.1], [0.1], [0.1, 0.1, 0.1]])
def test_a_wrong_sample_is_refused_and_leaves_every_axis_as_it_was(bad: list[float]) -> None:
    estimator, twin = (GyroscopeEstimator(("x", "y"), [R, R], [0, 0], 0.01) for _ in range(2))
    for row in white((20, 2)):
        estimator.step(row)
        twin.step(row)
    with pytest.raises(ValueError, match=r"missing sample|expected 2 axes"):
        estimator.step(bad)
    for row in white((20, 2), 1):
        assert estimator.step(row) == twin.step(row)


def test_a_diverged_axis_says_so_and_starts_again() -> None:
    # An offset of 1 deg/s that nobody removed: the printed algorithm does not survive it.
    ys = white(3000) + 1
    estimator = GyroscopeEstimator(("x", "y"), [R, R], [0, 1], 0.01)
    steps = [estimator.step([y, y]) for y in ys]
    lost = [k for k, step in enumerate(steps) if not step["x"].valid]
    assert lost
    assert estimator.restarts == {"x": len(lost), "y": 0}
    assert all(step["y"].valid for step in steps)
    assert all(all(map(math.isnan, steps[k]["x"][:-1])) for k in lost)
    valid = [step["x"] for step in steps if step["x"].valid]
    assert all(map(math.isfinite, (number for estimate in valid for number in estimate)))
    # The sample after the loss is the first of a new estimator.
    k = lost[0] + 1
    assert steps[k]["x"] == GyroscopeEstimator(("x",), [R], [0], 0.01).step([ys[k]])["x"]


def test_an_estimate_that_is_not_finite_is_lost_as_well() -> None:
    estimator = GyroscopeEstimator(("x",), [R], [0], 0.01)
    valid = [estimator.step([y])["x"].valid for y in [0.1, -0.1, 0.2, 1e200, 0.1, -0.1]]
    assert valid.count(False) == 1
    assert not valid[3]
    assert estimator.restarts == {"x": 1}


@pytest.mark.slow
def test_white_noise_with_the_papers_settings_shows_the_papers_figures() -> None:
    # White noise has no order; what the algorithm says of it after 3,000 samples is a property of its own.
    # A prototype found medians of 0.39 and -2.2 over 12 seeds. Five dozens of seeds gave 0.39 to 0.43 and
    # -2.3 to -2.8; single seeds scatter by 0.07 and 1.2. The tolerance covers the dozens twice over.
    seeds = 12
    estimator = GyroscopeEstimator([str(seed) for seed in range(seeds)], [R] * seeds, [0] * seeds, 0.01)
    last: dict[str, AxisEstimate] = {}
    for row in np.transpose([white(3000, seed) for seed in range(seeds)]):
        last = estimator.step(row)
    assert not any(estimator.restarts.values())
    assert np.median([e.alpha for e in last.values()]) == pytest.approx(0.39, abs=0.08)
    assert np.median([e.f for e in last.values()]) == pytest.approx(-2.4, abs=0.8)
    assert np.median([e.alpha_std for e in last.values()]) < 0.1


def test_settings_reach_their_filters() -> None:
    held = EstimatorConfig(
        window=7,
        state=StateSettings(P0=1, Q=2, x0=3),
        order=OrderSettings(P0=0, Q0=0, alpha0=0, delta=0),
        parameter=ParameterSettings(P0=0, Q0=0, f0=0.5, delta=0),
    )
    # Order 0: x̃ = 0.5 * 3, P̃ = 0.25 * 1 + 2 = 2.25, S = 2.25 + 0.25.
    step = GyroscopeEstimator(("x",), [0.25], [1], 0.01, held).step([4])["x"]
    assert step == pytest.approx(AxisEstimate(0, 0, 0.5, 0, 1.5 + 0.9 * 1.5, 1.5, math.sqrt(2.5), True))


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ((("x", "x"), [R, R], [0, 0], 0.01), "different names"),
        ((("x",), [R, R], [0], 0.01), "as many R and bias"),
        ((("x",), [0], [0], 0.01), "R of x"),
        ((("x",), [math.nan], [0], 0.01), "R of x"),
        ((("x",), [R], [math.inf], 0.01), "bias must be finite"),
        ((("x",), [R], [0], 0), "h is the sampling time"),
        ((("x",), [R], [0], 0.01, EstimatorConfig(order=OrderSettings(alpha0=6))), "alpha0 must lie"),
    ],
)
def test_wrong_arguments_are_named(arguments: tuple, text: str) -> None:
    with pytest.raises(ValueError, match=text):
        GyroscopeEstimator(*arguments)


def test_invalid_is_all_nan() -> None:
    assert not INVALID.valid
    assert all(map(math.isnan, INVALID[:-1]))
