"""The oracle's supervisor: its rules, one by one, and what lanes do under it; the native one follows it."""

import math

import numpy as np
import pytest
from fltea.settings.estimator import EstimatorConfig
from hypothesis import given
from hypothesis import strategies as st
from sample_by_sample import (
    BOUND_SAMPLES,
    BOUND_SHARE,
    GOOD,
    LOST_ORDER,
    NativeGyroscope,
    Supervisor,
    Verdict,
    ran_away,
)

AXES = ("gyro_x", "gyro_y", "gyro_z")


def lanes(n: int = 1, **changes: object) -> NativeGyroscope:
    config = EstimatorConfig(window=200, **changes)  # type: ignore[arg-type]
    return NativeGyroscope(AXES[:n], [0.0235] * n, [0.0] * n, 0.01, config)


@pytest.mark.parametrize(
    ("alpha", "f", "state", "lost"),
    [
        (0.3, -1.5, 0.1, False),
        (LOST_ORDER, -1e300, 1e300, False),
        (math.nextafter(LOST_ORDER, 9), -1.5, 0.1, True),
        (-5.1, -1.5, 0.1, True),
        (math.nan, -1.5, 0.1, True),
        (0.3, math.inf, 0.1, True),
        (0.3, -1.5, math.nan, True),
    ],
)
def test_what_is_a_runaway(alpha: float, f: float, state: float, lost: bool) -> None:
    assert ran_away(alpha, f, state) is lost
    verdict = Supervisor().judge(alpha, f, state, state_bound=False)
    assert verdict == (Verdict(False, True, "runaway") if lost else GOOD)


@given(st.lists(st.booleans(), max_size=900))
def test_the_share_of_bounded_samples_decides_and_ends_with_a_restart(bounds: list[bool]) -> None:
    """Against the rule written out: shares over the last samples, entry above, exit at half."""
    supervisor, distrusted = Supervisor(), False
    for k, bound in enumerate(bounds):
        share = sum(bounds[max(0, k - BOUND_SAMPLES + 1) : k + 1]) / BOUND_SAMPLES
        verdict = supervisor.judge(0.3, -1.5, 0.0, state_bound=bound)
        if not distrusted:
            distrusted = share > BOUND_SHARE
            assert verdict == (Verdict(False, False, "bound") if distrusted else GOOD)
        else:
            distrusted = share > BOUND_SHARE / 2
            assert verdict == Verdict(False, not distrusted, None)


def test_a_lane_that_runs_away_is_told_restarted_and_finite_again() -> None:
    estimator = lanes(2, guard="off", variant="triple")
    noise = np.random.default_rng(1).standard_normal((4000, 2)) * 0.153
    noise[:, 1] += 1.0  # an offset that nobody removed
    invalid = []
    for k, y in enumerate(noise):
        estimates = estimator.step(y.tolist())
        assert estimates["gyro_x"].valid
        if not estimates["gyro_y"].valid:
            invalid.append(k)
            assert estimator.lost == {"gyro_y": "runaway"}
            assert math.isnan(estimates["gyro_y"].alpha)
    assert estimator.restarts == {"gyro_x": 0, "gyro_y": len(invalid)}
    assert invalid


def test_a_restarted_lane_is_a_new_lane() -> None:
    estimator, fresh = (lanes(guard="off", variant="triple") for _ in range(2))
    noise = (np.random.default_rng(2).standard_normal(3000) * 0.153 + 1.0).tolist()
    begun = None
    for k, y in enumerate(noise):
        if not estimator.step([y])["gyro_x"].valid:
            begun = k + 1
            break
    assert begun is not None
    for y in noise[begun : begun + 50]:
        assert estimator.step([y]) == fresh.step([y])


def test_a_wrong_r_is_called_not_valid_while_it_lasts() -> None:
    """R is a hundredth of the noise's variance at first: the guard holds the state all the time."""
    estimator = lanes(guard="consistent")
    random = np.random.default_rng(3)
    loud, calm = random.standard_normal(1500) * 3.0, random.standard_normal(1500) * 0.153
    valid = [estimator.step([y])["gyro_x"].valid for y in [*loud.tolist(), *calm.tolist()]]
    assert not any(valid[BOUND_SAMPLES:1500])
    assert all(valid[1500 + BOUND_SAMPLES :])
    assert estimator.restarts["gyro_x"] == 1
    assert "state_bound" not in estimator.interventions["gyro_x"]


def test_missing_samples_are_predicted_and_judged_like_others() -> None:
    estimator = lanes()
    for y in (np.random.default_rng(4).standard_normal(300) * 0.153).tolist():
        estimator.step([y])
    estimate = estimator.step(None)["gyro_x"]
    assert estimate.valid
    assert math.isnan(estimate.innovation_dps)


def test_no_axes_no_work() -> None:
    estimator = lanes(0)
    assert estimator.step([]) == {}
    assert estimator.interventions == {}
