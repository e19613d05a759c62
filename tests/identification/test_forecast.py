"""Tests of the forecast of the heading error, which is compared with the second half of a recording."""

import math

import numpy as np
import pytest
from fltea.identification.forecast import Drive, Goal, drive_of, found, goal_of, now, said
from fltea.identification.forecast_judge import FittedSystem, fitted_system, judged, left_open
from fltea.identification.load import GYRO_UNIT, Series
from fltea.identification.sensor_events import watch
from fltea.noise.parts import Walk, White
from fltea.records.errors import UsageError
from fltea.records.plus_minus import NORMAL_95
from fltea.settings.live import LiveConfig

H = 0.02


def _walking(K: float, seed: int, n: int = 20000) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.normal(size=n) * 0.1 + np.cumsum(rng.normal(size=n)) * K * np.sqrt(H) + 3.0


def test_a_right_model_holds() -> None:
    y = _walking(0.02, 1)
    found = judged(fitted_system((White(0.01), Walk(0.02)), y[: len(y) // 2], H), y, len(y) // 2, H)
    assert not any(one.fails for one in [*found.heading, *found.bias])
    assert min(one.pieces for one in found.heading) >= 5
    text = said(found, "deg/s")
    assert text.startswith("The first half's forecast holds in the second half up to ")
    assert " Bias(10 s) holds: the σ of the rate's mean about it is 0.0" in text


def test_a_model_that_drifts_too_little_fails_in_a_sentence() -> None:
    y = _walking(0.02, 1)
    pieces = judged(fitted_system((White(0.01), Walk(0.004)), y[: len(y) // 2], H), y, len(y) // 2, H)
    assert any(one.fails for one in pieces.heading)
    text = said(pieces, "deg/s")
    assert text.startswith("The heading drifts faster than predicted: ")
    assert " s) fails: the σ of the rate's mean about it is " in text


def test_beyond_half_a_turn_no_angle_is_said() -> None:
    y = 1e5 * _walking(0.02, 1)
    pieces = judged(fitted_system((White(1e3), Walk(2e3)), y[: len(y) // 2], H), y, len(y) // 2, H)
    assert said(pieces, "deg/s").count("over half a turn") == 2
    assert "half a turn" not in said(pieces, "m/s²")


def test_a_longer_record_knows_its_walk_better() -> None:
    y = _walking(0.02, 1, 80_000)
    parts = White(0.01), Walk(0.02)
    short, long = (left_open(fitted_system(parts, y[:n], H), H, [1.0, 60.0]) for n in (5000, 80_000))
    for few, many in zip(short, long, strict=True):
        assert many.spread / few.spread == pytest.approx(0.25, rel=0.5)


def test_bands_hold_the_truth_as_often_as_they_say() -> None:
    parts, inside, total = (White(0.01), Walk(0.02)), 0.0, 0
    for seed in range(10):
        y = _walking(0.02, seed)
        for one in judged(fitted_system(parts, y[:10000], H), y, 10000, H).heading[:4]:
            inside, total = inside + one.within * one.pieces, total + one.pieces
    assert inside / total == pytest.approx(0.95, abs=0.015)


def test_the_bias_now_is_the_walk_at_the_end() -> None:
    y = _walking(0.02, 3)
    its = fitted_system((White(0.01), Walk(0.02)), y, H)
    end = watch({"y": Series(y, GYRO_UNIT, None)}, (), {"y": its}, H, LiveConfig())["y"].at_end
    found = now(its.system, y, H, end)
    assert found.bias_s == 1.0
    assert found.bias == pytest.approx(y[-30:].mean(), abs=5 * found.bias_std)


@pytest.mark.parametrize(
    "text", ["x@60", "0.5", "0.5@", "@60", "0@60", "-1@60", "nan@60", "0.5@0", "0.5@7200"]
)
def test_what_is_no_goal_is_said_with_one_that_is(text: str) -> None:
    with pytest.raises(UsageError, match=r"--rest-for 0\.5@60 asks how long"):
        goal_of(text)


def test_how_long_to_rest_is_as_long_as_white_noise_takes() -> None:
    """For white noise, the bias is the mean of all samples of the `rest` seconds for which the sensor was at
    rest. So the variance of the heading after a time t is σ² h t (1 + t / rest), where h is the sampling
    period.
    """
    R, h, t_s = 0.02, 0.01, 60.0
    y = np.random.default_rng(3).normal(0, math.sqrt(R), 60_000)
    goal, white = Goal(0.4, t_s), [White(R)]
    whole = fitted_system(white, y, h)
    _, found_ = found(whole, y, h, "deg/s", lambda half: fitted_system(white, half, h), goal)
    assert found_ is not None
    assert found_.rest_s is not None
    expected = t_s / ((goal.within / NORMAL_95) ** 2 / (R * h * t_s) - 1)
    assert found_.rest_s == pytest.approx(expected, rel=0.2)
    assert "Rest for" in found_.text
    _, none = found(whole, y, h, "deg/s", lambda half: fitted_system(white, half, h), Goal(0.01, t_s))
    assert none is not None
    assert none.rest_s is None
    assert "No rest is enough" in none.text


@pytest.mark.parametrize("text", ["x@30", "1", "1@", "@30", "0@30", "-1@30", "nan@30", "1@0", "1@100000"])
def test_what_is_no_drive_is_said_with_one_that_is(text: str) -> None:
    with pytest.raises(UsageError, match=r"--drive-for 1@30 asks for how long"):
        drive_of(text)
    assert drive_of("1@30") == Drive(1.0, 30.0)


def _white(seed: int = 3) -> tuple[np.ndarray, FittedSystem]:
    y = np.random.default_rng(seed).normal(0, math.sqrt(0.02), 60_000)
    return y, fitted_system([White(0.02)], y, 0.01)


def test_how_long_a_heading_is_good_is_as_long_as_white_noise_lets_it() -> None:
    """The variance of the heading after a time t is R h t (1 + t / rest_s), where R is the variance of the
    noise and h the sampling period. The expected t is that at which this variance reaches its limit.
    """
    (y, whole), R, h, rest_s = _white(), 0.02, 0.01, 30.0
    drive = Drive(1.0, rest_s)
    _, found_ = found(whole, y, h, "deg/s", lambda half: fitted_system([White(R)], half, h), drive)
    assert found_ is not None
    variance = (drive.within / NORMAL_95) ** 2
    expected = (math.sqrt(rest_s**2 + 4 * rest_s * variance / (R * h)) - rest_s) / 2
    assert found_.drive_s == pytest.approx(expected, rel=0.1)
    assert (found_.drive, found_.goal, found_.rest_s) == (drive, None, None)
    said_ = f"After a rest of 30 s the heading is good to ± 1° (95 %, 1.96 σ) for {found_.drive_s:.3g} s."
    assert found_.text.endswith(said_)


def test_rest_and_drive_are_asked_for_together_and_each_is_the_others_inverse() -> None:
    y, whole = _white()
    asked = Goal(0.5, 60.0), Drive(0.5, 60.0)
    _, found_ = found(whole, y, 0.01, "deg/s", lambda half: fitted_system([White(0.02)], half, 0.01), asked)
    assert found_ is not None
    assert (found_.goal, found_.drive) == asked
    assert found_.rest_s is not None
    assert found_.text.index("Rest for ") < found_.text.index("After a rest of 60 s ")
    again = Drive(0.5, found_.rest_s)
    _, back = found(whole, y, 0.01, "deg/s", lambda half: fitted_system([White(0.02)], half, 0.01), again)
    assert back is not None
    assert back.drive_s == pytest.approx(60.0, rel=0.03)


@pytest.mark.parametrize(
    ("asked", "text"),
    [
        (
            Goal(100.0, 10.0),
            "Rest for less than 1 s: the heading is good to ± 100° (95 %, 1.96 σ) 10 s later.",
        ),
        (
            Drive(1e-9, 30.0),
            "After a rest of 30 s the heading is good to ± 1e-09° (95 %, 1.96 σ) for less than ",
        ),
        (Drive(1e6, 30.0), "the heading is good to ± 1e+06° (95 %, 1.96 σ) for more than an hour."),
    ],
)
def test_no_time_is_said_to_be_none(asked: Goal | Drive, text: str) -> None:
    y, whole = _white()
    _, found_ = found(whole, y, 0.01, "deg/s", lambda half: fitted_system([White(0.02)], half, 0.01), asked)
    assert found_ is not None
    assert text in found_.text
    assert " 0 s" not in found_.text


def test_a_first_half_without_a_model_leaves_the_answers_of_the_whole() -> None:
    def first(half: np.ndarray) -> FittedSystem:
        raise ValueError("too short")

    y, whole = _white()
    _, found_ = found(whole, y, 0.01, "deg/s", first, (Goal(0.5, 60.0), Drive(0.5, 60.0)))
    assert found_ is not None
    assert found_.text.startswith("The first half has no model to judge: too short. Rest for ")
    assert found_.rest_s is not None
    assert found_.drive_s is not None
