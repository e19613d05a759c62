"""The evaluation runs filters and fits on many series in parallel. They give the same results as the
daemon's, for filters even if Q and R change during the run.
"""

from itertools import pairwise

import msgspec
import numpy as np
import pytest
from fltea.estimator.baseline import lane_baselines
from fltea.estimator.engine import Engine
from fltea.estimator.lane_settings import LaneSettings
from fltea.settings.estimator import EstimatorConfig

from tests.rig.one_fltea import fltea_fit
from tools.validation.evaluate.cases import POWER, Case, H, samples
from tools.validation.evaluate.fits import QUANTITIES, fitted_variances, live_readings, truths, whole_reading
from tools.validation.evaluate.online import Tuning, read
from tools.validation.evaluate.settings import MAIN, TUNED
from tools.validation.evaluate.tuned import fit_points, tunings

CASE = Case(0.6, -3.0, 3.0)


@pytest.mark.parametrize("setting", MAIN[:2], ids=lambda setting: setting.name)
def test_what_the_daemon_gives(setting: object) -> None:
    """The filters' results equal the daemon's, sample by sample, up to the rounding of the bias."""
    y = samples(CASE, 2, 1_200)
    (found,) = read(y, H, setting.config, (1_200,))
    for seed in range(2):
        one, _ = fltea_fit(y[:, seed], H, setting.config)
        assert found.valid[seed]
        assert found.alpha[seed] == pytest.approx(one.alpha, rel=1e-9)
        assert found.alpha_std[seed] == pytest.approx(one.alpha_std, rel=1e-9)
        assert found.f[seed] == pytest.approx(one.f, rel=1e-9)
        assert found.f_std[seed] == pytest.approx(one.f_std, rel=1e-9)


def test_a_shorter_record_is_the_beginning_of_a_longer_one() -> None:
    y = samples(CASE, 3, 2_000)
    both = read(y, H, EstimatorConfig(), (1_000, 2_000))
    for found, n in zip(both, (1_000, 2_000), strict=True):
        (alone,) = read(y[:n], H, EstimatorConfig(), (n,))
        for a, b in zip(found, alone, strict=True):
            np.testing.assert_array_equal(a, b)


def test_given_variances_take_the_place_of_the_settings() -> None:
    """Q and R that are given take the place of those in the settings. Each series has its own."""
    y = samples(CASE, 2, 1_000)
    Q, R = np.array([0.02, 0.3]), np.array([0.004, 0.05])
    (found,) = read(y, H, EstimatorConfig(), (1_000,), Q=Q, R=R)
    for seed in range(2):
        state = msgspec.structs.replace(EstimatorConfig().state, Q=Q[seed])
        (alone,) = read(y[:, [seed]], H, EstimatorConfig(state=state, R=R[seed]), (1_000,))
        assert found.alpha[seed] == pytest.approx(alone.alpha[0], rel=1e-9)
        assert found.f_std[seed] == pytest.approx(alone.f_std[0], rel=1e-9)


def test_a_lane_that_ran_away_is_lost_alone_and_for_good() -> None:
    y = samples(Case(), 3, 1_600)
    y[700:900:7, 1] = 2000.0
    config = EstimatorConfig(variant="triple", guard="off")
    before, after = read(y, H, config, (700, 1_600))
    assert before.valid.all()
    assert after.valid.tolist() == [True, False, True]
    (others,) = read(y[:, [0, 2]], H, config, (1_600,))
    np.testing.assert_allclose(after.alpha[[0, 2]], others.alpha, rtol=1e-9)


def test_lengths_that_cannot_be_read() -> None:
    y = samples(Case(), 1, 1_000)
    for lengths in ((550,), (500,), (950,)):
        with pytest.raises(ValueError, match="multiples of 100"):
            read(y, H, EstimatorConfig(), lengths)


CLEAR = Case(0.8, -1.0, 3.0)


@pytest.mark.parametrize("name", list(TUNED))
def test_the_filters_go_on_with_what_they_are_told(name: str) -> None:
    """A tuning (new Q and R for a running filter) replaces these settings of the filter. It changes nothing
    if it has no values, or comes within the start-up window.
    """
    config, y = TUNED[name], samples(CLEAR, 2, 1_000)
    nothing, handed = np.full(2, np.nan), (np.full(2, 0.01), np.full(2, 0.004))
    (plain,) = read(y, H, config, (1_000,))
    (same,) = read(y, H, config, (1_000,), tunings=[Tuning(700, nothing, nothing), Tuning(100, *handed)])
    for a, b in zip(plain, same, strict=True):
        np.testing.assert_array_equal(a, b)
    bias, R = lane_baselines(y[:500], config, None)
    engine = Engine(2, LaneSettings(config, H, R))
    engine.run(y[500:900] - bias)
    engine.retune(LaneSettings(config, H, 0.004, {"state.Q": 0.01}))
    changed = engine.run(y[900:] - bias)
    (found,) = read(y, H, config, (1_000,), tunings=[Tuning(900, *handed)])
    np.testing.assert_allclose(found.alpha, changed.alpha[-1], rtol=1e-12)


def test_only_what_is_known_is_handed_over() -> None:
    """The last fit, of more than two minutes of samples, hands its variances over to the filters: s2 (of what
    drives the state) and R (of the white noise). The first fit, of six seconds, hands over nothing. A fit of
    white noise hands over both variances or none.
    """
    handed = tunings(samples(CLEAR, 2, 20_000), H, 20_001)
    assert np.isnan(handed[0].Q).all()
    last = handed[-1]
    np.testing.assert_allclose(last.Q, CLEAR.noise.s2, rtol=0.3)
    np.testing.assert_allclose(last.R, CLEAR.noise.R, rtol=0.3)
    for one in tunings(samples(Case(), 2, 3_000), H, 3_001):
        assert np.isnan(one.Q).all() == np.isnan(one.R).all()


def test_fit_points() -> None:
    points = fit_points(600, 60_000)
    assert points[0] == 600
    assert all(not n % 100 and a < n < 60_000 for a, n in pairwise(points))
    assert max(b / a for a, b in pairwise(points)) < 1.4


STRONG = Case(0.8, -1.0, 30.0)
"""A noise whose order is easy to find. After 3,000 samples, the smallest possible standard deviation
(Cramér–Rao bound) is 0.036 for α and 0.41 for f.
"""


def test_truths() -> None:
    assert truths(Case()) == {}
    found = truths(STRONG)
    assert tuple(found) == QUANTITIES
    assert found["s2"] / found["R"] == pytest.approx(30)
    assert found["F"] == pytest.approx(0.8 - 0.01**0.8)


def test_up_to_three_thousand_samples_live_is_the_whole_record() -> None:
    """The spectrum of the live fit still contains every sample of a record of up to 3,000 samples.

    So the live fit equals the fit of the whole record.
    """
    y = samples(STRONG, 3, 3_000)
    truth = truths(STRONG)
    (live,), whole = live_readings(y, H, (3_000,), truth), whole_reading(y, H, truth)
    # f shows mainly in the lowest ordinates (frequencies) of the spectrum: those from the tenth on give it
    # only to a factor of two. So the two fits may differ by a fifth of f.
    for name, most in (("alpha", 0.03), ("F", 0.03), ("s2", 0.1), ("f", 0.25)):
        np.testing.assert_allclose(live.estimates[name], whole.estimates[name], rtol=most, atol=1e-3)
    for name in QUANTITIES:
        np.testing.assert_array_equal(live.covered[name], whole.covered[name])
    np.testing.assert_array_equal(live.published, whole.published)


@pytest.mark.slow
def test_strong_noise_is_found_and_its_intervals_hold() -> None:
    """Of the intervals for 60 series of 20,000 samples, 95 % (57) are expected to contain the true value.

    The probability that 51 or fewer do is 1 %.
    """
    truth = truths(STRONG)
    _, found = live_readings(samples(STRONG, 60, 20_000), H, (3_000, 20_000), truth)
    assert found.published.all()
    assert found.estimates["alpha"].mean() == pytest.approx(0.8, abs=0.02)
    assert np.median(found.estimates["f"]) == pytest.approx(-1, abs=0.3)
    for name in QUANTITIES:
        assert found.covered[name].sum() >= 51, name
    (wrong,) = live_readings(samples(STRONG, 2, 3_000), H, (3_000,), truth | {"alpha": 0.1, "f": -30.0})
    assert not wrong.covered["alpha"].any()
    assert not wrong.covered["f"].any()


def test_white_noise_has_no_order_and_no_truth() -> None:
    found = whole_reading(samples(Case(), 12, 1_000), H, {})
    assert found.published.sum() <= 1
    assert found.covered == {}


def test_fitted_variances() -> None:
    """The fitted variances Q and R are near those of the noise, and never 0.

    For white noise, Q is the default, and R is the power of the samples.
    """
    noise = Case(0.8, -10.0, 3.0)
    Q, R = fitted_variances(samples(noise, 3, 10_000), H, 0.15, POWER)
    assert np.median(Q) == pytest.approx(noise.noise.s2, rel=0.1)
    assert np.median(R) == pytest.approx(noise.noise.R, rel=0.2)
    Q, R = fitted_variances(samples(Case(), 3, 2_000), H, 0.15, POWER)
    assert np.median(Q) == 0.15
    assert np.median(R) == POWER
    Q, R = fitted_variances(samples(Case(0.4, -1.0, 1e6), 3, 2_000), H, 0.15, POWER)
    assert R.min() >= POWER / 1000
