"""Filters whose Q and R change while they run."""

from itertools import pairwise

import numpy as np
import pytest
from fltea.estimator.baseline import lane_baselines
from fltea.estimator.engine import Engine
from fltea.estimator.lane_settings import LaneSettings

from tools.validation.evaluate.cases import Case, H, samples
from tools.validation.evaluate.online import Tuning, read
from tools.validation.evaluate.settings import TUNED
from tools.validation.evaluate.tuned import fit_points, tunings

STRONG = Case(0.8, -1.0, 3.0)


@pytest.mark.parametrize("name", list(TUNED))
def test_the_filters_go_on_with_what_they_are_told(name: str) -> None:
    """A tuning without a value changes nothing; one with values is a change of the settings."""
    config, y = TUNED[name], samples(STRONG, 2, 1_000)
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
    """s2 and R of ten minutes are; of half a minute, and of white noise, they are not."""
    handed = tunings(samples(STRONG, 2, 20_000), H, 20_001)
    assert np.isnan(handed[0].Q).all()
    last = handed[-1]
    np.testing.assert_allclose(last.Q, STRONG.noise.s2, rtol=0.3)
    np.testing.assert_allclose(last.R, STRONG.noise.R, rtol=0.3)
    for one in tunings(samples(Case(), 2, 3_000), H, 3_001):
        assert np.isnan(one.Q).all() == np.isnan(one.R).all()


def test_fit_points() -> None:
    points = fit_points(600, 60_000)
    assert points[0] == 600
    assert all(not n % 100 and a < n < 60_000 for a, n in pairwise(points))
    assert max(b / a for a, b in pairwise(points)) < 1.4
