"""Finds the format of a recording by its first bytes, or else by the ending of its name."""

import contextlib
import os
import re
import stat
import zipfile
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import msgspec

from fltea.recording.bag_files import is_bag_folder, is_ros_mcap
from fltea.recording.column_names import times_in
from fltea.recording.formats import FORMATS, KINDS, MAGIC, UNREAD, ZIP, Kind
from fltea.recording.raw_lines import BOM, UTF_16, shown
from fltea.recording.text_fields import rows_alike
from fltea.records.errors import UsageError
from fltea.records.small_file import open_stream

BEGIN_BYTES = 512
FEWEST_ROWS = 2
"""A file with at least this many rows of numbers is read as text, whatever the ending of its name."""

TEXTS = "csv", "ndjson", "json"
OURS, ARRAY = re.compile(rb'\{\s*"class"'), re.compile(rb"\[\s*\{")
"""Patterns that match the beginning of fltea's own NDJSON, and the beginning of a JSON array of objects."""


class Opened(NamedTuple):
    """Format of a recording that is one file, and the open file if it is a pipe.

    `file`: the open pipe, of which nothing has been read; None: the recording can be opened by its path.
    """

    kind: Kind
    file: BinaryIO | None


def is_one_file(path: Path) -> bool:
    """Return whether a path is a whole recording by itself: a file, a pipe or the folder of a bag.

    An MCAP file of fltea is no whole recording, since all files of a session belong together.
    """
    if path.is_dir():
        return is_bag_folder(path)
    if is_stream(path):
        return True
    kind = KINDS.get(path.suffix.lower())
    try:
        with path.open("rb") as file:
            kind = kind_of(file.read(BEGIN_BYTES)) or kind
    except (OSError, ValueError):
        return kind not in (None, "mcap")  # opening the file later reports why it is unreadable
    return kind != "mcap" or is_ros_mcap(path)


def is_stream(path: Path) -> bool:
    """Return whether a path is a pipe, a terminal or a socket, which can be read only once."""
    try:
        mode = os.stat(path).st_mode
    except (OSError, ValueError):
        return False
    return stat.S_ISFIFO(mode) or stat.S_ISCHR(mode) or stat.S_ISSOCK(mode)


def is_of_this_process(path: Path) -> bool:
    """Return whether a path, such as /dev/stdin, may mean another file in another process."""
    return is_stream(path) or path.is_relative_to("/dev") or path.is_relative_to("/proc")


def kind_of(begin: bytes) -> Kind | None:
    """Return the format that the first bytes of a file prove; None if these bytes prove no format."""
    return next((kind for magic, kind in MAGIC.items() if begin.startswith(magic)), None)


def open_one_file(path: Path) -> Opened:
    """Open a recording that is one file; for a pipe, wait until its first bytes arrive.

    Raises:
        UsageError: the file cannot be opened, its format cannot come through a pipe, or fltea does not read
            it.
    """
    if path.is_dir():
        return Opened("bag", None)
    with contextlib.ExitStack() as unused:
        try:
            file = unused.enter_context(open_stream(path) if is_stream(path) else path.open("rb"))
            kind = kind_of_file(path, file)
        except OSError as error:
            raise UsageError(f"{path}: cannot be read ({error.strerror or error}).") from error
        if is_stream(path):
            if not FORMATS[kind].pipe:
                raise UsageError(
                    f"{path}: is a pipe, and {FORMATS[kind].title} has to be a file, since it is not read "
                    f"from beginning to end. Write what comes out of it to a file first "
                    "('> recording'), and name that."
                )
            unused.pop_all()
            return Opened(kind, file)
    return Opened("bag" if kind == "mcap" else kind, None)


def kind_of_file(path: Path, file: Any) -> Kind:
    """Return the format of an open file, by its first bytes or the ending of its name.

    `file`: the open file. If it has no method `peek`, like a terminal, only its name decides.

    Raises:
        UsageError: the file is empty, or fltea does not read its format.
        OSError: the file cannot be read.
    """
    begin = file.peek() if hasattr(file, "peek") else b""
    known, by_end = kind_of(begin), KINDS.get(path.suffix.lower())
    if known is not None:
        return _kind_of_zip(path, file) if begin.startswith(ZIP) and file.seekable() else known
    for one in UNREAD:
        if any(begin.startswith(magic, one.at) for magic in one.magic) and by_end != "bag":
            raise UsageError(one.told(path))
    if not begin:
        raise UsageError(f"{path}: is empty.")
    if by_end not in (None, "ndjson") and not begin.startswith((b"{", b"[")) and _has_rows(begin):
        return "csv"
    if by_end is not None and by_end not in TEXTS and FORMATS[by_end].is_certain:
        return by_end
    return _kind_of_text(path, begin, by_end if by_end in TEXTS else None)


def _has_rows(begin: bytes) -> bool:
    """Return whether the first bytes are text with rows of numbers, whatever the ending of the name."""
    if any(byte < ord("\t") or ord("\r") < byte < ord(" ") for byte in begin[:BEGIN_BYTES]):
        return False
    kind, rows = rows_alike(begin[:BEGIN_BYTES].decode("latin-1").splitlines()[:-1])
    return kind == "row" and len(rows) >= FEWEST_ROWS


def _kind_of_text(path: Path, begin: bytes, by_end: Kind | None) -> Kind:
    """Return the format of a text: fltea's NDJSON, JSON, or other text, which is read as CSV.

    `by_end`: format by the ending of the file's name.
    """
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
    """Return the format of a zip archive, such as arrays of numpy, an Excel workbook or a compressed file."""
    # if the archive cannot be read, the reader of this format reports what is wrong with the file
    by_end = "npz" if path.suffix.lower() == ".npz" else "compressed"
    try:
        with zipfile.ZipFile(file) as archive:
            names = archive.namelist()
    except (OSError, ValueError, zipfile.BadZipFile, NotImplementedError):
        return by_end
    for kind, form in FORMATS.items():
        if form.member and form.member in names:
            return kind
    for one in UNREAD:
        if one.member and one.member in names:
            raise UsageError(one.told(path))
    arrays = {name.removesuffix(".npy") for name in names if name.endswith(".npy")}
    if not arrays:
        return by_end
    is_ours = "fs_hz" in arrays and ("gyro_dps" in arrays or {"gyro_raw", "lsb_per_dps"} <= arrays)
    has_other_times = times_in(sorted(arrays - {"time_s", "t_host_s"}))
    return "npz" if is_ours and not has_other_times else "arrays"


def _is_foreign(begin: bytes) -> bool:
    """Return whether a text's first line is a JSON object that another program wrote, not fltea.

    The keys of such an object are names of columns.
    """
    line, end, _ = begin.partition(b"\n")
    try:
        return bool(end) and "class" not in msgspec.json.decode(line, type=dict[str, Any])
    except (ValueError, RecursionError):
        return False
