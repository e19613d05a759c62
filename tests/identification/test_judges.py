"""Tests that data checks find data that are not what they are read as, and find no fault in clean noise."""

from collections.abc import Mapping, Sequence

import numpy as np
import pytest
from fltea.identification.data_checks import DataCheck, axis_data_checks, of_axis, withheld
from fltea.identification.gaps import Gaps, no_gaps
from fltea.identification.judges import judge, judge_one
from fltea.identification.resolution import decimals, step
from fltea.recording.reading import Answer, Evidence, Question
from fltea.records.arrays import Array
from fltea.records.records import ACCEL_AXES, AXES
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.signal import lfilter

from tests.rig.identify_support import H, ar, gauss_markov, white

N = 12_000
IN_RAD_S = np.degrees(1.0)


def judged(
    axes: Mapping[str, Array],
    h: float = H,
    gaps: Gaps | None = None,
    reading: Sequence[Answer] = (),
    lsb: float | None = None,
) -> dict[str, DataCheck]:
    found = judge(axes.__getitem__, dict.fromkeys(axes, lsb), h, gaps or no_gaps(), reading)
    return {data_check.kind: data_check for data_check in found}


def gyro(y: Array, offset: float = 0.0) -> dict[str, Array]:
    return dict(zip(AXES, y + offset, strict=False))


def accel(length: float, n: int = N, noise: float = 0.003) -> dict[str, Array]:
    direction = np.array([0.48, -0.6, 0.64])
    return dict(zip(ACCEL_AXES, length * (direction[:, None] + noise * white(n, 3, 8)), strict=True))


def said(question: Question, evidence: Evidence) -> tuple[Answer, ...]:
    return (Answer(question, "rad/s", evidence, "a test"),)


@pytest.mark.parametrize("lsb", [None, 0.03])
@pytest.mark.parametrize("values", [(-32438, 0, 32438), (-32768, 32767), (0, 16384, 255)])
def test_reads_that_are_no_measurements(values: tuple[int, ...], lsb: float | None) -> None:
    """In an earlier version, data with only full-scale values were called "white noise"."""
    y = 0.03 * np.random.default_rng(1).choice(values, (3, 6000))
    found = judge(gyro(y).__getitem__, dict.fromkeys(AXES, lsb), H, no_gaps())
    broken = [data_check for data_check in found if data_check.kind == "broken reads"]
    assert [(data_check.severity, data_check.axes) for data_check in broken] == [
        ("bad", (name,)) for name in AXES
    ]
    assert f"There are only {len(values)} values" in broken[0].text


def test_good_samples_among_broken_ones_are_groups() -> None:
    y = 0.1 * white(N, 1, 1)[0]
    y[np.random.default_rng(2).random(N) < 0.3] += 400.0
    assert "in groups" in judged({"gyro_x": y})["broken reads"].text


@pytest.mark.parametrize("sigma_lsb", [0.1, 0.3, 0.5, 1.0])
@pytest.mark.parametrize("lsb", [None, 0.1])
def test_coarse_counts_are_no_broken_reads(sigma_lsb: float, lsb: float | None) -> None:
    y = np.rint(white(N, 3, 1) * sigma_lsb + 0.3) * 0.1
    assert "broken reads" not in judged(gyro(y), lsb=lsb)


def test_a_sensor_that_was_turned_has_no_broken_reads() -> None:
    y = white(N, 1, 1)
    y[:, N // 3 : N // 2] += 200
    assert "broken reads" not in judged(gyro(y))


@pytest.mark.parametrize("sensors", [2, 3, 4])
@pytest.mark.parametrize("of", ["gyro", "accel"])
@pytest.mark.parametrize("colour", ["white", "slow"])
def test_sensors_by_turns(sensors: int, of: str, colour: str) -> None:
    """In an earlier version, alternating samples of two equal sensors were called "anti-persistent", with a
    "line at 50 Hz".
    """
    y = white(N, 3, 1) if colour == "white" else ar((0.95,), N, 3, 1) / 3
    biases = np.random.default_rng(sensors).normal(0, 1.0, sensors)
    turns = np.resize(biases, N)
    axes = gyro(y + turns) if of == "gyro" else {**gyro(y), **accel(9.81)}
    if of == "accel":
        axes["accel_y"] = axes["accel_y"] + 0.05 * turns
    data_check = judged(axes)["alternates"]
    assert (data_check.severity, data_check.axes) == ("bad", ())
    assert f"--sensor 1/{sensors} " in data_check.remedy
    assert ("accel_y" if of == "accel" else "gyro_x") in data_check.text


def test_sensors_by_turns_with_a_gap() -> None:
    """After a lost row, the two sensors continue to alternate, one row later."""
    y = white(N, 1, 1) + np.resize([0.5, -0.5], N)
    lost = 2001
    gaps = Gaps(np.array([lost]), np.array([1]))
    assert "alternates" in judged(gyro(np.delete(y, lost, axis=1)), gaps=gaps)


@pytest.mark.parametrize("noise", ["white", "slow"])
def test_rows_between_samples_alternate(noise: str) -> None:
    """Every second row is interpolated, which doubles the rate.

    In an earlier version, such noise was called "low-pass, the sensor's own".
    """
    rng = np.random.default_rng(3)
    y = white(N // 2 + 1, 3, 1) + (gauss_markov(rng, N // 2 + 1, H, 1.0, 1.0) if noise == "slow" else 0)
    both = np.empty((3, N))
    both[:, ::2], both[:, 1::2] = y[:, :-1], (y[:, :-1] + y[:, 1:]) / 2
    assert "ways to scatter" in judged(gyro(both))["alternates"].text


@pytest.mark.parametrize("hz", [49.9, 49.99, 33.3, 25.02])
def test_a_line_near_a_part_of_the_rate_is_none(hz: float) -> None:
    """A spectral line near a half, third or quarter of the sample rate looks like two or more sensors whose
    rows alternate.

    But its amplitude rises and falls slowly. The difference between two sensors stays the same.
    """
    y = white(60_000, 1, 1) + 0.5 * np.sin(2 * np.pi * hz * np.arange(60_000) * H + 1)
    assert "alternates" not in judged(gyro(y))


@pytest.mark.parametrize("every", [100, 50, 33])
def test_a_glitch_in_each_period_is_no_sensor_by_turns(every: int) -> None:
    """Glitches come every 100, 50 or 33 rows, which are multiples of four, two and three. If rows of that
    many sensors alternated, all glitches would be of one sensor. No such sensor is reported.
    """
    y = white(60_000, 3, 1)
    y[:, ::every] += 5.0 * float(y.std())
    assert "alternates" not in judged(gyro(y))


def test_held_values_of_an_accelerometer() -> None:
    """Accelerations are measured at 62.5 Hz and repeated at 200 Hz.

    In an earlier version, they were called "low-pass, the sensor's own".
    """
    n, h = 24_000, 1 / 200
    fresh = accel(9.81, n)
    at = (np.arange(n) * 62.5 / 200).astype(int)
    found = judged({**gyro(white(n, 3, 1)), **{name: y[at] for name, y in fresh.items()}}, h)
    assert set(found) == {"repeated"}
    data_check = found["repeated"]
    assert (data_check.severity, data_check.axes) == ("bad", ACCEL_AXES)
    assert "The values change 62.5 times a second, not 200." in data_check.text


def test_reads_that_fail_by_chance_have_no_rate() -> None:
    y = white(N, 3, 1)
    for i in np.flatnonzero(np.random.default_rng(1).random(N) < 0.2).tolist():
        y[:, i] = y[:, i - 1]
    data_check = judged(gyro(y))["repeated"]
    assert data_check.severity == "bad"
    assert "times a second" not in data_check.text


@pytest.mark.parametrize("places", [2, 3, 4])
def test_one_axis_with_few_decimals_has_no_repeats(places: int) -> None:
    """In an earlier version, 27 of 30 clean series with few decimals were said to have repeated samples."""
    for seed in range(30):
        y = np.round(0.2 + 0.2 * white(N, 1, seed)[0], places)
        assert [data_check.kind for data_check in judge_one(y, "deg/s", None, H)] == []
        uneven = np.round(np.rint(y * 131) / 131, 3)  # counts of 1/131 deg/s, then rounded to three decimals
        assert [data_check.kind for data_check in judge_one(uneven, "deg/s", None, H)] == []


@pytest.mark.parametrize(
    ("length", "severity", "what"),
    [
        (9.81, None, ""),
        (9.2, None, ""),
        (0.05, None, ""),
        (0.99, "bad", "--accel-units g"),
        (998.0, "bad", "--accel-units mg"),
        (9.81 * 9.80665, "bad", "--accel-units m/s^2"),
        (9807.0, "bad", "--accel-units mm/s^2"),
        (5.0, "warning", "lsb:N"),
    ],
)
def test_gravity(length: float, severity: str | None, what: str) -> None:
    """In an earlier version, an accelerometer in g was read as m/s² without a remark, and imu.yaml was
    written.
    """
    data_check = judged(accel(length)).get("gravity")
    assert (data_check and data_check.severity) == severity
    if data_check is not None:
        assert what in data_check.remedy
        assert data_check.axes == ACCEL_AXES
    assert "gravity" not in judged(accel(length), reading=said("accelerometer", "given"))


def test_gravity_takes_all_axes() -> None:
    axes = accel(0.99)
    del axes["accel_z"]
    assert "gravity" not in judged(axes)


@pytest.mark.parametrize(("N_deg", "mean"), [(0.43, 0.3), (1.5, 0.1), (0.12, 0.4)])
def test_a_gyroscope_that_no_mems_is(N_deg: float, mean: float) -> None:
    """A ROS bag with rates in deg/s is read as rad/s by convention, so the rates are 57.3 times too large."""
    y = (N_deg / 60 / np.sqrt(H) * white(N, 3, 1) + mean) * IN_RAD_S
    data_check = judged(gyro(y), reading=said("unit", "convention"))["unit"]
    assert data_check.severity == "bad"
    assert "--units deg/s, or whichever it is" in data_check.remedy
    assert "if the rates are in rad/s" in data_check.text
    assert "unit" not in judged(gyro(y / IN_RAD_S), reading=said("unit", "convention"))
    better: list[Evidence] = ["given", "stated", "dialect"]
    assert not any("unit" in judged(gyro(y), reading=said("unit", one)) for one in better)
    assert "unit" not in judged(gyro(y))


@pytest.mark.parametrize("scale", [131.0, 1000.0, 0.02 * 1000])
def test_whatever_other_unit_would_fit(scale: float) -> None:
    """Rates in counts, mrad/s and other units are read as rad/s by convention."""
    y = (0.7 / 60 / np.sqrt(H) * white(N, 3, 1) + 0.6) * IN_RAD_S * scale
    assert judged(gyro(y), reading=said("unit", "convention"))["unit"].severity == "bad"


def test_a_sensor_that_moves_is_not_doubted() -> None:
    """The unit is judged by a quiet part of the record if there is one.

    If the sensor shakes in all parts of the record, the accelerometer shows that, and the unit is not
    doubted.
    """
    y = 10.0 * white(N, 3, 1)
    assert "unit" in judged(gyro(y), reading=said("unit", "convention"))
    shaken = {**gyro(y), **accel(9.81, noise=0.2)}
    assert "unit" not in judged(shaken, reading=said("unit", "convention"))
    y[:, N // 2 : N * 3 // 4] /= 100
    assert "unit" not in judged(gyro(y), reading=said("unit", "convention"))


@pytest.mark.parametrize(
    ("quantum", "unit", "written"),
    [
        (0.01, "deg/s", "0.01 deg/s"),
        (0.01 * IN_RAD_S, "deg/s", "0.01 rad/s"),
        (1e-3 * IN_RAD_S, "deg/s", "0.001 rad/s"),
        (10 / 3600, "deg/s", "10 deg/h"),
        (0.001 * 9.80665, "m/s²", "0.001 g"),
        (1.0, "m/s²", "1 m/s²"),
        *((one, "deg/s", "") for one in (1 / 131, 1 / 16.4, 0.07, 0.0175, 0.00875, 250 / 32768, 1 / 16)),
        *((one * 9.80665, "m/s²", "") for one in (1 / 16384, 1 / 2048, 0.000061, 0.0039)),
    ],
)
def test_decimals_are_told_from_counts(quantum: float, unit: str, written: str) -> None:
    assert decimals(quantum, unit) == written


@pytest.mark.parametrize("sigma", [0.02, 0.12])
def test_rounding_by_decimals_is_not_the_sensors(sigma: float) -> None:
    """In an earlier version, white noise rounded to 0.01 rad/s led to a file for a filter, and to the advice
    "choose a smaller range".
    """
    y = np.round(0.01 * (sigma * white(N, 1, 1)[0] + 0.47), 2) * IN_RAD_S
    (data_check,) = (
        data_check for data_check in axis_data_checks(y, H) if data_check.kind in ("decimals", "quantisation")
    )
    assert (data_check.kind, data_check.severity) == ("decimals", "bad")
    assert "steps of 0.01 rad/s" in data_check.text
    assert "write more of them" in data_check.remedy
    assert "0.01" not in withheld(
        data_check for data_check in axis_data_checks(y, H, 0.01 * IN_RAD_S) if data_check.kind == "decimals"
    )


def test_the_step_of_many_values() -> None:
    assert step(np.round(white(3000, 1, 1)[0], 3)) == pytest.approx(1e-3)
    assert step(white(3000, 1, 1)[0]) is None
    assert step(np.ones(100)) is None


def test_what_is_bad_withholds() -> None:
    found = [
        DataCheck("a", "bad", "A.", "Do a.", ("gyro_x",)),
        DataCheck("b", "warning", "B.", ""),
        DataCheck("c", "bad", "C.", ""),
    ]
    assert withheld(found) == "A. Do a. C. "
    assert withheld(of_axis(found, "gyro_y")) == "C. "
    assert withheld(found[1:2]) == ""


@given(
    st.integers(0, 10**6),
    st.sampled_from(["white", "AR(.9)", "AR(-.8)", "t4"]),
    st.sampled_from([None, 0.3, 0.7, 2.0, 20.0]),
    st.integers(1, 3),
    st.booleans(),
)
@example(0, "AR(-.8)", 0.7, 1, False)
def test_no_alarm(seed: int, kind: str, sigma_lsb: float | None, axes: int, known: bool) -> None:
    y = {
        "white": lambda: white(3000, axes, seed),
        "AR(.9)": lambda: ar((0.9,), 3000, axes, seed) * 0.44,
        "AR(-.8)": lambda: ar((-0.8,), 3000, axes, seed) * 0.6,
        "t4": lambda: np.random.default_rng(seed).standard_t(4, (axes, 3000)) / 2**0.5,
    }[kind]()
    lsb = None if sigma_lsb is None else 0.1 / sigma_lsb
    y = 0.1 * y if lsb is None else np.rint(0.1 * y / lsb) * lsb
    reading = (*said("unit", "convention"), *said("accelerometer", "convention"))
    assert judged(gyro(y, 0.4), reading=reading, lsb=lsb if known else None) == {}


@pytest.mark.long
@pytest.mark.parametrize("rate_hz", [50.0, 200.0, 1000.0])
def test_no_alarm_in_many_clean_records(rate_hz: float) -> None:
    """The data checks find nothing in a hundred clean records of 100 s to 20 min.

    The records are of gyroscopes and accelerometers, with coarse and fine counts, and with white and coloured
    noise.
    """
    for seed in range(100):
        rng = np.random.default_rng((int(rate_hz), seed))
        n = int(rate_hz * rng.choice([100, 300, 1200 if rate_hz < 500 else 100]))
        pole = rng.choice([0.0, 0.9, -0.8, 0.999])
        axes = {}
        for name in (*AXES[: rng.integers(1, 4)], *ACCEL_AXES[: 3 * rng.integers(0, 2)]):
            y = rng.standard_t(5, n) if seed % 5 == 0 else lfilter([1], [1, -pole], rng.standard_normal(n))
            y = 0.1 * (y / y.std() if seed % 3 else y / y.std() + rng.standard_normal(n))
            y += 9.81 if name == "accel_z" else 0.0 if name in ACCEL_AXES else rng.normal(0, 1)
            quantum = 0.1 / rng.choice([0.5, 1, 3, 30])
            axes[name] = np.rint(y / quantum) * quantum if rng.random() < 0.7 else y
        reading = (*said("unit", "convention"), *said("accelerometer", "convention"))
        assert judged(axes, 1 / rate_hz, reading=reading) == {}, seed
