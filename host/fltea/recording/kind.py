"""What kind of recording a path is: its ending says it, or without one, and of a pipe, its first bytes."""

import os
import stat
from pathlib import Path
from typing import Any, BinaryIO, Literal, NamedTuple

import msgspec

from fltea.recording import bag_files
from fltea.recording.bag_files import is_bag_folder, is_ros_mcap
from fltea.records.errors import UsageError

Kind = Literal["npz", "npy", "parquet", "csv", "ndjson", "mcap", "bag"]

KINDS: dict[str, Kind] = {
    ".npz": "npz",
    ".npy": "npy",
    ".mcap": "mcap",
    **dict.fromkeys((".parquet", ".pq"), "parquet"),
    **dict.fromkeys((".csv", ".txt", ".log", ".tsv", ".dat"), "csv"),
    **dict.fromkeys((".ndjson", ".jsonl"), "ndjson"),
    **dict.fromkeys(bag_files.SUFFIXES, "bag"),
}
"""Of an .mcap file and of a folder the content says whether it is ROS' or ours."""

MAGIC: dict[bytes, Kind] = {
    b"PK\x03\x04": "npz",
    b"\x93NUMPY": "npy",
    b"PAR1": "parquet",
    b"\x89MCAP": "mcap",
    bag_files.ROS1: "bag",
    bag_files.SQLITE: "bag",
}
BOM = b"\xef\xbb\xbf"


class Opened(NamedTuple):
    """A recording that is not our MCAP. file: of a pipe, at its beginning; all else is opened by its path."""

    kind: Kind
    file: BinaryIO | None


def is_one_file(path: Path) -> bool:
    """Whether a path names a recording that is read whole: not our MCAP, whose sessions have many files."""
    if path.is_dir():
        return is_bag_folder(path)
    if path.suffix.lower() in KINDS:
        if path.suffix.lower() == ".mcap" and path.is_file():
            return is_ros_mcap(path)
        return KINDS[path.suffix.lower()] != "mcap" or is_stream(path)
    if is_stream(path):
        return True
    if path.suffix or not path.is_file():
        return False
    try:
        with path.open("rb") as file:
            return _kind_of_content(file) != "mcap" or is_ros_mcap(path)
    except OSError:
        return True  # opening it will tell why


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


def open_one_file(path: Path) -> Opened:
    """Open a recording that `is_one_file`. Of a pipe this waits for its first bytes.

    Raises:
        UsageError: it cannot be opened, or is of a kind that cannot come through a pipe.
    """
    if path.is_dir():
        return Opened("bag", None)
    try:
        file = path.open("rb")
        kind = KINDS.get(path.suffix.lower()) or _kind_of_content(file)
        if kind == "ndjson" and _is_foreign(file.peek()):
            kind = "csv"
    except OSError as error:
        raise UsageError(f"{path}: cannot be read ({error.strerror or error}).") from error
    if not is_stream(path):
        file.close()
        return Opened("bag" if kind == "mcap" else kind, None)
    if kind in ("npz", "npy", "parquet", "mcap", "bag"):
        file.close()
        raise UsageError(
            f"{path}: is a pipe, and .{kind} has to be a file, since it is not read in one go. "
            f"Write it to a file first: cat {path} > recording.{kind}"
        )
    return Opened(kind, file)


def _is_foreign(begin: bytes) -> bool:
    """Whether the first line is an object that fltea has not written: then its keys name columns of text."""
    line, end, _ = begin.removeprefix(BOM).lstrip().partition(b"\n")
    try:
        return bool(end) and "class" not in msgspec.json.decode(line, type=dict[str, Any])
    except (ValueError, RecursionError):
        return False


def _kind_of_content(file: BinaryIO) -> Kind:
    """By the first bytes, which stay unread."""
    begin = file.peek() if hasattr(file, "peek") else b""
    for magic, kind in MAGIC.items():
        if begin.startswith(magic):
            return kind
    return "ndjson" if begin.removeprefix(BOM).lstrip().startswith(b"{") else "csv"
