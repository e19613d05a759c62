"""The first error about a file asks for all facts that are missing, and shows a command. With its question
marks filled in, this command reads the file.
"""

from pathlib import Path

import numpy as np
import pytest
from fltea.recording.csv_file import open_csv
from fltea.recording.reading import NotStated
from fltea.settings.how import How

N = 400
GYRO = np.random.default_rng(3).normal(size=(N, 3))


def asked(path: Path, text: str) -> str:
    path.write_text(text)
    with pytest.raises(NotStated) as caught:
        open_csv(path)
    return str(caught.value)


@pytest.mark.parametrize(("step", "unit"), [(10, "ms"), (10_000, "us"), (10_000_000, "ns")])
@pytest.mark.parametrize("name", ["timestamp", "time", "t"])
def test_the_unit_of_times_is_asked_for_together_with_that_of_rates(
    step: int, unit: str, name: str, tmp_path: Path
) -> None:
    rows = "".join(f"{1000 + k * step},{a:.4f},{b:.4f},{c:.4f}\n" for k, (a, b, c) in enumerate(GYRO))
    path = tmp_path / "rest.csv"
    text = asked(path, f"{name},gx,gy,gz\n{rows}")
    assert "--units ? --time-unit ?" in text
    assert f"--time-unit {unit}: 100 Hz" in text
    stored = open_csv(path, How(units="deg/s", time_unit=unit))
    assert (stored.samples, round(stored.rate_hz)) == (N, 100)


def test_a_rate_that_is_given_needs_no_unit_of_times(tmp_path: Path) -> None:
    rows = "".join(f"{k * 7},{a:.4f},{b:.4f},{c:.4f}\n" for k, (a, b, c) in enumerate(GYRO))
    path = tmp_path / "rest.csv"
    path.write_text(f"timestamp,gx_dps,gy_dps,gz_dps\n{rows}")
    assert open_csv(path, How(rate_hz=100.0)).samples == N


def test_a_sensor_is_asked_for_together_with_columns_and_unit(tmp_path: Path) -> None:
    """The example rows in the message are all from one sensor."""
    rows = "".join(
        f"{k / 100},gyro,{a:.4f},{b:.4f},{c:.4f}\n{k / 100},accel,0.01,0.02,9.81\n"
        for k, (a, b, c) in enumerate(GYRO)
    )
    path = tmp_path / "rest.csv"
    text = asked(path, f"time,sensor,x,y,z\n{rows}")
    assert "--columns ?,?,? --sensor ? --units ?" in text
    assert "--sensor accel: 400 rows; x 0.01 ± 0" in text
    stored = open_csv(path, How(columns=["x", "y", "z"], topic="gyro", units="deg/s"))
    assert stored.whole().gyro.tolist() == np.round(GYRO, 4).tolist()


@pytest.mark.parametrize("head", ["timestamp_ns,type,x,y,z\n", ""])
def test_kinds_of_events_at_their_own_rates_are_asked_for_at_once(head: str, tmp_path: Path) -> None:
    """The column `type` has the numbers that Android gives to kinds of events: 4 is a gyroscope, 1 an
    accelerometer.

    The accelerometer has half the gyroscope's rate.
    """
    rows = "".join(
        f"{1_000_000_000 + k * 10_000_000},4,{a:.4f},{b:.4f},{c:.4f}\n"
        + (f"{1_001_000_000 + k * 10_000_000},1,0.01,0.02,9.81\n" if k % 2 else "")
        for k, (a, b, c) in enumerate(GYRO / 100)
    )
    path = tmp_path / "rest.csv"
    text = asked(path, head + rows)
    assert "--columns ?,?,? --sensor ? --units ?" in text
    how = How(columns=["3", "4", "5"], topic="2=4", units="rad/s", time_column="1", time_unit="ns")
    stored = open_csv(path, how)
    assert (stored.samples, round(stored.rate_hz)) == (N, 100)
