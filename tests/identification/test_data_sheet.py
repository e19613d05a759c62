"""Whether a gyroscope is as good as its data sheet: the density is the sheet's, and so are the words."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from fltea.identification.data_sheet import SHEETS, compare, sheet_name
from fltea.records.errors import UsageError
from fltea.records.fit import Interval, Level
from host_support import fltea_here
from identify_files import identify_axis

RATE_HZ = 100.0


def level(density: float) -> Level:
    """The figures of an axis whose density over positive frequencies is known to 1 %."""
    N = density / math.sqrt(2)
    return Level(Interval(N, 0.99 * N, 1.01 * N))


def test_the_density_is_of_positive_frequencies_as_in_a_sheet() -> None:
    """σ² is the density squared times half the sample rate."""
    y = 0.01 * math.sqrt(RATE_HZ / 2) * np.random.default_rng(3).standard_normal(20_000)
    found = compare("MPU-9250", identify_axis(y, 1 / RATE_HZ).level, RATE_HZ)
    assert found.density.value == pytest.approx(0.01, rel=0.02)
    assert (found.kind, found.typical) == ("as good", 0.01)


@pytest.mark.parametrize(
    ("density", "low_pass_hz", "kind", "word"),
    [
        (0.01, None, "as good", "1 times"),
        (0.007, None, "better", "0.7 times"),
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
    """N may be as good as nothing behind one pole, but a sheet's density has what is fast in it, too."""
    N = 0.02 / math.sqrt(2)
    found = compare("MPU-9250", Level(Interval(N, 0.0, 1.01 * N)), RATE_HZ)
    assert found.kind == "noisier"
    assert found.density.low == pytest.approx(0.02 / 1.01)


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
