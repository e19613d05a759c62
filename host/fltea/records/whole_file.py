"""Files that are written whole or not at all, in folders that others may write to as well."""

import contextlib
import io
import os
import secrets
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, TextIO

from fltea.records.errors import FlteaError, UsageError
from fltea.records.temporary import TemporaryFailed, nameless_file

KEPT_OF_NAME = 40
"""Characters of a file's name in that of its part: a name may have 255 bytes and needs room for the rest."""

NEW = os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_WRONLY | os.O_CLOEXEC


@contextlib.contextmanager
def whole_file(out: Path) -> Iterator[BinaryIO]:
    """Give a file to write to; at the end it becomes `out`, and after any failure there is none.

    It has a name that nobody can guess, in the same folder, and is made new: a link that a stranger put
    there is not followed. It is on the disk before it takes its name.

    Raises:
        UsageError: a device, a pipe or a folder has the name, which nothing takes the place of.
        FlteaError: the file cannot be written; what was at `out` is as it was.
    """
    _check_replaceable(out)
    part = out.parent / f".{out.name[:KEPT_OF_NAME]}.{secrets.token_hex(8)}.part"
    try:
        descriptor = os.open(part, NEW, 0o666)
    except (OSError, ValueError) as error:  # ValueError: a name with a NUL
        raise FlteaError(f"{out}: cannot be written ({_reason(error)}).") from error
    try:
        with open(descriptor, "wb") as file:
            yield file
            file.flush()
            os.fsync(descriptor)
        os.replace(part, out)
    except OSError as error:
        raise FlteaError(f"{out}: cannot be written ({_reason(error)}).") from error
    finally:
        with contextlib.suppress(OSError):
            part.unlink(missing_ok=True)


def _check_replaceable(out: Path) -> None:
    """Refuse what is no file. Root may put one in the place of /dev/null, and then the system is broken."""
    try:
        mode = os.lstat(out).st_mode
    except (OSError, ValueError):  # nothing is there, or whoever opens it says what is wrong
        return
    in_dev = out.absolute().parent == Path("/dev")
    if not (stat.S_ISREG(mode) or (stat.S_ISLNK(mode) and not in_dev)):
        raise UsageError(f"{out}: cannot be written (something that is not a file has this name).")


@contextlib.contextmanager
def text_of(file: BinaryIO) -> Iterator[TextIO]:
    """Write text to a binary file, whose line ends stay as they are; the file stays open."""
    text = io.TextIOWrapper(file, encoding="utf-8", newline="")
    yield text
    text.flush()
    text.detach()


def prepare_folder(flag: str, folder: Path) -> None:
    """Make the folder of a flag and see that it can be written to, before minutes are spent.

    Raises:
        UsageError: it cannot.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        nameless_file(folder).close()
    except (OSError, TemporaryFailed) as error:
        reason = error.reason if isinstance(error, TemporaryFailed) else _reason(error)
        raise UsageError(f"{flag} {folder}: cannot be written to ({reason}).") from error


def _reason(error: Exception) -> str:
    """Return the reason without the part's name, which says nothing to a person."""
    return getattr(error, "strerror", None) or str(error)
