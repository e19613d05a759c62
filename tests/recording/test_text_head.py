"""The head of a text: names with blanks, units of times, and what plain words state."""

from pathlib import Path

import numpy as np
import pytest
from fltea.recording.files import Stored
from text_files import refusal, stored

N, RATE_HZ = 400, 100.0
GYRO_DPS = np.round(np.random.default_rng(3).normal([0.5, -0.3, 0.2], 0.2, (N, 3)), 5)


def table(head: str, separator: str = ",", times_s: float | None = 1.0, factor: float = 1.0) -> str:
    """Rows behind a head. times_s: of one in the column of times; None: there is none. factor: of the rates."""
    rows = []
    for k, rates in enumerate(GYRO_DPS * factor):
        time = [] if times_s is None else [f"{k / RATE_HZ / times_s:.12g}"]
        rows.append(separator.join([*time, *(f"{rate:.9g}" for rate in rates)]))
    return f"{head}\n" + "\n".join(rows) + "\n"


def is_right(found: Stored) -> bool:
    recording = found.whole()
    is_counted = found.lsb_per_dps or 1.0
    gyro_dps = recording.gyro / is_counted
    is_same = gyro_dps.shape == (N, 3) and np.allclose(gyro_dps, GYRO_DPS, atol=2e-5)
    return is_same and found.rate_hz == pytest.approx(RATE_HZ, rel=1e-6)


NAMES_WITH_BLANKS = {
    "Time [s],Body rate X [deg/s],Body rate Y [deg/s],Body rate Z [deg/s]": (",", 1.0),
    "Time (s);Drehrate X (°/s);Drehrate Y (°/s);Drehrate Z (°/s)": (";", 1.0),
    "Time [s]\tVitesse X [°/s]\tVitesse Y [°/s]\tVitesse Z [°/s]": ("\t", 1.0),
    "loopIteration, time (ms), gyroADC[0] (deg/s), gyroADC[1] (deg/s), gyroADC[2] (deg/s)": (", ", 1e-3),
    "Zeit in s,gx in deg/s,gy in deg/s,gz in deg/s": (",", 1.0),
    "Time [min],Gyro X (deg/s),Gyro Y (deg/s),Gyro Z (deg/s)": (",", 60.0),
    "Time,Gyro X,Gyro Y,Gyro Z\nh,deg/s,deg/s,deg/s": (",", 3600.0),
}


@pytest.mark.parametrize("head", NAMES_WITH_BLANKS)
def test_names_with_blanks_are_split_as_the_rows_are(tmp_path: Path, head: str) -> None:
    separator, times_s = NAMES_WITH_BLANKS[head]
    text = table(head, separator, times_s)
    if head.startswith("loop"):
        first, *rows = text.splitlines()
        text = "\n".join([first, *(f"{k}, {row}" for k, row in enumerate(rows))]) + "\n"
    assert is_right(stored(tmp_path, text))


@pytest.mark.parametrize("units", ["", "\ns;deg/s;deg/s;deg/s"])
def test_names_that_only_blanks_would_tell_apart_are_asked_for(tmp_path: Path, units: str) -> None:
    text = table(f"time_s;wx wy wz;b;c{units}", ";")
    told = refusal(tmp_path, text, units="dps")
    assert told.startswith(":1: nothing says which columns are the gyroscope's axes. Say it")
    assert "2  wx wy wz: mean" in told
    assert is_right(stored(tmp_path, text, units="dps", columns=["2", "3", "4"], time_column="1"))


@pytest.mark.parametrize("unit", ["weeks", "ticks", "10us"])
def test_a_unit_of_times_that_is_not_known_is_asked_for(tmp_path: Path, unit: str) -> None:
    in_row = f"Time,Gyro X,Gyro Y,Gyro Z\n{unit},deg/s,deg/s,deg/s"
    for head in (in_row, f"Time [{unit}],Gyro X (deg/s),Gyro Y (deg/s),Gyro Z (deg/s)"):
        told = refusal(tmp_path, table(head))
        assert f"the file says {unit}" in told
        assert "--time-unit ?" in told
        assert is_right(stored(tmp_path, table(head), time_unit="s"))
        assert is_right(stored(tmp_path, table(head), rate_hz=100.0))


def test_a_stated_unit_of_times_that_the_user_denies_is_an_error(tmp_path: Path) -> None:
    text = table("Time [min],Gyro X (deg/s),Gyro Y (deg/s),Gyro Z (deg/s)", times_s=60.0)
    assert "is in min by its name" in refusal(tmp_path, text, time_unit="s")
