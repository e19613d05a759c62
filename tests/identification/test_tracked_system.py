"""Tests of whether the offset of an axis does a random walk: it does, it is likely constant, or it cannot be
told.

The answer decides what imu.yaml says about the random walk.
"""

import numpy as np
import pytest
import yaml
from fltea.documents.imu_yaml import imu_yaml
from fltea.identification.axis import IdentifyOptions
from fltea.identification.axis_report import AxisReport
from fltea.identification.forecast_judge import fitted_system
from fltea.identification.kalibr import axis_noise
from fltea.identification.load import GYRO_UNIT, Series
from fltea.identification.navigation_filter import slope_of
from fltea.identification.tracked_system import offset_walk_found
from fltea.noise.parts import White
from fltea.records.arrays import Array
from fltea.records.fit import Interval

from tests.rig.identify_one import identify_series
from tests.rig.identify_support import gauss_markov

H, N = 0.01, 30_000
OPTIONS = IdentifyOptions(shuffles=0)


def walking(share: float, seed: int, n: int = N) -> Array:
    """Return white noise with σ = 0.1 whose offset does a random walk.

    `share`: variance of a step of the walk, in units of the white noise's variance divided by n². It is
    defined in this way in `fltea.estimator.offset_walk`.
    """
    rng = np.random.default_rng((seed, 3))
    return np.asarray(rng.normal(size=n) * 0.1 + np.cumsum(rng.normal(size=n)) * np.sqrt(share) * 0.1 / n)


def report(y: Array) -> AxisReport:
    return identify_series(Series(y, GYRO_UNIT, None), H, OPTIONS, False)


def test_three_answers() -> None:
    """None of the constant offsets is said to do a random walk.

    If no random walk is reported, the report has an upper bound of its K.
    """
    counts = {share: {"walks": 0, "likely constant": 0, "not told": 0} for share in (0.0, 100.0, 3000.0)}
    bounded, told = 0, 0
    for share, count in counts.items():
        K = np.sqrt(share / H) * 0.1 / N
        for seed in range(20):
            found = offset_walk_found(fitted_system([White(0.01)], walking(share, seed), H), H, Interval())
            count[found.said] += 1
            assert (found.K.value is not None) == (found.said == "walks") == (found.at_most is None)
            assert (found.tells_s is not None) == (found.said == "not told")
            assert found.tells_s is None or found.tells_s >= N * H
            bounded += found.at_most is not None and found.at_most >= K
            told += found.at_most is not None
    assert counts[0.0]["walks"] == 0
    assert counts[0.0]["likely constant"] >= 17
    assert counts[100.0]["not told"] >= 2
    assert counts[3000.0]["walks"] >= 18
    assert bounded >= 0.9 * told


@pytest.mark.slow
def test_as_long_a_record_as_is_said_would_tell() -> None:
    not_notified = [
        offset_walk_found(fitted_system([White(0.01)], walking(100.0, k), H), H, Interval())
        for k in range(20)
    ]
    lengths = [found.tells_s for found in not_notified if found.tells_s is not None]
    n = round(float(np.median(lengths)) / H)
    certain = 0
    for seed in range(10):
        longer = walking(100.0 * (n / N) ** 2, seed, n)
        certain += offset_walk_found(fitted_system([White(0.01)], longer, H), H, Interval()).said == "walks"
    assert certain >= 5


def test_what_kalibr_gets_where_the_verdict_says_drift_alone() -> None:
    axis = report(walking(3000.0, 1, 60_000))
    assert all(part.part != "walk" for part in axis.result.parts)
    assert axis.filter is not None
    assert axis.walk is not None
    assert axis.result.level.K == axis.walk.K
    assert axis.walk.K.value is not None
    text = imu_yaml({"gyro_x": axis_noise(axis)}, 100.0, "rest.npz")
    assert axis.tracked is not None
    K = max(axis.filter.K, axis.walk.K.value) if slope_of(axis.tracked.system).any() else axis.walk.K.value
    assert yaml.safe_load(text)["gyroscope_random_walk"] == pytest.approx(np.radians(K), rel=1e-5)


def test_kalibr_gets_all_of_a_walk_that_has_bounds_in_the_filter() -> None:
    """The noise has a relaxation of 1 s. From a minute's record, the verdict takes it for a random walk.

    The exported filter has a state for the relaxation, and almost no random walk. imu.yaml has no such state,
    so it gets the random walk of the verdict.
    """
    rng = np.random.default_rng(0)
    axis = report(rng.normal(size=6000) + gauss_markov(rng, 6000, H, 1.0, 1.0))
    assert axis.filter is not None
    assert axis.result.level.K.value is not None
    assert axis.filter.K / axis.result.level.K.value < 0.5
    assert axis_noise(axis).K.value == axis.result.level.K.value


@pytest.mark.slow
def test_no_record_is_said_to_have_no_walk() -> None:
    for share, said in ((0.0, "as good as constant"), (30.0, "too short to tell")):
        texts = [imu_yaml({"gyro_x": axis_noise(report(walking(share, k)))}, 100.0, "a") for k in range(6)]
        assert any(said in text for text in texts)
        for text in texts:
            assert "no random walk" not in text
            assert ("with 95 % probability" in text) == ("gyroscope_random_walk" not in yaml.safe_load(text))
    assert any("as good as constant" not in text and " would" in text for text in texts)


def test_what_n_leaves_out_is_beside_it() -> None:
    """White noise with N = 0.01 deg/√s comes with a relaxation of correlation time 0.3 s.

    N contains only the white noise. Beside N, the density of both together is given, with the time 0.3 s.
    """
    rng = np.random.default_rng(4)
    y = rng.normal(size=60_000) * 0.1 + gauss_markov(rng, 60_000, H, 0.05, 0.3)
    noise = axis_noise(report(y))
    assert noise.N.value == pytest.approx(0.01, rel=0.05)
    ((tau_s, density),) = noise.N.slower
    assert tau_s == pytest.approx(0.3, rel=0.3)
    assert density == pytest.approx(np.sqrt(0.01**2 + 2 * 0.05**2 * 0.3), rel=0.15)
    text = imu_yaml({"gyro_x": noise}, 100.0, "a")
    assert f"{np.radians(density):.2e} at {tau_s:.2g} s" in text
    assert yaml.safe_load(text)["gyroscope_noise_density"] == pytest.approx(np.radians(0.01), rel=0.05)
