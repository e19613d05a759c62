import math
from typing import Any

import pytest
from fltea.estimator.baseline import Baseline
from fltea.settings.estimator import EstimatorConfig
from sample_by_sample import Startup

AXES = ("x", "y")


def begun(length: int, bias: Any, R: Any, resolution_dps: float | None = None) -> Startup:
    return Startup(AXES, EstimatorConfig(startup=length, bias=bias, R=R), resolution_dps)


def test_mean_and_variance_of_the_window() -> None:
    startup = begun(3, "startup", "auto")
    assert startup.needed == 3
    assert startup.add([1, 10]) is None
    assert startup.add([2, 10]) is None
    # x: mean 2, variance (1 + 0 + 1)/2; y: mean 12, variance (4 + 4 + 16)/2.
    assert startup.add([3, 16]) == Baseline((2.0, 12.0), (1.0, 12.0), ())


def test_samples_after_the_window_change_nothing() -> None:
    startup = begun(2, "startup", "auto")
    startup.add([1, 2])
    baseline = startup.add([2, 4])
    assert startup.add([100, 100]) == baseline == startup.baseline()


def test_given_bias_and_R_need_no_window() -> None:
    startup = begun(100, [0.5, -1], [0.02, 0.03])
    assert startup.needed == 0
    assert startup.baseline() == Baseline((0.5, -1.0), (0.02, 0.03), ())
    assert begun(2, "none", 0.02).baseline() == Baseline((0.0, 0.0), (0.02, 0.02), ())
    assert begun(2, 0.5, 0.02).baseline().bias_dps == (0.5, 0.5)


def test_a_given_bias_leaves_R_to_the_window_and_the_other_way_round() -> None:
    startup = begun(2, [0.5, -1], "auto")
    startup.add([1, 1])
    assert startup.add([3, 2]) == Baseline((0.5, -1.0), (2.0, 0.5), ())
    startup = begun(2, "startup", 0.1)
    startup.add([1, 0])
    assert startup.add([3, 2]) == Baseline((2.0, 1.0), (0.1, 0.1), ())


def test_the_resolution_is_the_floor_of_R() -> None:
    startup = begun(100, "startup", "auto", resolution_dps=0.6)
    for k in range(100):
        baseline = startup.add([0.6 * (k == 0), 0.6 * (k % 2)])  # x hardly ever changes, y always
    assert baseline is not None
    assert baseline.R[0] == pytest.approx(0.03)
    assert baseline.R[1] == pytest.approx(0.0909, rel=1e-3)
    assert baseline.constant_axes == ()


def test_an_axis_that_is_stuck_has_no_R_though_the_resolution_is_known() -> None:
    startup = begun(3, "startup", "auto", resolution_dps=0.6)
    startup.add([0.6, 0.0])
    startup.add([0.6, 0.6])
    baseline = startup.add([0.6, 1.2])
    assert baseline is not None
    assert baseline.constant_axes == ("x",)
    assert math.isnan(baseline.R[0])


def test_a_constant_axis_of_unknown_resolution_has_no_R() -> None:
    # The mean of many 0.1 is not 0.1, so that the computed variance is not zero.
    startup = begun(1000, "startup", "auto")
    for k in range(1000):
        baseline = startup.add([0.1, k % 2])
    assert baseline is not None
    assert baseline.constant_axes == ("x",)
    assert math.isnan(baseline.R[0])
    assert baseline.R[1] == pytest.approx(0.25, rel=0.01)


def test_a_constant_axis_with_given_R_is_fine() -> None:
    startup = begun(2, "startup", 0.1)
    startup.add([1, 1])
    assert startup.add([1, 1]) == Baseline((1.0, 1.0), (0.1, 0.1), ())


@pytest.mark.parametrize("bad", [[1.0], [1.0, math.nan], [math.inf, 1.0]])
def test_wrong_samples_are_refused_and_not_kept(bad: list[float]) -> None:
    startup = begun(2, "startup", 1)
    with pytest.raises(ValueError, match=r"expected 2 axes|leave missing samples out"):
        startup.add(bad)
    with pytest.raises(ValueError, match="still needs 2 of 2"):
        startup.baseline()


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ((10, [0.1], 0.1), "bias needs one value, or 2"),
        ((10, "none", [0.1]), "R needs one value, or 2"),
        ((10, "none", 0.1, 0), "resolution"),
    ],
)
def test_wrong_arguments_are_named(arguments: tuple, text: str) -> None:
    with pytest.raises(ValueError, match=text):
        begun(*arguments)
