"""Filters whose Q and R change while they run."""

from itertools import pairwise

import numpy as np
import pytest
from fltea.estimator.baseline import lane_baselines
from fltea.estimator.engine import Engine
from fltea.estimator.lane_settings import LaneSettings

from tools.validation.evaluate.cases import Case, H, samples
from tools.validation.evaluate.online import read
from tools.validation.evaluate.settings import TUNED
from tools.validation.evaluate.tuned import Tuning, fit_points, read_tuned, tunings

STRONG = Case(0.8, -1.0, 3.0)
NOTHING = np.full(2, np.nan)


@pytest.mark.parametrize("name", list(TUNED))
def test_without_a_fit_it_is_the_filter_as_it_is(name: str) -> None:
    y = samples(STRONG, 2, 2_000)
    lengths = (1_000, 2_000)
    tuned = read_tuned(y, H, TUNED[name], lengths, [Tuning(700, NOTHING, NOTHING)])
    for found, plain in zip(tuned, read(y, H, TUNED[name], lengths), strict=True):
        for a, b in zip(found, plain, strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-9)


@pytest.mark.parametrize("name", list(TUNED))
def test_the_filters_go_on_with_what_they_are_told(name: str) -> None:
    config = TUNED[name]
    y = samples(STRONG, 2, 1_000)
    bias, R = lane_baselines(y[:500], config, None)
    engine = Engine(2, LaneSettings(config, H, R))
    engine.run(y[500:900] - bias)
    engine.retune(LaneSettings(config, H, 0.004, {"state.Q": 0.01}))
    changed = engine.run(y[900:] - bias)
    given = [Tuning(900, np.full(2, 0.01), np.full(2, 0.004))]
    (found,) = read_tuned(y, H, config, (1_000,), given)
    np.testing.assert_array_equal(found.alpha, changed.alpha[-1])


def test_only_what_is_known_is_handed_over() -> None:
    """s2 and R of ten minutes are; of half a minute, and of white noise, they are not."""
    handed = tunings(samples(STRONG, 2, 20_000), H, 20_001)
    assert np.isnan(handed[0].s2).all()
    last = handed[-1]
    np.testing.assert_allclose(last.s2, STRONG.noise.s2, rtol=0.3)
    np.testing.assert_allclose(last.R, STRONG.noise.R, rtol=0.3)
    for one in tunings(samples(Case(), 2, 3_000), H, 3_001):
        assert np.isnan(one.s2).all() == np.isnan(one.R).all()


def test_fit_points() -> None:
    points = fit_points(600, 60_000)
    assert points[0] == 600
    assert all(not n % 100 and a < n < 60_000 for a, n in pairwise(points))
    assert max(b / a for a, b in pairwise(points)) < 1.4
