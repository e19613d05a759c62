"""The filters as lanes: the same as the daemon gives, and honest about what it lost."""

import msgspec
import numpy as np
import pytest
from fltea.identification.fltea_fit import fltea_fit
from fltea.settings.estimator import EstimatorConfig

from tools.validation.evaluate.cases import Case, H, samples
from tools.validation.evaluate.online import read
from tools.validation.evaluate.settings import MAIN

CASE = Case(0.6, -3.0, 3.0)


@pytest.mark.parametrize("setting", MAIN[:2], ids=lambda setting: setting.name)
def test_what_the_daemon_gives(setting: object) -> None:
    """Sample by sample with its own start-up window and supervisor, to the rounding of the bias."""
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
    """A Q and an R for each lane."""
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
