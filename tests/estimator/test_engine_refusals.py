"""What the engine refuses, by name, and settings that are numbers of each lane."""

from typing import Any

import numpy as np
import pytest
from engine_cases import GYROSCOPE, run, white, with_
from fltea.estimator.engine import Engine


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"h": 0}, "h must be a number from 1e-12 to 1000000000000 s, got 0"),
        ({"h": float("nan")}, "h must be"),
        ({"h": [0.01, 0.01, 0.01]}, r"h must .* 2 lanes, got shape \(3,\)"),
        ({"window": 0}, "window 0 is an unlimited one"),
        ({"R": 0}, "R must be .* from 1e-100"),
        ({"R": [0.1, -0.1]}, "R must be"),
        ({"accuracy": 2}, "accuracy must be"),
        ({"state__P0": -1}, "state.P0 must be a number from 0"),
        ({"state__Q": [float("inf"), 1]}, "state.Q must be"),
        ({"state__x0": 1e101}, "state.x0 must be"),
        ({"order__delta": [0.5, 1.1]}, "order.delta must be a number from 0 to 1, got 1.1"),
        ({"order__R": 0}, "order.R must be"),
        ({"order__alpha0": 2.1, "guard": "faithful"}, "order.alpha0 must be within the bounds"),
        ({"joint__beta0": 1.1, "variant": "joint", "guard": "faithful"}, "joint.beta0 must be within"),
        ({"parameter__Q0": -1}, "parameter.Q0 must be"),
        ({"joint__P0": [1, -1], "variant": "joint"}, "joint.P0 must be"),
    ],
    ids=str,
)
def test_settings_that_no_filter_can_work_with_are_named(changes: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Engine(2, with_(GYROSCOPE, **changes))


def test_calls_of_a_wrong_shape_are_refused() -> None:
    engine = Engine(2, GYROSCOPE)
    for wrong in ([[1.0]], [1.0, 2.0], [[1.0, 2.0, 3.0]]):
        with pytest.raises(ValueError, match="y must have 2 lanes"):
            engine.run(wrong)
    with pytest.raises(ValueError, match=r"u must have y's shape \(1, 2\), got \(2, 2\)"):
        engine.run([[1.0, 2.0]], [[0.0, 0.0]] * 2)
    with pytest.raises(ValueError, match="missing must have y's shape"):
        engine.step([1.0, 2.0], missing=[True])
    with pytest.raises(ValueError, match=r"mask must have shape \(2,\)"):
        engine.reset([True])
    with pytest.raises(ValueError, match="at least one lane"):
        Engine(0, GYROSCOPE)
    with pytest.raises(ValueError, match="'sse9' is not usable here"):
        Engine(1, GYROSCOPE, instruction_set="sse9")
    assert engine.run(np.empty((0, 2))).alpha.shape == (0, 2)


def test_settings_for_each_lane_are_those_of_lanes_of_their_own() -> None:
    y = white(60, 3, 3)
    numbers: dict[str, Any] = {
        "h": [0.01, 0.02, 0.03],
        "R": [0.01, 0.02, 0.03],
        "state__P0": [0.1, 0.2, 0.3],
        "state__Q": [0.1, 0.2, 0.1],
        "state__x0": [0, 1, 2],
        "order__alpha0": [0.5, 1, 1.5],
        "order__P0": [0.1, 0.2, 0.1],
        "order__R": [0.1, 0.2, 0.3],
        "parameter__f0": [-1, -2, 0],
        "parameter__delta": [0, 0.5, 1],
    }
    together = run(with_(GYROSCOPE, **numbers), y)
    for k in range(3):
        alone = with_(GYROSCOPE, **{name: values[k] for name, values in numbers.items()})
        assert np.array_equal(run(alone, y[:, k : k + 1]).f[:, 0], together.f[:, k])
