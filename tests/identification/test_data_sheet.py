"""Tests that the comparison of a gyroscope with its data sheet uses the density as the sheet defines it."""

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from fltea.identification.data_sheet import SHEETS, compare, on_their_sides, sheet_name
from fltea.records.errors import UsageError
from fltea.records.fit import Interval, Level

from tests.rig.host_support import fltea_here
from tests.rig.identify_files import identify_axis

RATE_HZ = 100.0


def level(density: float, known_to: float = 0.01) -> Level:
    """Return the figures of an axis whose one-sided density of white noise is known with the relative
    uncertainty `known_to`.
    """
    N = density / math.sqrt(2)
    return Level(Interval(N, (1 - known_to) * N, (1 + known_to) * N))


def test_the_density_is_of_positive_frequencies_as_in_a_sheet() -> None:
    """Data sheets state the one-sided density, over positive frequencies only.

    White noise of this density D has the variance D² times half the sample rate.
    """
    y = 0.01 * math.sqrt(RATE_HZ / 2) * np.random.default_rng(3).standard_normal(20_000)
    found = compare("MPU-9250", identify_axis(y, 1 / RATE_HZ).level, RATE_HZ)
    assert found.density.value == pytest.approx(0.01, rel=0.02)
    assert (found.kind, found.typical) == ("as good", 0.01)


@pytest.mark.parametrize(
    ("density", "low_pass_hz", "kind", "word"),
    [
        (0.01, None, "as good", "1 (0.99…1.01) times"),
        (
            0.007,
            None,
            "better",
            "0.7 (0.693…0.707) times the typical 0.01 (low-pass 92 Hz), all below 0.833.",
        ),
        (0.004, None, "better", "check the units"),
        (0.0136, None, "noisier", "a low-pass of 92.5 Hz in the sensor would explain"),
        (0.0136, 92.0, "as good", "which explains 1.4 times"),
        (0.02, 92.0, "noisier", "which explains 1.4 times"),
        (0.0136, 41.0, "noisier", "folds nothing down"),
    ],
)
def test_what_a_low_pass_lets_through_is_counted(
    density: float, low_pass_hz: float | None, kind: str, word: str
) -> None:
    found = compare("MPU-9250", level(density), RATE_HZ, low_pass_hz=low_pass_hz)
    assert found.kind == kind
    assert word in found.text


def test_what_a_fast_relaxation_may_be_of_it_makes_no_sensor_better() -> None:
    """If the sensor has a filter of one pole, the fit may describe most of the white noise as a fast
    relaxation, so that N may be close to zero. The noise density in a data sheet includes that of the
    relaxation. So even if the interval of N reaches down to zero, the sensor does not count as better than
    its data sheet.
    """
    N = 0.02 / math.sqrt(2)
    found = compare("MPU-9250", Level(Interval(N, 0.0, 1.01 * N)), RATE_HZ)
    assert found.kind == "noisier"
    assert found.density.low == pytest.approx(0.02 / 1.01)


@pytest.mark.parametrize(
    ("ratio", "known_to", "kind", "shown"),
    [
        (1.21, 0.002, "noisier", "1.21 (1.21…1.21) times the typical 0.01 (low-pass 92 Hz), all above 1.2."),
        (1.2004, 1e-4, "noisier", "1.2004 (1.2003…1.2005) times"),
        (
            1.203,
            0.005,
            "as good",
            "1.203 (1.197…1.209) times the typical 0.01 (low-pass 92 Hz), not all above 1.2.",
        ),
        (1.1996, 1e-4, "as good", "1.1996 (1.1995…1.1997) times"),
        (0.8325, 1e-4, "better", "0.8325 (0.8324…0.8326) times"),
        (0.4999, 1e-4, "better", "0.4999 (0.4999…0.4999) times"),
    ],
)
def test_the_numbers_that_are_shown_say_what_the_verdict_says(
    ratio: float, known_to: float, kind: str, shown: str
) -> None:
    """In an earlier version, a ratio of 1.21 was shown as 1.2, which counts as good, but the axis was called
    noisier.
    """
    found = compare("MPU-9250", level(0.01 * ratio, known_to), RATE_HZ)
    assert found.kind == kind
    assert shown in found.text


@pytest.mark.parametrize("low_pass_hz", [None, 41.0, 92.0])
def test_no_number_that_is_shown_contradicts_a_verdict(low_pass_hz: float | None) -> None:
    """Rounded densities and ratios in the text do not contradict the verdict.

    The rounded numbers lie on the same side of the limits as the verdict says.
    """
    rng = np.random.default_rng(11)
    kinds = set()
    for near in (0.5, 1 / 1.2, 1.2, 1.2 * math.sqrt(92 / 50)):
        for ratio in near * (1 + rng.normal(0, 3e-3, 60)):
            found = compare("BMI270", level(0.007 * ratio, 1e-3), RATE_HZ, low_pass_hz=low_pass_hz)
            numbers = r"Measured (\S+) \((\S+)…(\S+)\) .*Hz, (\S+) \((\S+)…(\S+)\) times"
            (texts,) = re.findall(numbers, found.text)
            shown = [float(one) for one in texts]
            limits = [float(one) for one in re.findall(r"all above (\d+\.?\d*)", found.text)]
            for low, high in ((shown[1] / 0.007, shown[2] / 0.007), (shown[4], shown[5])):
                for limit in limits:
                    assert (found.kind == "noisier") == (low > limit * (1 + 1e-12))
                assert (found.kind == "better") == (high < 0.833 * (1 - 1e-12))
            assert ("less than half" in found.text) == (shown[3] < 0.5)
            kinds.add(found.kind)
    assert kinds == {"better", "as good", "noisier"}


def test_numbers_have_the_digits_that_show_their_sides() -> None:
    for values, shown in {
        (1.2,): ["1.2"],
        (1.21, 1.0): ["1.21", "1"],
        (1.2001, 1.3): ["1.2001", "1.3"],
        (1.19999, 1.30001): ["1.19999", "1.30001"],
        (1.2, 1.2 + 2e-16): ["1.2", "1.2000000000000002"],
    }.items():
        assert on_their_sides(values, (1.2,)) == shown
    assert on_their_sides([0.01204], ()) == ["0.012"]


def test_a_sheet_is_a_number_too() -> None:
    spelled = (
        "0.007",
        "0,007",
        ",007",
        "7,0 mdps/√Hz",
        "0.007dps/rtHz",
        "0.007 dps/√Hz",
        "7mdps/sqrt(Hz)",
        "0.007 (deg/s)/√Hz",
        "7e-3 °/s/rtHz",
        "0.007 degrees/second / root(Hz)",
        "25.2 deg/h/√Hz",
    )
    assert {sheet_name(text) for text in spelled} == {"0.007"}
    found = compare("0.007", level(0.007), RATE_HZ)
    assert (found.kind, found.part, found.typical) == ("as good", "", 0.007)
    assert "as good as the density that was given. " in found.text
    assert "times the given 0.007." in found.text


@pytest.mark.parametrize(
    "text", ["0.34 deg/√h", "0,34 °/sqrt(hr)", "0.34deg/rt(h)", "0.0056666667 deg/√s", "0.0059341195 rad/√h"]
)
def test_a_sheet_may_state_the_angle_random_walk(text: str) -> None:
    """It is N, in the units in which the program shows N, and √2 N is the density. The ADIS16470's sheet
    states both.
    """
    N = 0.34 / 60
    assert sheet_name(text) == f"{math.sqrt(2) * N:g}"
    assert float(sheet_name(text)) == pytest.approx(SHEETS["ADIS16470"].density, rel=2e-3)
    found = compare(sheet_name(text), Level(Interval(N, 0.99 * N, 1.01 * N)), RATE_HZ)
    assert found.ratio == pytest.approx(1, rel=1e-5)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("MPU", "Nearest: MPU-9250, MPU-6050."),
        ("ICM-20649", "Nearest: ICM-20948"),
        ("lsm6ds3", "Nearest: LSM6DS33, "),
        ("zzz", "is known. Known are MPU-9250, "),
        ("", "is known. Known are MPU-9250, "),
        ("7", "no gyroscope has 7 (deg/s)/√Hz"),
        ("0", "no gyroscope has 0 (deg/s)/√Hz"),
        ("nan", "is known. Known are"),
        ("1,500 mdps/√Hz", "the comma may separate thousands or decimals"),
        ("7,00,0", "is known. Nearest: "),
        ("0.007 furlong/√Hz", "is known. Known are"),
        ("0.3 deg/h/√h", "is known. Known are"),
        ("300 deg/√h", "no gyroscope has 7.07107 (deg/s)/√Hz"),
    ],
)
def test_what_is_no_sheet_is_said_with_what_is_near_and_how_to_give_a_number(text: str, words: str) -> None:
    with pytest.raises(UsageError, match=r"a number in dps/√Hz.*--sheet 0\.007") as refused:
        sheet_name(text)
    assert str(refused.value).startswith(f"--sheet {text}: ")
    assert words in str(refused.value)


def test_the_guide_names_the_parts_that_are_known() -> None:
    guide = Path(__file__).parents[2] / "host/docs/guide/verdict.md"
    named = re.search(r"Known are ([^.]+)\.", guide.read_text())
    assert named is not None
    assert set(re.split(r",\s+|\s+and\s+", named[1])) == set(SHEETS)


def test_counts_that_are_too_coarse_are_told() -> None:
    assert "finer range" in compare("ICM-42688-P", level(0.004), RATE_HZ, lsb=1 / 16.4).text
    assert "finer range" not in compare("ICM-42688-P", level(0.004), RATE_HZ, lsb=1 / 131).text


def test_what_is_not_known_is_not_compared() -> None:
    found = compare("BMI088", Level(), RATE_HZ)
    assert (found.kind, found.ratio, found.density.value) == ("not known", None, None)
    assert "too weak" in found.text


def test_a_part_is_found_as_people_write_it() -> None:
    assert [sheet_name(text) for text in ("mpu9250", "MPU-9250", "icm-42688-p", "ICM42688", "bno 055")] == [
        "MPU-9250",
        "MPU-9250",
        "ICM-42688-P",
        "ICM-42688-P",
        "BNO055",
    ]
    with pytest.raises(UsageError, match="Known are MPU-9250, "):
        sheet_name("MPU")
    assert len(SHEETS) >= 12
    assert all(one.source and 0.001 < one.density < 0.1 for one in SHEETS.values())


def test_the_command_compares_and_says_where_the_figure_is_from(tmp_path: Path) -> None:
    y = np.random.default_rng(1).normal(0.0, 0.0707, (3000, 1))
    np.savetxt(tmp_path / "rest.csv", y, header="gyro_x_dps", comments="")
    command = ("identify", tmp_path / "rest.csv", "--rate", "100", "--shuffles", "0", "--jobs", "1")
    done = fltea_here(*command, "--sheet", "mpu9250", columns=300)
    assert "gyro_x: as good as its data sheet. Measured 0.0" in done.stdout
    assert "PS-MPU-9250A-01 rev. 1.0, 3.1" in done.stdout
    done = fltea_here(*command, "--sheet", "mpu9250", "--json")
    (file,) = json.loads(done.stdout)["files"]
    assert file["axes"]["gyro_x"]["sheet"]["kind"] == "as good"
    assert json.loads(fltea_here(*command, "--json").stdout)["files"][0]["axes"]["gyro_x"]["sheet"] is None
    done = fltea_here(*command, "--sheet", "7mdps/rtHz", columns=300)
    assert "gyro_x: noisier than the density that was given. Measured 0.0" in done.stdout
    assert "Data sheet" not in done.stdout
    done = fltea_here(*command, "--sheet", "MPU-9255", columns=300)
    assert (done.returncode, "Nearest: MPU-9250" in done.stderr) == (2, True)
