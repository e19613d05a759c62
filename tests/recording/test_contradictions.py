"""A file whose statements contradict each other is refused; one whose statements differ slightly is not."""

from pathlib import Path

import numpy as np
import pytest

from tests.rig.text_files import refusal, stored

N = 60
_random = np.random.default_rng(7)
GYRO = 0.02 * _random.normal(size=(N, 3)) + [0.6, -0.6, 0.5]
ACCEL = 0.02 * _random.normal(size=(N, 3)) + [0.1, -0.2, 9.81]
TIMES_S = np.arange(N) / 100
NAMES = "time_s,gx [deg/s],gy [deg/s],gz [deg/s]"


def table(names: str, *columns: np.ndarray) -> str:
    rows = np.column_stack(columns).tolist()
    return "\n".join([names, *(",".join(map(repr, row)) for row in rows)]) + "\n"


@pytest.mark.parametrize(
    "other",
    [
        TIMES_S * 1000 * 1.02 + 7e6,
        TIMES_S * 1000 + _random.exponential(5, N).cumsum(),
        np.floor(TIMES_S),
        np.full(N, np.nan),
        _random.normal(size=N),
    ],
    ids=["a clock that drifts", "times of arrival", "whole seconds", "an empty column", "no clock"],
)
def test_other_columns_of_times_that_are_no_even_clock_of_another_rate_do_not_matter(
    other: np.ndarray, tmp_path: Path
) -> None:
    found = stored(tmp_path, table(f"{NAMES},host_time_ms", TIMES_S, GYRO, other))
    assert found.rate_hz == pytest.approx(100.0)


def test_two_clocks_of_different_rates_are_asked_about(tmp_path: Path) -> None:
    text = table(f"{NAMES},host_time_ms", TIMES_S, GYRO, 2000 * TIMES_S)
    why = refusal(tmp_path, text)
    assert "which clock is right: time_s, host_time_ms differ by a factor of 2." in why
    assert "--time-column ?" in why
    assert stored(tmp_path, text, time_column="time_s").rate_hz == pytest.approx(100.0)
    assert stored(tmp_path, text, time_column="host_time_ms").rate_hz == pytest.approx(50.0)
    without_unit = text.replace("host_time_ms", "host_time")
    assert "differ by a factor of 2." in refusal(tmp_path, without_unit)
    thousandths = table(f"{NAMES},host_time", TIMES_S, GYRO, 1e6 * TIMES_S)
    assert stored(tmp_path, thousandths).rate_hz == pytest.approx(100.0)


def test_gravity_in_the_columns_of_the_gyroscope_is_refused(tmp_path: Path) -> None:
    text = table(f"{NAMES},ax [m/s^2],ay [m/s^2],az [m/s^2]", TIMES_S, ACCEL, GYRO)
    assert "have the length of gravity" in refusal(tmp_path, text)
    assert stored(tmp_path, text, overrule=True).whole().gyro[:, 2].mean() == pytest.approx(9.81, abs=0.02)
    names = ["gx [deg/s]", "gy [deg/s]", "gz [deg/s]"]
    assert stored(tmp_path, text, columns=names).samples == N


def test_a_bias_as_long_as_gravity_is_one_beside_an_accelerometer_with_gravity(tmp_path: Path) -> None:
    long = GYRO / np.linalg.norm(GYRO.mean(axis=0))
    text = table(f"{NAMES},ax [g],ay [g],az [g]", TIMES_S, long, ACCEL / 9.80665)
    assert np.linalg.norm(stored(tmp_path, text).whole().gyro.mean(axis=0)) == pytest.approx(1.0)
    gone = table(f"{NAMES},ax [m/s^2],ay [m/s^2],az [m/s^2]", TIMES_S, long, ACCEL - [0, 0, 9.81])
    assert stored(tmp_path, gone).samples == N


def test_an_accelerometer_in_mg_or_cm_s2_is_not_read_before_the_user_says_which(tmp_path: Path) -> None:
    text = table(f"{NAMES},ax,ay,az", TIMES_S, GYRO, 100 * ACCEL)
    found = stored(tmp_path, text)
    assert found.whole().accel_ms2 is None
    (answer,) = [one for one in found.reading if one.question == "accelerometer"]
    assert "the length of gravity in mg or cm/s^2; --accel-units says it" in str(answer)
    accel_ms2 = stored(tmp_path, text, accel_units="cm/s^2").whole().accel_ms2
    assert np.allclose(accel_ms2, ACCEL, atol=1e-3)
    assert "gravity in mg or cm/s^2, and --accel-units g" in refusal(tmp_path, text, accel_units="g")


@pytest.mark.parametrize(("scale", "shown"), [(1.0, "m/s^2"), (1000 / 9.81, "mg or cm/s^2")])
def test_columns_that_have_the_length_of_gravity_are_no_rates(
    scale: float, shown: str, tmp_path: Path
) -> None:
    text = table("a,b,c", scale * ACCEL)
    how = {"columns": ["a", "b", "c"], "rate_hz": 100.0}
    assert f", as gravity in {shown}: are they accelerations?" in refusal(tmp_path, text, **how)
    assert f"which is gravity in {shown}: they seem an accelerometer's" in refusal(
        tmp_path, text, units="dps", **how
    )
    assert stored(tmp_path, text, units="dps", overrule=True, **how).samples == N
    # as rates in deg/s, these values would be a usual offset of a gyroscope
    in_g = table("a,b,c", ACCEL / 9.81)
    assert stored(tmp_path, in_g, units="dps", **how).samples == N
    assert "gravity in g" in refusal(tmp_path, in_g, units="rad/s", **how)
    assert stored(tmp_path, text.replace("a,b,c", "gx [dps],gy [dps],gz [dps]"), rate_hz=100.0).samples == N


def test_a_unit_of_accelerations_that_gravity_contradicts_is_refused(tmp_path: Path) -> None:
    text = table(f"{NAMES},ax,ay,az", TIMES_S, GYRO, ACCEL)
    assert "is that of gravity in m/s^2, and --accel-units g says otherwise" in refusal(
        tmp_path, text, accel_units="g"
    )
    found = stored(tmp_path, text, accel_units="g", overrule=True).whole()
    assert found.accel_ms2 is not None
    assert found.accel_ms2[:, 2].mean() == pytest.approx(9.81 * 9.80665, rel=1e-3)


@pytest.mark.parametrize("rate_hz", [50.0, 200.0])
def test_a_rate_against_dates_is_refused(rate_hz: float, tmp_path: Path) -> None:
    lines = [f"2023-11-14T22:13:20.{k:02}0Z,{x},{y},{z}" for k, (x, y, z) in enumerate(GYRO.tolist())]
    text = "\n".join([NAMES.replace("time_s", "when"), *lines]).replace("when", "timestamp") + "\n"
    assert f"by its times the rate is 100 Hz, and --rate {rate_hz:g} says otherwise" in refusal(
        tmp_path, text, rate_hz=rate_hz
    )
    assert stored(tmp_path, text, rate_hz=rate_hz, overrule=True).rate_hz == rate_hz
    assert "nothing says the rate: a step of 0.01 ms is no gyroscope's" in refusal(
        tmp_path, text, time_unit="ms"
    )


def test_a_rate_that_is_far_below_that_of_a_coarse_clock_is_refused(tmp_path: Path) -> None:
    text = table(NAMES, np.floor(TIMES_S * 25) / 25, GYRO)
    assert "by its times the rate is 100 Hz, and --rate 20 says otherwise" in refusal(
        tmp_path, text, rate_hz=20.0
    )
    assert "and --rate 500 says otherwise" in refusal(tmp_path, text, rate_hz=500.0)
    assert stored(tmp_path, text, rate_hz=100.0).rate_hz == 100.0
