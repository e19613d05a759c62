"""The committed example files are what their generator writes, on whatever day it runs."""

import bz2
import datetime
import gzip
import io
import lzma
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import openpyxl
import pytest
import scipy.io
from pyarrow import feather, parquet

from tests.rig import corpus_files


def members(data: bytes) -> dict[str, bytes]:
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


WRITTEN_ONCE = {
    "fltea.mcap": "each recording has a number of its own",
    **dict.fromkeys(("pandas_fixed.h5", "pandas_table.h5"), "PyTables, which nothing else here needs"),
    "ardupilot.mat": "mavlogdump.py of pymavlink",
    "excel_unicode.txt": "text in UTF-16",
}
"""Binary example files that the generator does not write. For each file: the program that writes it, or why
the generator does not.
"""


UNPACKED: dict[str, Callable[[bytes], Any]] = {
    ".gz": gzip.decompress,
    ".bz2": bz2.decompress,
    ".xz": lzma.decompress,
    **dict.fromkeys((".zip", ".xlsx", ".npz"), members),
    ".parquet": lambda data: parquet.read_table(io.BytesIO(data)),
    ".feather": lambda data: feather.read_table(io.BytesIO(data)),
}
"""Compressed files are compared by what they contain: maps the end of their names to the function that
returns it. The compressors come with the system, and other versions of them compress the same content to
other bytes.

All other files are compared by their bytes: the generator replaces the times that libraries write into them,
and `constraints.txt` has the libraries' versions.
"""


def written(folder: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, bytes]:
    """Return the content of the example files that are written with libraries, by the files' names."""
    folder.mkdir()
    for text in corpus_files.HERE.glob("*.csv"):
        shutil.copy(text, folder)
    monkeypatch.setattr(corpus_files, "HERE", folder)
    corpus_files.write_libraries()
    monkeypatch.undo()
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.suffix != ".csv"}


def is_same(name: str, made: bytes, committed: bytes) -> bool:
    content = UNPACKED.get(Path(name).suffix, bytes)
    return bool(content(made) == content(committed))


def test_the_generator_writes_the_committed_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = {**written(tmp_path / "made", monkeypatch), **corpus_files.made_without_libraries()}
    here = {path.name: path.read_bytes() for path in corpus_files.HERE.iterdir()}
    forgotten = {name for name, data in here.items() if b"\0" in data} - {*made, *WRITTEN_ONCE}
    assert not forgotten, f"tests/rig/corpus_files.py writes no {forgotten}"
    other = [name for name, data in made.items() if name not in here or not is_same(name, data, here[name])]
    assert not other, f"tests/recording/corpus: {other} differ: run `python -m tests.rig.corpus_files`"
    assert "gyro_dps" in scipy.io.loadmat(tmp_path / "made/matlab.mat")["imu"].dtype.names
    book = openpyxl.load_workbook(tmp_path / "made/phyphox.xlsx")
    assert book.properties.modified == datetime.datetime(2023, 11, 14)
