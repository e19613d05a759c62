"""What kind of recording a path is: its first bytes say it, or else its ending; and what others are."""

import contextlib
import os
import re
import shlex
import stat
import zipfile
from pathlib import Path
from typing import Any, BinaryIO, Literal, NamedTuple

import msgspec

from fltea.recording import bag_files
from fltea.recording.bag_files import is_bag_folder, is_ros_mcap
from fltea.recording.lines import shown
from fltea.records.errors import UsageError
from fltea.records.small_file import open_stream

Kind = Literal[
    "arrays",
    "bag",
    "csv",
    "feather",
    "hdf5",
    "json",
    "mat",
    "mcap",
    "ndjson",
    "npy",
    "npz",
    "packed",
    "parquet",
    "ulg",
    "xlsx",
]

KINDS: dict[str, Kind] = {
    ".npz": "npz",
    ".npy": "npy",
    ".mcap": "mcap",
    ".mat": "mat",
    ".ulg": "ulg",
    ".xlsx": "xlsx",
    ".json": "json",
    **dict.fromkeys((".parquet", ".pq"), "parquet"),
    **dict.fromkeys((".feather", ".arrow"), "feather"),
    **dict.fromkeys((".h5", ".hdf5", ".hdf"), "hdf5"),
    **dict.fromkeys((".csv", ".txt", ".log", ".tsv", ".dat"), "csv"),
    **dict.fromkeys((".gz", ".bz2", ".xz", ".zip"), "packed"),
    **dict.fromkeys((".ndjson", ".jsonl"), "ndjson"),
    **dict.fromkeys(bag_files.SUFFIXES, "bag"),
}
"""Of an .mcap file and of a folder the content says whether it is ROS' or ours."""

ZIP = b"PK\x03\x04"
MAGIC: dict[bytes, Kind] = {
    ZIP: "npz",
    b"\x93NUMPY": "npy",
    b"PAR1": "parquet",
    b"ARROW1": "feather",
    b"\x89HDF\r\n\x1a\n": "hdf5",
    b"MATLAB 5.0 MAT-file": "mat",
    b"MATLAB 7.3 MAT-file": "hdf5",
    b"ULog\x01\x12\x35": "ulg",
    b"\x1f\x8b": "packed",
    b"BZh": "packed",
    b"\xfd7zXZ": "packed",
    b"\x89MCAP": "mcap",
    bag_files.ROS1: "bag",
    bag_files.SQLITE: "bag",
}
BOM = b"\xef\xbb\xbf"
UTF_16 = b"\xff\xfe", b"\xfe\xff"

BEGIN_BYTES = 512
TEXTS = "csv", "ndjson", "json"
OURS, ARRAY = re.compile(rb'\{\s*"class"'), re.compile(rb"\[\s*\{")
"""How our NDJSON begins, and an array of objects."""

IN_ONE_GO = "csv", "ndjson"
"""Kinds that may come through a pipe."""

FOREIGN: dict[bytes, tuple[str, str]] = {
    b"H Product:Blackbox": (
        "a Betaflight blackbox log. Its own program turns it into CSV, which is read",
        "blackbox_decode {path}",
    ),
    b"\xa3\x95\x80\x80": (
        "an ArduPilot DataFlash log. pymavlink turns its gyroscope into CSV, which is read",
        "mavlogdump.py --format csv --types IMU {path} > imu.csv",
    ),
    b"\xd0\xcf\x11\xe0": (
        "a file of an old Excel (.xls). Save it as .xlsx, or",
        "libreoffice --headless --convert-to csv {path}",
    ),
    b"FEA1": (
        "a Feather file of the first version. pandas writes one that is read",
        "python3 -c \"import pandas, sys; pandas.read_feather(sys.argv[1]).to_csv('imu.csv')\" {path}",
    ),
    **dict.fromkeys(
        (b"\x80\x02", b"\x80\x03", b"\x80\x04\x95", b"\x80\x05\x95"),
        (
            "a pickle of Python. Opening one runs whatever it says, so fltea never does. If it is a table of "
            "pandas and you trust it, turn it into CSV",
            "python3 -c \"import pandas, sys; pandas.read_pickle(sys.argv[1]).to_csv('imu.csv')\" {path}",
        ),
    ),
    b"(\xb5/\xfd": ("packed by zstd. Unpack it", "zstd -d {path}"),
    b"7z\xbc\xaf\x27\x1c": ("an archive of 7-Zip. Unpack it", "7z x {path}"),
    b"Rar!": ("an archive of RAR. Unpack it", "unrar x {path}"),
    b"%PDF": ("a PDF, which holds no samples. Export the numbers as CSV", ""),
    b"\x89PNG": ("a picture, which holds no samples. Export the numbers as CSV", ""),
    b"\xff\xd8\xff": ("a picture, which holds no samples. Export the numbers as CSV", ""),
    b"RIFF": ("a sound or a film, which holds no samples of a gyroscope", ""),
    b"\x7fELF": ("a program", ""),
    b"\xfa\xff": (
        "a log of Xsens, as MT Manager writes it. Export it as text there, or",
        "mtb2txt {path}",
    ),
}
"""What is known and not read: what it is, and the command that makes a file of it that is read."""


class Opened(NamedTuple):
    """A recording that is not our MCAP. file: of a pipe, at its beginning; all else is opened by its path."""

    kind: Kind
    file: BinaryIO | None


def is_one_file(path: Path) -> bool:
    """Whether a path names a recording that is read whole: not our MCAP, whose sessions have many files."""
    if path.is_dir():
        return is_bag_folder(path)
    if is_stream(path):
        return True
    kind = KINDS.get(path.suffix.lower())
    try:
        with path.open("rb") as file:
            kind = kind_of(file.read(BEGIN_BYTES)) or kind
    except (OSError, ValueError):
        return kind not in (None, "mcap")  # opening it will tell why
    return kind != "mcap" or is_ros_mcap(path)


def is_stream(path: Path) -> bool:
    """Whether a path is a pipe, a terminal or the like: read once, from its beginning to its end."""
    try:
        mode = os.stat(path).st_mode
    except (OSError, ValueError):
        return False
    return stat.S_ISFIFO(mode) or stat.S_ISCHR(mode) or stat.S_ISSOCK(mode)


def is_of_this_process(path: Path) -> bool:
    """Whether other processes may find something else behind a path, as behind /dev/stdin."""
    return is_stream(path) or path.is_relative_to("/dev") or path.is_relative_to("/proc")


def kind_of(begin: bytes) -> Kind | None:
    """The kind that the first bytes of a file say without a doubt."""
    return next((kind for magic, kind in MAGIC.items() if begin.startswith(magic)), None)


def open_one_file(path: Path) -> Opened:
    """Open a recording that `is_one_file`. Of a pipe this waits for its first bytes.

    Raises:
        UsageError: it cannot be opened, is of a kind that cannot come through a pipe, or that is not read.
    """
    if path.is_dir():
        return Opened("bag", None)
    with contextlib.ExitStack() as unused:
        try:
            file = unused.enter_context(open_stream(path) if is_stream(path) else path.open("rb"))
            kind = _kind(path, file.peek() if hasattr(file, "peek") else b"")
            if kind == "npz" and not is_stream(path):
                kind = _kind_of_zip(path, file)
        except OSError as error:
            raise UsageError(f"{path}: cannot be read ({error.strerror or error}).") from error
        unused.pop_all()
    if not is_stream(path):
        file.close()
        return Opened("bag" if kind == "mcap" else kind, None)
    if kind not in IN_ONE_GO:
        file.close()
        raise UsageError(
            f"{path}: is a pipe, and .{kind} has to be a file, since it is not read in one go. "
            f"Write it to a file first: cat {path} > recording.{kind}"
        )
    return Opened(kind, file)


def _kind(path: Path, begin: bytes) -> Kind:
    known, by_end = kind_of(begin), KINDS.get(path.suffix.lower())
    if known is not None:
        return known
    for magic, (what, command) in FOREIGN.items():
        if begin.startswith(magic) and by_end != "bag":
            how = f": {command.format(path=shlex.quote(str(path)))}" if command else "."
            raise UsageError(f"{path}: is {what}{how}")
    if not begin:
        raise UsageError(f"{path}: is empty.")
    if by_end not in (*TEXTS, None):
        return by_end
    text = begin.removeprefix(BOM).lstrip()
    if OURS.match(text) or (by_end == "ndjson" and not _is_foreign(text)):
        return "ndjson"
    if ARRAY.match(text) or (by_end == "json" and not _is_foreign(text)):
        return "json"
    most = 0 if by_end is None else len(begin[:BEGIN_BYTES]) // 20
    if begin[:BEGIN_BYTES].count(0) > most and not begin.startswith(UTF_16):
        raise UsageError(
            f"{path}: is neither text nor a kind of file that this program knows (it begins with "
            f"{shown(begin[:8].decode('latin-1'))}). Export it as CSV where it was made."
        )
    return "csv"


def _kind_of_zip(path: Path, file: BinaryIO) -> Kind:
    """What is in an archive: numpy's arrays, a book of Excel, or text."""
    try:
        with zipfile.ZipFile(file) as archive:
            names = archive.namelist()
    except (OSError, ValueError, zipfile.BadZipFile, NotImplementedError):
        return "npz" if path.suffix.lower() == ".npz" else "packed"  # which say what is wrong
    if "xl/workbook.xml" in names:
        return "xlsx"
    if "content.xml" in names:
        command = f"libreoffice --headless --convert-to csv {shlex.quote(str(path))}"
        raise UsageError(f"{path}: is a file of LibreOffice (.ods). Save it as .xlsx or CSV: {command}")
    if "word/document.xml" in names:
        raise UsageError(
            f"{path}: is a text of Word. Copy its table into Excel, and save it as .xlsx or CSV."
        )
    arrays = {name.removesuffix(".npy") for name in names if name.endswith(".npy")}
    if not arrays:
        return "npz" if path.suffix.lower() == ".npz" else "packed"
    return "npz" if "gyro_raw" in arrays or {"gyro_dps", "fs_hz"} <= arrays else "arrays"


def _is_foreign(begin: bytes) -> bool:
    """Whether the first line is an object that fltea has not written: then its keys name columns of text."""
    line, end, _ = begin.partition(b"\n")
    try:
        return bool(end) and "class" not in msgspec.json.decode(line, type=dict[str, Any])
    except (ValueError, RecursionError):
        return False
