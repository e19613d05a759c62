"""Tests that telegraph noise with almost no other noise is recognised, and that the heading's forecast
includes its steps.
"""

import math
from pathlib import Path

import fltea
import numpy as np
import pytest
from fltea.identification.axis import IdentifyOptions
from fltea.identification.load import GYRO_UNIT, Request, Series
from fltea.identification.run import identify_all
from fltea.identification.telegraph import Telegraph, without_levels
from fltea.identification.workers import Here
from fltea.records.arrays import Array
from scipy.signal import butter, lfilter

from tests.rig.identify_files import QUICK, npz, settings
from tests.rig.identify_one import identify_series
from tests.rig.identify_support import H, ar, long_recursion, white

N = 20_000


def levels(rng: np.random.Generator, n: int, stay_s: float, count: int = 2, apart: float = 0.2) -> Array:
    """Return samples of telegraph noise: it jumps between levels in random order, and stays at each for a
    random time.
    """
    stays = rng.exponential(stay_s / H, 20 + int(3 * n * H / stay_s)).astype(np.int64) + 1
    names = np.cumsum(rng.integers(1, count, len(stays))) % count
    return np.asarray(apart * (np.repeat(names, stays)[:n] - (count - 1) / 2), dtype=np.float64)


def found_in(y: Array, lsb: float | None = None) -> Telegraph | None:
    return without_levels(Series(y, GYRO_UNIT, lsb), H)[1]


@pytest.mark.parametrize("stay_s", [0.5, 2.0, 20.0])
@pytest.mark.parametrize("noise", [0.002, 0.02])
def test_it_is_called_what_it_is_and_the_noise_about_it_is_white(stay_s: float, noise: float) -> None:
    rng = np.random.default_rng(3)
    found = fltea.identify(
        levels(rng, 40_000, stay_s) + rng.normal(0.3, noise, 40_000), rate_hz=100.0, unit="deg/s"
    )
    assert found.motion == ()
    (data_check,) = (data_check for data_check in found.data_checks if data_check.kind == "telegraph")
    assert "step between two levels, 0.2 and 0.4 deg/s" in data_check.text
    assert found.verdict == "relaxations"
    assert found.text.startswith("Telegraph (popcorn) noise")
    assert "About the levels: White noise" in found.text
    assert found.details.level.N.value == pytest.approx(noise * math.sqrt(H), rel=0.03)


@pytest.mark.parametrize(("count", "noise", "lsb"), [(2, 0.01, 0.03), (3, 0.005, None)])
def test_more_levels_and_coarse_counts(count: int, noise: float, lsb: float | None) -> None:
    rng = np.random.default_rng(4)
    y = levels(rng, N, 2.0, count) + rng.normal(0, noise, N)
    y[[500, 700]] = 30.0, -30.0
    found = found_in(y if lsb is None else np.rint(y / lsb) * lsb, lsb)
    assert found is not None
    assert len(found.levels) == count
    assert found.every_s == pytest.approx(2.0, rel=0.35)
    assert found.sigma == pytest.approx(0.1 if count == 2 else 0.2 * math.sqrt(2 / 3), rel=0.15)
    # samples stay at a level for 2 s on average; with m levels, the correlation time is (m - 1) / m of that
    assert found.tau_s == pytest.approx(2.0 * (count - 1) / count, rel=0.4)


def test_the_heading_has_the_steps_to_come() -> None:
    """In 95 % of independent minutes, the heading is inside its forecast interval.

    The heading is computed with the mean of the record as bias. The exported filter has nearly the same bias
    and σ, so this is also true of the filter.
    """
    inside: list[bool] = []
    for seed in range(4):
        rng = np.random.default_rng(20 + seed)
        y = levels(rng, N + 120_000, 2.0) + rng.normal(0, 0.005, N + 120_000)
        found = fltea.identify(y[:N], rate_hz=100.0, unit="deg/s")
        assert found.now is not None
        assert found.filter is not None
        errors = H * (y[N:] - found.mean).reshape(20, -1).sum(axis=1)
        inside += (np.abs(errors) < 1.96 * found.now.heading_std).tolist()
        (minute,) = (one.filter for one in found.filter.heading_std if one.t_s == 60.0)
        assert minute == pytest.approx(found.now.heading_std, rel=0.2)
        assert found.filter.bias == pytest.approx(found.mean, abs=0.3 * found.filter.bias_std)
    assert 0.85 < np.mean(inside) <= 1


def test_the_bias_is_that_of_the_level_at_the_end_and_the_judge_agrees() -> None:
    rng = np.random.default_rng(6)
    y = levels(rng, 40_000, 20.0) + rng.normal(0, 0.005, 40_000)
    found = identify_series(Series(y, GYRO_UNIT, None), H, IdentifyOptions(QUICK, shuffles=0), False, True)
    assert found.now is not None
    assert found.now.bias == pytest.approx(y[-20:].mean(), abs=0.02)
    assert found.forecast is not None
    assert "relaxation" in found.forecast.made_of
    assert "relaxation" in [str(part.__struct_config__.tag) for part in found.model.parts]
    assert found.motion == found.bias_steps == ()


def test_other_axes_of_the_sensor_did_not_move(tmp_path: Path) -> None:
    rng = np.random.default_rng(7)
    raw = rng.normal(0, 3, (N, 3))
    raw[:, 1] += levels(rng, N, 2.0, apart=300.0)
    path = npz(tmp_path / "one.npz", np.rint(raw).astype(np.int32))
    (report,) = identify_all([Request((path,))], settings(), Here())
    assert not any(axis.motion for axis in report.axes.values())
    assert [axis.result.verdict.kind for axis in report.axes.values()] == ["white", "relaxations", "white"]


@pytest.mark.parametrize("about", ["a filter", "a relaxation"])
def test_the_levels_behind_a_filter_or_with_slow_noise_about_them(about: str) -> None:
    rng = np.random.default_rng(10)
    y, n = levels(rng, 30_000, 2.0), 30_000
    if about == "a filter":
        y = lfilter([0.5], [1, -0.5], y + rng.normal(0, 0.01, n))
    else:
        y = y + rng.normal(0, 0.005, n) + lfilter([0.002], [1, -0.99], rng.normal(0, 1, n))
    found = fltea.identify(y, rate_hz=100.0, unit="deg/s")
    kinds = {data_check.kind for data_check in found.data_checks}
    assert "telegraph" in kinds
    assert kinds.isdisjoint({"motion", "outliers"})
    assert found.withheld == ""


def test_what_moves_between_levels_is_told_where_nothing_else_can_be() -> None:
    rng = np.random.default_rng(11)
    y = levels(rng, N, 2.0) + rng.normal(0, 0.005, N) + 0.001 * rng.normal(0, 1, N).cumsum()
    with pytest.raises(ValueError, match=r"jump .* times, by 0.2 deg/s .*steps between levels"):
        fltea.identify(y, rate_hz=100.0, unit="deg/s")


def test_without_any_noise_it_is_said_that_there_are_only_two_values() -> None:
    for stay_s in (0.5, 2.0, 20.0):
        y = levels(np.random.default_rng(8), N, stay_s)
        try:
            said = fltea.identify(y, rate_hz=100.0, unit="deg/s").withheld
        except ValueError as error:
            said = str(error)
        assert "only 2 values, -0.1, 0.1 deg/s" in said
        assert "steps between levels" in said


def test_what_is_no_telegraph() -> None:
    slow = ar((0.9995,), N, 1, 9)[0]
    turned = np.where(np.arange(N) // 2500 % 2, 10.0, 0.0) + white(N, 1, 9)[0] * 0.1
    for y in (
        white(N, 1, 1)[0],
        np.rint(0.1 * white(N, 1, 1)[0] + 0.3),
        np.rint(0.3 * slow / slow.std() + 0.4),
        slow,
        lfilter(*butter(2, 0.4), white(3_000, 1, 4)[0]),
        long_recursion(0.6, -0.02, N, 1),
        white(N, 1, 2)[0].cumsum(),
        turned,
        np.ones(N),
        np.full(N, np.nan),
        np.where(np.arange(N) > N // 2, 1.0, 0.0) + 0.01 * white(N, 1, 3)[0],
    ):
        assert found_in(y) is None
