"""Tests of the filters of several axes, which run in parallel. Each axis has a supervisor, which restarts a
filter that diverged. However the samples are divided into blocks, estimates and supervisors' decisions equal
those of the oracle, which processes one sample at a time in Python.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from fltea.estimator.lane_settings import LaneSettings
from fltea.estimator.lanes import Lanes, Lost
from fltea.records.arrays import Array
from fltea.settings.estimator import EstimatorConfig

from tests.rig.sample_by_sample import LanesBySample

PRINTED = {"variant": "triple", "guard": "off"}


def tuning(n: int, R: float = 0.0235, **changes: object) -> LaneSettings:
    config = EstimatorConfig(window=100, **changes)  # type: ignore[arg-type]
    return LaneSettings(config, 0.01, [R] * n)


def white(n: int, lanes: int, seed: int = 0) -> Array:
    return np.random.default_rng(seed).standard_normal((n, lanes)) * 0.153


def thrown_about(n: int, lanes: int) -> Array:
    """Return samples of several axes. Each axis has more samples with motion than the axis before.

    The last third has no motion.
    """
    y = white(n, lanes)
    loud = np.random.default_rng(1).random(y.shape) < np.arange(lanes) / (2 * lanes)
    loud[2 * n // 3 :] = False
    return y + 20 * loud * np.random.default_rng(2).choice([-1, 1], y.shape)


def on_and_off(n: int, lanes: int) -> Array:
    """Return samples with motion in the first 200 of every 350 samples.

    The axis's supervisor, which withdraws estimates during motion, has to forget each motion before the next.
    """
    y = white(n, lanes)
    loud = (np.random.default_rng(1).random(y.shape) < 0.45) & (np.arange(n)[:, np.newaxis] % 350 < 200)
    return y + 20 * loud * np.random.default_rng(2).choice([-1, 1], y.shape)


CASES = [
    ({}, 0.0235, white),
    ({}, 0.0235, thrown_about),
    ({}, 0.0235, on_and_off),
    ({"variant": "triple", "guard": "faithful"}, 0.001, thrown_about),
    (PRINTED, 0.0235, white),
    (PRINTED, 0.002, white),
    (PRINTED | {"memory": "direct"}, 0.001, thrown_about),
]


@pytest.mark.parametrize(("changes", "R", "make"), CASES)
@pytest.mark.parametrize("lanes", [1, 3, 11])
def test_equals_the_oracle_to_the_bit(changes: dict[str, object], R: float, make: object, lanes: int) -> None:
    y = make(900, lanes)  # type: ignore[operator]
    gone = np.zeros(900, dtype=bool)
    gone[[50, 51, 300, 899]] = True
    oracle, runner = (kind(lanes, tuning(lanes, R, **changes)) for kind in (LanesBySample, Lanes))
    found = runner.run(y, np.repeat(gone[:, np.newaxis], lanes, axis=1))
    lost = []
    for k, row in enumerate(y):
        expected = oracle.step(row, missing=bool(gone[k]))
        lost += [Lost(k, lane, why) for lane, why in expected.lost.items()]
        np.testing.assert_array_equal([column[k] for column in found[:7]], expected.columns)
        np.testing.assert_array_equal(found.valid[k], expected.valid)
    assert found.lost == lost
    assert runner.restarts.tolist() == oracle.restarts
    np.testing.assert_array_equal(runner.interventions(), oracle.engine.interventions())


def test_the_cases_are_there_for_something() -> None:
    """In these cases the filters of axes really diverge, become invalid and become valid again."""
    reasons = []
    for changes, R, make in CASES:
        runner = Lanes(11, tuning(11, R, **changes))
        found = runner.run(make(900, 11))
        reasons.append(({one.reason for one in found.lost}, bool(runner.restarts.any())))
    assert reasons[1] == ({"bound"}, True)
    assert reasons[2] == ({"bound"}, True)
    assert reasons[5] == ({"runaway"}, True)
    assert (reasons[0], reasons[4]) == ((set(), False),) * 2


def test_what_cannot_be_run_is_refused_and_changes_nothing() -> None:
    runner, other = Lanes(2, tuning(2)), Lanes(2, tuning(2))
    y = white(10, 2)
    for wrong in (math.nan, math.inf, 1e101):
        bad = y.copy()
        bad[3, 1] = wrong
        with pytest.raises(ValueError, match=r"y\[3\], lane 1"):
            runner.run(bad)
    for shape in ((2,), (3, 1), (1, 2, 2)):
        with pytest.raises(ValueError, match="y must have 2 lanes"):
            runner.run(np.zeros(shape))
    with pytest.raises(ValueError, match="missing must have y's shape"):
        runner.run(y, np.zeros((9, 2), dtype=bool))
    with pytest.raises(ValueError, match="R must be"):
        Lanes(2, replace(tuning(2), R=-1.0))
    assert runner.run(y[:0]).alpha.shape == (0, 2)
    first, second = runner.run(y), other.run(y)
    np.testing.assert_array_equal(first.alpha, second.alpha)


def test_threads_wait_for_each_other() -> None:
    """Calls release Python's global lock. Still, each call processes its whole block before the next one."""
    from concurrent.futures import ThreadPoolExecutor

    runner = Lanes(3, tuning(3))
    y = np.repeat(white(1, 3), 200, axis=0)
    with ThreadPoolExecutor(4) as pool:
        found = [future.result() for future in [pool.submit(runner.run, y) for _ in range(20)]]
    expected = Lanes(3, tuning(3)).run(np.repeat(y[:1], 4000, axis=0))
    ends = sorted(block.alpha[-1, 0] for block in found)
    assert ends == sorted(expected.alpha[199::200, 0])
