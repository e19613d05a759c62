"""Files that would fill the memory or keep a library busy are refused, which takes little memory and time."""

import contextlib
import gzip
import io
import json
import shutil
import struct
import sys
import zipfile
import zlib
from pathlib import Path

import h5py
import numpy as np
import pytest
from fltea.recording import process_limits
from fltea.recording.reader_process import open_in_process
from fltea.records.errors import UsageError
from fltea.settings.how import AS_IT_SAYS, How
from fltea.settings.limits import Limits
from fltea.sources.replay import ReplaySource

from tests.rig.corpus_files import HERE, N
from tests.rig.tiers import slow

MB = 1_000_000
SMALL = Limits(max_mb=64.0)


def sheet_of(rows: int, filler: int = 0) -> bytes:
    """Return an Excel workbook with `rows` rows of one number each, and `filler` blanks in its sheet."""
    cells = b"".join(b'<row r="%d"><c r="A%d"><v>1</v></c></row>' % (k, k) for k in range(1, rows + 1))
    with zipfile.ZipFile(HERE / "phyphox.xlsx") as book:
        files = {info.filename: book.read(info) for info in book.infolist()}
    head, _, _ = files["xl/worksheets/sheet1.xml"].partition(b"<sheetData>")
    sheet = head + b" " * filler + b"<sheetData>" + cells + b"</sheetData></worksheet>"
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for name, data in files.items():
            archive.writestr(name, sheet if name == "xl/worksheets/sheet1.xml" else data)
    return out.getvalue()


def matlab_of(size_bytes: int) -> bytes:
    """Return a MATLAB file with a compressed variable that declares this size."""
    head = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<HH", 0x0100, 0x4D49)
    flags = struct.pack("<IIII", 6, 8, 6, 0) + struct.pack("<IIii", 5, 8, size_bytes // 8, 1)
    data = struct.pack("<II", 1, 4) + b"gyro" + bytes(4) + struct.pack("<II", 9, size_bytes)
    packed = zlib.compress(
        struct.pack("<II", 14, len(flags) + len(data) + size_bytes) + flags + data + bytes(size_bytes), 1
    )
    return head + struct.pack("<II", 15, len(packed)) + packed


def refusal(path: Path, limits: Limits = SMALL, how: How = AS_IT_SAYS) -> str:
    with pytest.raises(UsageError) as caught:
        ReplaySource(path, how=how, limits=limits)
    return str(caught.value)


@pytest.mark.slow
def test_text_that_unpacks_without_end(tmp_path: Path) -> None:
    path = tmp_path / "a.csv.gz"
    path.write_bytes(gzip.compress(b"time_s,gyro_x_dps\n" + b"0,1\n" * 2 * MB, 9))
    assert "unpacks to more than 200 times its size" in refusal(path)
    with zipfile.ZipFile(tmp_path / "a.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("gyro.csv", b"time_s,gyro_x_dps\n" + b"0,1\n" * 2 * MB)
    assert "unpacks to more than 200 times its size" in refusal(tmp_path / "a.zip")
    noise = np.random.default_rng(1).normal(size=100_000)
    text = "time_s,gyro_x_dps\n" + "".join(f"{k / 100},{value:.6f}\n" for k, value in enumerate(noise))
    path.write_bytes(gzip.compress(text.encode(), 1))
    assert "--set replay.max_mb=2" in refusal(path, Limits(max_mb=1.0))
    assert ReplaySource(path)


@pytest.mark.slow
def test_libraries_that_would_fill_the_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(process_limits, "STARTUP_BYTES", 1 << 30)
    bomb = tmp_path / "a.mat"
    bomb.write_bytes(matlab_of(1400 * MB))
    assert bomb.stat().st_size < 10 * MB
    assert "GB would be needed" in refusal(bomb)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("gyro_dps", (10**12, 3), "f8", chunks=(1024, 3), compression="gzip")
        file.create_dataset("t", (10**12,), "f8", chunks=(1024,), compression="gzip")
    assert "a.h5: declares 1000000000000 rows" in refusal(tmp_path / "a.h5")


@pytest.mark.slow
def test_libraries_that_are_kept_busy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(process_limits, "STARTUP_S", 1)
    monkeypatch.setattr("fltea.recording.quota.SECONDS_PER_MB", 0.0)
    path = tmp_path / "a.xlsx"
    path.write_bytes(sheet_of(400_000))
    assert "took more than 0 s of processor time" in refusal(
        path, Limits(seconds=0.0), How(rate_hz=1.0, columns=["1"], units="dps")
    )


@pytest.mark.parametrize(
    "name", ["h5py.h5", "numpy.npz", *map(slow, ("px4.ulg", "matlab.mat", "phyphox.xlsx", "pandas.feather"))]
)
def test_damaged_files_are_refused_or_read(name: str, tmp_path: Path) -> None:
    data = bytearray((HERE / name).read_bytes())
    random = np.random.default_rng(5)
    for cut in (len(data), len(data) // 2):
        changed = data[:cut]
        for place in random.integers(8, cut, 30):
            changed[place] ^= 0xFF
        (tmp_path / name).write_bytes(changed)
        with contextlib.suppress(UsageError):
            ReplaySource(tmp_path / name)


@pytest.mark.slow
def test_json_in_json_without_end(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_bytes(b'[{"a":' * 100_000)
    assert "a.json: cannot be read as JSON" in refusal(path)
    path.write_bytes(b'[{"a": 1},')
    assert refusal(path).endswith(
        "a.json: cannot be read as JSON (Input data was truncated). Is the file whole?"
    )
    path.write_text(json.dumps([{"sensor": "Barometer", "seconds_elapsed": "1"}]))
    assert "is a file of the app Sensor Logger, but has no gyroscope; it has Barometer" in refusal(path)


@pytest.mark.parametrize("entry", [slow(""), ".", slow("here")], ids=["empty", "relative", "absolute"])
def test_code_in_the_current_folder_is_not_run(
    entry: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The folder of a recording may hold files that are named like modules of Python or of a library.

    A reader process (which reads a file with another program's library) must not run them.
    """
    for name in ("resource", "random", "numpy", "pyarrow"):
        (tmp_path / f"{name}.py").write_text(f"open({str(tmp_path / 'has_run')!r}, 'w')\n")
    shutil.copy(HERE / "pandas.parquet", tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [str(tmp_path) if entry == "here" else entry, *sys.path])
    monkeypatch.setenv("PYTHONPATH", ".")
    assert ReplaySource(Path("pandas.parquet"))
    assert not (tmp_path / "has_run").exists()


def test_what_a_library_prints_is_not_what_it_sends(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What a library prints must not mix with the results that a reader process sends. C code prints to file
    descriptor 1 even if Python has redirected its own stdout.
    """
    (tmp_path / "pyulog.py").write_text(
        "import os, sys\n"
        "os.write(1, b'Warning: no subscription found for message id 77.\\n')\n"
        "print('Warning', file=sys.__stdout__, flush=True)\n"
        f"sys.path.remove({str(tmp_path)!r})\n"
        "del sys.modules['pyulog']\n"
        "import pyulog\n"
    )
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    assert open_in_process("ulg", HERE / "px4.ulg", AS_IT_SAYS, SMALL).samples == N
