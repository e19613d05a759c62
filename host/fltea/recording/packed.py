"""Text that is packed: gzip, bzip2, xz, or the one file of an archive (.zip) that holds a gyroscope."""

import bz2
import contextlib
import gzip
import lzma
import shlex
import zipfile
import zlib
from pathlib import Path, PurePosixPath
from typing import Any, BinaryIO, cast

from fltea.recording.csv_file import open_csv
from fltea.recording.files import Note, Stored, listed
from fltea.recording.kind import KINDS
from fltea.recording.quota import Quota
from fltea.records.errors import UsageError
from fltea.settings.how import How
from fltea.settings.limits import Limits

OPENERS: dict[bytes, Any] = {b"\x1f\x8b": gzip.open, b"BZh": bz2.open, b"\xfd7zXZ": lzma.open}
DAMAGE = (OSError, ValueError, zlib.error, lzma.LZMAError, zipfile.BadZipFile, NotImplementedError)
"""What libraries raise on damaged bytes, and RuntimeError for an archive with a password."""

LIKELY = ("gyro", "imu", "raw data", "angular", "rotation")
"""Words in names of files with a gyroscope, the likeliest first: phone apps write a file for each sensor."""

BESIDE = ("meta", "__macosx", "readme", "license")
"""Words in the paths of files that hold none."""


def open_packed(path: Path, how: How, limits: Limits) -> Stored:
    """Read text as `open_csv` does.

    Raises:
        UsageError: it is damaged, unpacks to more than the quota, is no text, or which file of an archive is
            meant is not clear.
    """
    quota = Quota(path, limits)
    try:
        with contextlib.ExitStack() as stack:
            file = stack.enter_context(path.open("rb"))
            begin = file.peek()
            opener = next((found for magic, found in OPENERS.items() if begin.startswith(magic)), None)
            if opener is not None:
                stream, place = stack.enter_context(opener(file)), path
            else:
                archive = stack.enter_context(zipfile.ZipFile(file))
                member = _member(path, archive)
                stream, place = stack.enter_context(archive.open(member)), path / member.filename
            counted = _Counted(stream, quota)
            found = open_csv(place, how, limits, cast(BinaryIO, counted))
            if not counted.is_cut:
                return found
            note = Note("cut_recording", f"{path}: is cut off; what can be unpacked is read.")
            return found._replace(notes=(note, *found.notes))
    except (*DAMAGE, RuntimeError) as error:
        raise UsageError(f"{path}: cannot be unpacked ({error}). Is the file whole?") from error


def _member(path: Path, archive: zipfile.ZipFile) -> zipfile.ZipInfo:
    files = [info for info in archive.infolist() if not info.is_dir()]
    rest = [info for info in files if not any(word in info.filename.lower() for word in BESIDE)]
    for word in LIKELY:
        found = [info for info in rest if word in PurePosixPath(info.filename).name.lower()]
        if len(found) == 1:
            return found[0]
    if len(rest) == 1:
        return rest[0]
    if not any(PurePosixPath(info.filename).suffix.lower() in KINDS for info in rest):
        raise UsageError(
            f"{path}: is an archive without a recording ({listed([i.filename for i in files])})."
        )
    raise UsageError(
        f"{path}: holds {len(files)} files, and which has the gyroscope is not known "
        f"({listed([info.filename for info in files])}). Unpack it, and name the file: "
        f"python3 -m zipfile -e {shlex.quote(str(path))} ."
    )


class _Counted(contextlib.AbstractContextManager["_Counted"]):
    """What unpacks, a piece at a time; each is counted. is_cut: the end of it was missing."""

    def __init__(self, stream: Any, quota: Quota) -> None:
        self.is_cut = False
        self._stream, self._quota = stream, quota

    def __exit__(self, *exception: object) -> None:
        self._stream.close()

    def read1(self, size: int) -> bytes:
        """The next piece."""
        try:
            data: bytes = getattr(self._stream, "read1", self._stream.read)(size)
        except EOFError:
            self.is_cut = True
            return b""
        except (*DAMAGE, RuntimeError) as error:
            raise OSError(f"damaged or cut off, {error}") from error
        self._quota.unpack(len(data))
        return data
