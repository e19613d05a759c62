"""Tests JSON documents: several sensors in one document, facts that stand next to a table, and documents that
pandas writes.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from fltea.recording.files import Stored
from fltea.records.errors import UsageError
from hypothesis import given
from hypothesis import strategies as st

from tests.rig.table_support import open_here

N, RATE_HZ = 300, 100.0
TIMES_S = np.arange(N) / RATE_HZ
DPS = np.random.default_rng(1).normal((0.6, -0.25, 0.15), 1.0, (N, 3))
OTHER_DPS = DPS * 2 + 1
RADS = np.radians(DPS)
ACCEL = np.random.default_rng(2).normal((0.12, -0.25, 9.79), 0.02, (N, 3))


def document(folder: Path, content: Any, **how: Any) -> Stored:
    text = content if isinstance(content, str) else json.dumps(content)
    (folder / "rest.json").write_text(text)
    return open_here("json", folder / "rest.json", **how)


def refusal(folder: Path, content: Any, **how: Any) -> str:
    with pytest.raises(UsageError) as caught:
        document(folder, content, **how)
    return str(caught.value)


def rows(values: np.ndarray, names: str = "x y z", *, timed: bool = True) -> list[dict[str, float]]:
    """Return an object for each sample, with its numbers by name and, if `timed`, its time."""
    found = [dict(zip(names.split(), row, strict=True)) for row in values.tolist()]
    return [{"t": t, **row} for t, row in zip(TIMES_S.tolist(), found, strict=True)] if timed else found


def is_right(found: Stored, dps: np.ndarray = DPS) -> bool:
    whole = found.whole()
    return whole.gyro == pytest.approx(dps, abs=1e-6) and found.rate_hz == pytest.approx(RATE_HZ)


# --- several sensors ---

TWO = {"imu0": rows(DPS, "gx_dps gy_dps gz_dps"), "imu1": rows(OTHER_DPS, "gx_dps gy_dps gz_dps")}


def test_one_of_several_parts_is_asked_for_and_read(tmp_path: Path) -> None:
    text = refusal(tmp_path, TWO)
    assert "which gyroscope is meant of imu0 (300 rows), imu1 (300 rows)" in text
    assert text.endswith("--sensor ?")
    for part, dps in (("imu0", DPS), ("imu1", OTHER_DPS)):
        assert is_right(document(tmp_path, TWO, topic=part), dps)
    bare = {name: rows(values, "gx gy gz", timed=False) for name, values in (("a", DPS), ("b", OTHER_DPS))}
    first, table = refusal(tmp_path, bare).split("\n", 1)
    assert first.endswith("--sensor ? --units ? --rate ?")
    assert "--units rad/s" in table
    assert is_right(document(tmp_path, bare, topic="b", units="dps", rate_hz=RATE_HZ), OTHER_DPS)


@pytest.mark.parametrize("is_first", [True, False])
def test_what_a_part_is_called_tells_the_sensor(tmp_path: Path, is_first: bool) -> None:
    parts = {"accelerometer": rows(ACCEL), "gyroscope": rows(RADS)}
    parts = parts if is_first else dict(reversed(parts.items()))
    text = refusal(tmp_path, parts)
    assert "nothing says the unit of gyroscope.x, gyroscope.y, gyroscope.z. Say it" in text
    found = document(tmp_path, parts, units="rad/s")
    assert is_right(found)
    assert "accelerometer.x, accelerometer.y, accelerometer.z: not read" in found.notes[0].text
    stated = {f"{name}_rad_s" if name == "gyroscope" else name: part for name, part in parts.items()}
    assert is_right(document(tmp_path, stated))


def test_an_accelerometer_is_no_gyroscope(tmp_path: Path) -> None:
    parts = {"accelerometer": {"unit": "rad/s", "data": rows(RADS)}}
    assert "which columns are the gyroscope's axes" in refusal(tmp_path, parts)


@pytest.mark.parametrize("name", ["name", "id", ""])
def test_a_list_of_sensors(tmp_path: Path, name: str) -> None:
    parts = [
        {
            **({name: f"imu{k}"} if name else {}),
            "rate": 100,
            "samples": rows(one, "gx_dps gy_dps gz_dps", timed=False),
        }
        for k, one in enumerate((DPS, OTHER_DPS))
    ]
    first, second = ("imu0", "imu1") if name else ("1", "2")
    asked = refusal(tmp_path, {"sensors": parts})
    assert f"of sensors.{first} (300 rows), sensors.{second} (300 rows)" in asked
    assert is_right(document(tmp_path, {"sensors": parts}, topic=f"sensors.{second}"), OTHER_DPS)
    assert is_right(document(tmp_path, parts, topic=second), OTHER_DPS)


def test_two_gyroscopes_by_their_names(tmp_path: Path) -> None:
    parts = {"gyro1": rows(DPS), "gyro2": rows(OTHER_DPS)}
    assert "of gyro1 (300 rows), gyro2 (300 rows)" in refusal(tmp_path, parts)
    assert is_right(document(tmp_path, parts, topic="gyro2", units="dps"), OTHER_DPS)


def test_a_structure_states_its_unit(tmp_path: Path) -> None:
    content = [
        {"t": t, "gyro_dps": dict(zip("xyz", row, strict=True))}
        for t, row in zip(TIMES_S, DPS.tolist(), strict=True)
    ]
    assert is_right(document(tmp_path, content))
    assert "--units rad/s says otherwise" in refusal(tmp_path, content, units="rad/s")


def test_columns_by_the_positions_that_a_refusal_prints(tmp_path: Path) -> None:
    content = rows(DPS, "p_ q_ r_")
    assert "  2  p_: mean" in refusal(tmp_path, content)
    assert is_right(document(tmp_path, content, columns=["2", "3", "4"], units="dps"))


# --- what pandas writes ---

ORIENTS = "columns", "index", "split", "table", "records"


def frame(*, dated: bool = False) -> pd.DataFrame:
    named = pd.DataFrame(DPS, columns=[f"g{axis}_dps" for axis in "xyz"])
    if dated:
        return named.set_index(pd.to_datetime(TIMES_S, unit="s", origin="2024-05-01"))
    return named.assign(time_s=TIMES_S)


@pytest.mark.parametrize("orient", ORIENTS)
@pytest.mark.parametrize("is_sorted", [False, True])
def test_keys_tell_the_order_of_rows(orient: Any, is_sorted: bool, tmp_path: Path) -> None:
    text = frame().to_json(orient=orient, double_precision=12)
    assert is_right(document(tmp_path, json.dumps(json.loads(text), sort_keys=is_sorted)))
    text = frame().drop(columns="time_s").to_json(orient=orient, double_precision=12)
    found = document(tmp_path, json.dumps(json.loads(text), sort_keys=is_sorted), rate_hz=RATE_HZ)
    assert is_right(found)


@pytest.mark.filterwarnings("ignore:'epoch' date format is deprecated")
@pytest.mark.parametrize("orient", ORIENTS[:4])
@pytest.mark.parametrize("date_format", ["epoch", "iso"])
@pytest.mark.parametrize("date_unit", ["ms", "us", "ns"])
def test_an_index_of_dates_is_the_times(
    orient: Any, date_format: Any, date_unit: Any, tmp_path: Path
) -> None:
    how = {"orient": orient, "date_format": date_format, "double_precision": 12}
    if orient == "table" and date_format == "epoch":
        return  # pandas refuses to write such a document
    text = frame(dated=True).to_json(date_unit=date_unit, **how)
    assert is_right(document(tmp_path, text))


def test_parts_with_numbers_as_names_are_no_rows(tmp_path: Path) -> None:
    parts = {
        "0": {"gx_dps": DPS[:, 0].tolist(), "fs": 100},
        "1": {"gx_dps": OTHER_DPS[:, 0].tolist(), "fs": 100},
    }
    assert "of 0 (300 rows), 1 (300 rows)" in refusal(tmp_path, parts)
    found = document(tmp_path, parts, topic="1")
    assert found.whole().gyro[:, 0].tolist() == OTHER_DPS[:, 0].tolist()


# --- times ---


@pytest.mark.parametrize("form", ["2024-05-01T23:59:59{:09.6f}Z", "23:59:{:09.6f}"])
def test_dates_and_times_of_day_are_times(form: str, tmp_path: Path) -> None:
    stamps = pd.Timestamp("2024-05-01T23:59:58.5") + pd.to_timedelta(TIMES_S, unit="s")
    texts = [one.isoformat() if "T" in form else one.strftime("%H:%M:%S.%f") for one in stamps]
    named = rows(DPS, "gx_dps gy_dps gz_dps", timed=False)
    content = [{"time": text, **row} for text, row in zip(texts, named, strict=True)]
    assert is_right(document(tmp_path, content))
    assert document(tmp_path, content).whole().device_s[-1] == pytest.approx(TIMES_S[-1])


def test_what_python_writes_for_missing_numbers_is_missing(tmp_path: Path) -> None:
    values = DPS.copy()
    values[7, 1], values[9, 0] = np.nan, np.inf
    found = document(tmp_path, rows(values, "gx_dps gy_dps gz_dps"))
    assert found.whole().gyro == pytest.approx(np.delete(DPS, [7, 9], axis=0))


# --- facts (units, rates) next to the table ---


BESIDE: dict[str, dict[str, Any]] = {
    "a unit of the gyroscope": {"metadata": {"gyro_units": "rad/s", "sample_rate": 100}},
    "units by the sensor": {"header": {"units": {"gyro": "rad/s", "accel": "m/s^2"}, "fs": "100 Hz"}},
    "a part about the gyroscope": {
        "config": {"gyro": {"unit": "rad/s", "rate_hz": 100}, "acc": {"unit": "g"}}
    },
    "one unit of all": {"units": "rad/s", "fs_khz": 0.1},
}


@pytest.mark.parametrize("said", BESIDE)
def test_what_stands_beside_a_table_is_stated(said: str, tmp_path: Path) -> None:
    content = {**BESIDE[said], "samples": rows(RADS, "gx gy gz", timed=False)}
    assert is_right(document(tmp_path, content))
    assert "--units dps says otherwise" in refusal(tmp_path, content, units="dps")
    assert "says 100 Hz, and --rate says 200 Hz" in refusal(tmp_path, content, rate_hz=200.0)
    timed = {**BESIDE[said], "samples": rows(RADS, "gx gy gz")}
    assert is_right(document(tmp_path, timed))
    slow = {**timed, "samples": [{**row, "t": 2 * row["t"]} for row in timed["samples"]]}
    assert "50 Hz, and the file states 100 Hz" in refusal(tmp_path, slow)


def test_units_and_names_of_columns_in_lists(tmp_path: Path) -> None:
    content = {
        "columns": ["t", "gx", "gy", "gz"],
        "units": ["ms", "rad/s", "rad/s", "rad/s"],
        "data": np.c_[TIMES_S * 1e3, RADS].tolist(),
    }
    assert is_right(document(tmp_path, content))
    content["units"] = ["ms", "rad/s", "deg/s", "rad/s"]
    assert "in different units" in refusal(tmp_path, content)


def test_units_of_times_and_of_one_sensor_alone(tmp_path: Path) -> None:
    named = rows(RADS, "gx gy gz", timed=False)
    content = {
        "meta": {"time_unit": "ms", "gyro_unit": "rad/s", "accel_unit": "m/s^2"},
        "samples": [
            {"time": 1e3 * t, **row, **dict(zip(("ax", "ay", "az"), one, strict=True))}
            for t, row, one in zip(TIMES_S.tolist(), named, ACCEL.tolist(), strict=True)
        ],
    }
    found = document(tmp_path, content)
    assert is_right(found)
    assert found.whole().accel_ms2 == pytest.approx(ACCEL)


def test_two_facts_of_one_name_are_refused(tmp_path: Path) -> None:
    content = {"metadata": {"fs": 100}, "fs": 200, "samples": rows(DPS, "gx_dps gy_dps gz_dps", timed=False)}
    assert "holds two different fs, and nothing says which of them is right" in refusal(tmp_path, content)


@given(
    place=st.sampled_from(["samples", "data", "rows"]), beside=st.sampled_from(["meta", "metadata", "header"])
)
def test_a_rate_beside_a_table_is_of_it(tmp_path_factory: Any, place: str, beside: str) -> None:
    folder = tmp_path_factory.mktemp("json")
    content = {beside: {"sample_rate": 100}, place: rows(DPS, "gx_dps gy_dps gz_dps", timed=False)}
    assert is_right(document(folder, content))
    assert "sample_rate says 100 Hz, and --rate says 200 Hz" in refusal(folder, content, rate_hz=200.0)
