"""Reads compressed recordings: gzip, bzip2, xz, or the one file with a gyroscope in an archive (.zip)."""

import bz2
import contextlib
import gzip
import io
import lzma
import shlex
import shutil
import zipfile
import zlib
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Any, BinaryIO, cast

from fltea.recording.csv_file import open_csv
from fltea.recording.decompress import Streams
from fltea.recording.files import Note, Stored, listed
from fltea.recording.formats import FORMATS, KINDS
from fltea.recording.kind import kind_of_file
from fltea.recording.ndjson import read_ndjson
from fltea.recording.opening import Printed, check_options
from fltea.recording.quota import Quota
from fltea.recording.reader_process import open_in_process
from fltea.recording.reading import NotStated
from fltea.records.errors import UsageError
from fltea.records.temporary import nameless_file
from fltea.settings.how import How
from fltea.settings.limits import Limits

PACKERS: dict[bytes, tuple[Any, str, str]] = {
    b"\x1f\x8b": (gzip.open, "gzip", ".gz"),
    b"BZh": (partial(Streams, new=bz2.BZ2Decompressor), "bzip2", ".bz2"),
    b"\xfd7zXZ": (partial(Streams, new=lzma.LZMADecompressor), "xz", ".xz"),
}
"""Key: the first bytes of a compressed file. Value: the function that opens such a file, the program by which
the user can decompress it, and the ending that this program expects.
"""

DAMAGE = (OSError, ValueError, zlib.error, lzma.LZMAError, zipfile.BadZipFile, NotImplementedError)
"""Errors that libraries raise for damaged data. It lacks RuntimeError, which they raise for an archive with a
password.
"""

NO_MEMBER = "Not a gzipped file"
"""Begin of the text of the error of `gzip` if other bytes follow compressed data that are whole."""

LIKELY = ("gyro", "imu", "raw data", "angular", "rotation")
"""Words in the names of files that hold gyroscope data, the most telling word first. Phone apps write one
file per sensor.
"""

BESIDE = ("meta", "__macosx", "readme", "license")
"""Words in the paths of files in an archive that hold no gyroscope data."""

BUFFER_BYTES = 1 << 18


def open_compressed(path: Path, how: How, limits: Limits) -> Stored | Printed:
    """Open the recording in a compressed file. Text is read while it is decompressed.

    Other formats are decompressed to a temporary file first.

    Raises:
        UsageError: the file is damaged, its content exceeds the quota or has a format that the user must
            decompress first, or several files of an archive may be the recording.
    """
    quota = Quota(path, limits)
    try:
        with contextlib.ExitStack() as stack:
            file = stack.enter_context(path.open("rb"))
            begin = file.peek()
            opener, program, ending = next(
                (found for magic, found in PACKERS.items() if begin.startswith(magic)), (None, "", "")
            )
            if opener is not None:
                stream, place = opener(file), path
            else:
                archive = stack.enter_context(_archive(path, file))
                member = _member(path, archive, unpacking(path, program, ending))
                stream, place = stack.enter_context(archive.open(member)), path / member.filename
            counted = _Counted(stream, quota)
            content = stack.enter_context(io.BufferedReader(cast(Any, counted), BUFFER_BYTES))
            try:
                found = _open_inside(place, content, how, limits)
            except NotStated:
                raise
            except (UsageError, *DAMAGE) as error:
                if counted.damage:
                    raise _damaged(path, counted, program, ending) from error
                if not isinstance(error, UsageError):
                    raise
                if not counted.is_cut and not isinstance(error, _Packed):
                    raise
                command = unpacking(path, program, ending, is_cut=counted.is_cut)
                raise _refusal(path, place, error, counted, command) from error
            return _with_note(path, found, counted)
    except (*DAMAGE, RuntimeError) as error:
        raise UsageError(f"{path}: cannot be decompressed ({error}). Is the file whole?") from error


def _with_note(path: Path, found: Stored | Printed, counted: "_Counted") -> Stored | Printed:
    """Add a note on what is not read of a compressed file, if there is such a part."""
    if counted.is_cut:
        kind, text = "cut_recording", f"{path}: is cut off; what can be decompressed is read."
    elif counted.has_rest:
        kind, text = (
            "recording_gap",
            f"{path}: is followed by bytes that are not compressed, which are left out.",
        )
    else:
        return found
    if isinstance(found, Printed):
        return found._replace(cut=found.cut or text)
    return found._replace(notes=(Note(kind, text), *found.notes))


def _damaged(path: Path, counted: "_Counted", program: str, ending: str) -> UsageError:
    """Return the error for a file whose compressed data are damaged."""
    text = f"{path}: is damaged ({counted.damage}): copy it again"
    if not program or not counted.size:
        return UsageError(f"{text}.")
    command = unpacking(path, program, ending, is_cut=True)
    return UsageError(f"{text}, or unpack what is left, of which rows may be wrong: {command}")


class _Packed(UsageError):
    """The content of a file cannot be read while it is compressed. `what`, `inside`: why, for a message."""

    def __init__(self, what: str, inside: str = "") -> None:
        super().__init__(what)
        self.what, self.inside = what, inside


def _refusal(path: Path, place: Path, error: UsageError, counted: "_Counted", command: str) -> UsageError:
    """Return the error for a file whose content cannot be read. `command`: what decompresses the file."""
    if counted.is_cut and not counted.size:
        return UsageError(
            f"{path}: is cut off, and nothing of what is left can be decompressed: copy it again."
        )
    if isinstance(error, _Packed):
        advice = "it is cut off, and this unpacks what is left of it" if counted.is_cut else "unpack it first"
        return UsageError(f"{place}: {error.what}; {advice}: {command}{error.inside}")
    text = "The file is cut off, and only what can be decompressed was looked at: copy it again."
    return UsageError(f"{error} {text}")


def unpacking(path: Path, program: str, ending: str, *, is_cut: bool = False) -> str:
    """Return the command that decompresses a file.

    The program refuses a name without its ending, and removes what it has written when a file is cut off.
    `program`: "" for an archive.
    """
    name = shlex.quote(str(path))
    if not program:
        return f"python3 -m zipfile -e {name} ."
    if path.suffix == ending and not is_cut:
        return f"{program} -dk {name}"
    out = path.with_suffix("") if path.suffix == ending else path.with_name(f"{path.name}.unpacked")
    return f"{program} -dc {name} > {shlex.quote(str(out))}"


def _archive(path: Path, file: BinaryIO) -> zipfile.ZipFile:
    try:
        return zipfile.ZipFile(file)
    except zipfile.BadZipFile as error:
        raise UsageError(
            f"{path}: is cut off or damaged: what stands at the end of such a file is missing. Copy it again."
        ) from error


def _open_inside(place: Path, content: io.BufferedReader, how: How, limits: Limits) -> Stored | Printed:
    """Open the decompressed content of a file. `place`: name of the content for messages."""
    inner = place.with_suffix("") if KINDS.get(place.suffix.lower()) == "compressed" else place
    with nameless_file() as whole:
        try:
            kind = kind_of_file(inner, content)
            if kind not in ("csv", "ndjson"):
                shutil.copyfileobj(content, whole, BUFFER_BYTES)
                whole.seek(0)
                kind = kind_of_file(inner, whole)
        except UsageError as error:
            raise _Packed("is compressed", f". Inside, {error}") from error
        check_options(place, kind, how)
        if kind == "csv":
            return open_csv(place, how, limits, content)
        if kind == "ndjson":
            return Printed(*read_ndjson(place, limits=limits, file=content))
        if FORMATS[kind].reader:
            return open_in_process(kind, place, how, limits, whole)
    raise _Packed(f"holds {FORMATS[kind].title}, which is not read while it is compressed")


def _member(path: Path, archive: zipfile.ZipFile, command: str) -> zipfile.ZipInfo:
    files = [info for info in archive.infolist() if not info.is_dir()]
    rest = [info for info in files if not any(word in info.filename.lower() for word in BESIDE)]
    for word in LIKELY:
        found = [info for info in rest if word in PurePosixPath(info.filename).name.lower()]
        if len(found) == 1:
            return found[0]
    if len(rest) == 1:
        return rest[0]
    names = listed([info.filename for info in files])
    if not any(PurePosixPath(info.filename).suffix.lower() in KINDS for info in rest):
        raise UsageError(f"{path}: is an archive without a recording ({names}).")
    raise UsageError(
        f"{path}: holds {len(files)} files, and which has the gyroscope is not known ({names}). Decompress "
        f"it, and name the file: {command}"
    )


class _Counted(io.RawIOBase):
    """Stream of decompressed data, whose length the quota limits.

    `is_cut`: whether the compressed data end too early. `damage`: what is wrong with them, or "". `size`:
    length of the data so far [bytes].
    """

    def __init__(self, stream: Any, quota: Quota) -> None:
        self.is_cut, self.damage, self.size, self._ends_early = False, "", 0, False
        self._stream, self._quota = stream, quota

    @property
    def has_rest(self) -> bool:
        """Whether bytes that are not compressed follow the data."""
        return self._ends_early or getattr(self._stream, "has_rest", False)

    def readable(self) -> bool:
        """Return True, as `io.BufferedReader` requires."""
        return True

    def readinto(self, buffer: Any) -> int:
        """Decompress the next bytes into `buffer`; return their number."""
        try:
            data: bytes = getattr(self._stream, "read1", self._stream.read)(len(buffer))
        except EOFError:
            self.is_cut = True
            return 0
        except (*DAMAGE, RuntimeError) as error:
            if self.size and isinstance(error, gzip.BadGzipFile) and str(error).startswith(NO_MEMBER):
                self._ends_early = True
                return 0
            self.damage = str(error)
            raise OSError(f"damaged, {error}") from error
        self._quota.unpack(len(data))
        self.size += len(data)
        buffer[: len(data)] = data
        return len(data)
