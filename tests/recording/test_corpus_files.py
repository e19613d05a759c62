"""The generator writes the same example files at each run, so any difference shows a manual change."""

import datetime
import shutil
import time
from pathlib import Path

import openpyxl
import pytest
import scipy.io

from tests.rig import corpus_files

WRITTEN_ONCE = {
    "fltea.mcap": "each recording has a number of its own",
    **dict.fromkeys(("pandas_fixed.h5", "pandas_table.h5"), "PyTables, which nothing else here needs"),
    "ardupilot.mat": "mavlogdump.py of pymavlink",
    "excel_unicode.txt": "text in UTF-16",
}
"""Binary example files that the generator does not write, and what does, or why not."""


def written(folder: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, bytes]:
    """Return the content of the example files that are written with libraries, by the files' names."""
    folder.mkdir()
    for text in corpus_files.HERE.glob("*.csv"):
        shutil.copy(text, folder)
    monkeypatch.setattr(corpus_files, "HERE", folder)
    corpus_files.write_libraries()
    monkeypatch.undo()
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.suffix != ".csv"}


def test_two_runs_write_the_same_bytes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = written(tmp_path / "first", monkeypatch)
    begin = time.time()
    # the time of a file in a zip archive has a resolution of two seconds
    while int(time.time() / 2) == int(begin / 2):
        time.sleep(0.05)
    second = written(tmp_path / "second", monkeypatch)
    binary = {path.name for path in corpus_files.HERE.iterdir() if b"\0" in path.read_bytes()}
    forgotten = binary - {*first, *corpus_files.made_without_libraries(), *WRITTEN_ONCE}
    assert not forgotten, f"tests/rig/corpus_files.py writes no {forgotten}"
    assert [name for name in first if second[name] != first[name]] == []
    assert "gyro_dps" in scipy.io.loadmat(tmp_path / "first/matlab.mat")["imu"].dtype.names
    book = openpyxl.load_workbook(tmp_path / "first/phyphox.xlsx")
    assert book.properties.modified == datetime.datetime(2023, 11, 14)
