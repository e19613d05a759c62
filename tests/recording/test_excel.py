"""Tests workbooks of Excel: which sheet is read, and what empty cells and names of sheets mean."""

import gc
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import openpyxl
import pytest
from fltea.recording.files import Stored
from fltea.recording.reader_process import open_text
from fltea.recording.readers.excel import read
from fltea.records.errors import UsageError
from fltea.settings.how import How
from fltea.settings.limits import DEFAULT_LIMITS

pytestmark = pytest.mark.filterwarnings(
    "ignore::ResourceWarning", "ignore::pytest.PytestUnraisableExceptionWarning"
)
"""Ignores warnings about files left open. Normally they are closed when the reader process ends."""


@pytest.fixture(autouse=True)
def closed_files() -> Iterator[None]:
    """Close the files that the reader left open as soon as a test ends. Otherwise Python would close them in
    the middle of another test, with a warning.
    """
    yield
    gc.collect()


N, RATE_HZ = 60, 100.0
TIMES_S = (np.arange(N) / RATE_HZ).tolist()
DPS = np.random.default_rng(1).normal((0.6, -0.25, 0.15), 1.0, (N, 3))
OTHER_DPS = DPS * 2 + 1
ACCEL = np.random.default_rng(2).normal((0.12, -0.25, 9.79), 0.02, (N, 3))

Rows = list[Sequence[Any]]


def sheet(values: np.ndarray, *names: str) -> Rows:
    """Return a row of names, and rows that consist of a time and three numbers."""
    return [names, *([t, *row] for t, row in zip(TIMES_S, values.tolist(), strict=True))]


def workbook(folder: Path, sheets: dict[str, Rows], **how: Any) -> Stored:
    """Write a workbook with these sheets, given by their names, and read it."""
    path = folder / "rest.xlsx"
    book = openpyxl.Workbook()
    book.remove(book.active)
    for title, rows in sheets.items():
        page = book.create_sheet(title)
        for row in rows:
            page.append(list(row))
    book.save(path)
    found = read(path, how.get("topic", ""))
    return open_text(path, found, found.pieces, How(**how), DEFAULT_LIMITS)


def refusal(folder: Path, sheets: dict[str, Rows], **how: Any) -> str:
    with pytest.raises(UsageError) as caught:
        workbook(folder, sheets, **how)
    return str(caught.value)


def is_right(found: Stored, dps: np.ndarray = DPS) -> bool:
    whole = found.whole()
    return whole.gyro == pytest.approx(dps) and found.rate_hz == pytest.approx(RATE_HZ)


STATED, XYZ = ("t", "gx_dps", "gy_dps", "gz_dps"), ("Time", "X", "Y", "Z")


def test_one_of_several_sheets_is_asked_for_and_read(tmp_path: Path) -> None:
    sheets = {"imu0": sheet(DPS, *STATED), "imu1": sheet(OTHER_DPS, *STATED)}
    text = refusal(tmp_path, sheets)
    assert "nothing says which sheet is meant of imu0, imu1" in text
    assert text.endswith("--sensor ?")
    for title, dps in (("imu0", DPS), ("imu1", OTHER_DPS)):
        found = workbook(tmp_path, sheets, topic=title)
        assert is_right(found, dps)
        assert str(found.reading[0]) == f"{title} (given: --sensor)"


def test_all_that_is_missing_is_asked_for_at_once(tmp_path: Path) -> None:
    sheets = {"left": sheet(DPS, "t", "gx", "gy", "gz"), "right": sheet(OTHER_DPS, "t", "gx", "gy", "gz")}
    first, table = refusal(tmp_path, sheets).split("\n", 1)
    assert first.endswith("--sensor ? --units ?")
    assert "--units rad/s" in table
    assert is_right(workbook(tmp_path, sheets, topic="right", units="dps"), OTHER_DPS)
    sheets = {"left": sheet(DPS, "t", "p", "q", "r"), "right": sheet(OTHER_DPS, "t", "p", "q", "r")}
    assert "--sensor ? --columns ?,?,? --units ?\n" in refusal(tmp_path, sheets)
    how = {"topic": "right", "columns": ["2", "3", "4"], "units": "dps"}
    assert is_right(workbook(tmp_path, sheets, **how), OTHER_DPS)


@pytest.mark.parametrize("title", ["Gyroscope", "gyro", "Gyroscope dps"])
def test_what_a_sheet_is_called_tells_the_sensor(tmp_path: Path, title: str) -> None:
    sheets = {
        "Accelerometer": sheet(ACCEL, *XYZ),
        title: sheet(DPS, *XYZ),
        "Magnetometer": sheet(ACCEL, *XYZ),
    }
    if "dps" not in title:
        assert f"nothing says the unit of {title} X, {title} Y, {title} Z" in refusal(tmp_path, sheets)
    assert is_right(workbook(tmp_path, sheets, units="deg/s"))


def test_the_units_of_a_sheet_tell_its_sensor(tmp_path: Path) -> None:
    units = ["s", "deg/s", "deg/s", "deg/s"]
    table = sheet(DPS, *XYZ)
    sheets = {"one": sheet(ACCEL, *XYZ), "two": [table[0], units, *table[1:]]}
    assert is_right(workbook(tmp_path, sheets))


def test_a_summary_before_the_data_is_none(tmp_path: Path) -> None:
    summary: Rows = [["axis", "mean"], *([f"k{k}", k] for k in range(20))]
    assert is_right(workbook(tmp_path, {"Summary": summary, "Data": sheet(DPS, *STATED)}))


@pytest.mark.slow
def test_a_sheet_of_names_and_values_states_facts(tmp_path: Path) -> None:
    names, *rows = sheet(DPS, *STATED)
    bare = [names[1:], *(row[1:] for row in rows)]
    for info in ([["Name", "Value"], ["fs", 100]], [["Sample rate", "100 Hz"]]):
        sheets = {"IMU": bare, "Info": info}
        assert is_right(workbook(tmp_path, sheets))
        assert "stands in the head, and --rate 200 says otherwise" in refusal(tmp_path, sheets, rate_hz=200.0)


def test_lines_above_the_names_state_facts(tmp_path: Path) -> None:
    names, *rows = sheet(DPS, *STATED)
    above: Rows = [["Measurement of 2024-05-01"], ["Sample rate", "100 Hz"], []]
    bare = [*above, names[1:], *(row[1:] for row in rows)]
    assert is_right(workbook(tmp_path, {"IMU": bare}))
    assert "--rate 200 says otherwise" in refusal(tmp_path, {"IMU": bare}, rate_hz=200.0)


def test_empty_cells_at_the_end_of_a_row_are_cells(tmp_path: Path) -> None:
    names, *rows = sheet(DPS, *STATED)
    noted = [[*names, "note"], [*rows[0], "start"], *rows[1:]]
    found = workbook(tmp_path, {"IMU": [["of 1 May"], [], *noted]})
    assert is_right(found)
    assert not found.notes
    holes = [list(row) for row in rows]
    holes[7][3] = None
    found = workbook(tmp_path, {"IMU": [names, *holes]})
    assert found.samples == N - 1
