"""Write each file as a whole or not at all, even in folders to which other programs may write.

A link at the name of a file is never followed: a result replaces it, and a file that is written to repeatedly
(see `own_file`) must not be one. A folder that a user names may be a link to a folder, such as one on a
larger disk.
"""

import contextlib
import errno
import io
import os
import secrets
import stat
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import BinaryIO, TextIO

from fltea.records.errors import FlteaError, UsageError
from fltea.records.temporary import TemporaryFailed, nameless_file, removed_by_signals

KEPT_OF_NAME = 40
"""The name of a temporary file contains at most this number of characters of the final file's name. There is
a limit since names may have at most 255 bytes.
"""

NEW = os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_WRONLY | os.O_CLOEXEC


@contextlib.contextmanager
def whole_file(out: Path) -> Iterator[BinaryIO]:
    """Yield a temporary file to write to; on success it is renamed to `out`, on failure it is deleted.

    It is also deleted if SIGTERM or SIGHUP ends the program.

    The temporary file has an unpredictable name in the folder of `out` and is always a new file, so a link
    that another user put there is not followed. Its data are on the disk before it is renamed.

    Raises:
        UsageError: `out` is a device, a pipe or a folder, which must not be replaced.
        FlteaError: the file cannot be written; an earlier file `out` is unchanged.
    """
    _check_replaceable(out)
    part = out.parent / f".{out.name[:KEPT_OF_NAME]}.{secrets.token_hex(8)}.part"
    with removed_by_signals(part), _written(part, out) as file:
        yield file


@contextlib.contextmanager
def _written(part: Path, out: Path) -> Iterator[BinaryIO]:
    try:
        descriptor = os.open(part, NEW, 0o666)
    except (OSError, ValueError) as error:  # ValueError is raised for a name that holds a NUL
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


def check_outputs(outputs: Iterable[tuple[str, Path]], inputs: Iterable[tuple[str | Path, str]]) -> None:
    """Check that no output of a command would replace one of its inputs or another output.

    `outputs`: flag and file of each. `inputs`: file of each, and what it is, such as "the recording". Links
    are followed, since their target may be meant.

    Raises:
        UsageError: one would.
    """
    taken = {_identity(path): f"{what} itself" for path, what in inputs}
    for flag, path in outputs:
        key = _identity(path)
        if key in taken:
            raise UsageError(f"{flag} {path}: is {taken[key]}. Name another file.".lstrip())
        taken[key] = f"the file of {flag}, too" if flag else "written twice"


def _identity(path: str | Path) -> tuple[int, int] | str:
    """Return what is equal for two names of one file, also for hard links."""
    try:
        status = os.stat(path)
    except (OSError, ValueError):  # there is no such file
        return os.path.realpath(path)
    return status.st_dev, status.st_ino


def _check_replaceable(out: Path) -> None:
    """Refuse to replace anything but a file: root could replace /dev/null and so break the system."""
    try:
        mode = os.lstat(out).st_mode
    except (OSError, ValueError):  # there is no such file, or opening it later will report what is wrong
        return
    in_dev = out.absolute().parent == Path("/dev")
    if not (stat.S_ISREG(mode) or (stat.S_ISLNK(mode) and not in_dev)):
        raise UsageError(f"{out}: cannot be written (this is the name of something that is not a file).")


@contextlib.contextmanager
def text_of(file: BinaryIO) -> Iterator[TextIO]:
    """Yield a text writer for a binary file. It does not convert line ends. The binary file stays open."""
    text = io.TextIOWrapper(file, encoding="utf-8", newline="")
    yield text
    text.flush()
    text.detach()


def make_folder(folder: Path) -> None:
    """Create a folder that a user names, with the folders above it, if it does not exist.

    Raises:
        OSError: it cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except FileExistsError as error:
        reason = "it is a file" if folder.exists() else "it is a link to nothing"
        raise FileExistsError(errno.EEXIST, reason, str(folder)) from error


def prepare_folder(flag: str, folder: Path) -> None:
    """Create the folder that a command-line flag names, and check that it can be written to.

    Call this before long computations, whose results could not be written otherwise.

    Raises:
        UsageError: the folder cannot be written to.
    """
    try:
        make_folder(folder)
        nameless_file(folder).close()
    except (OSError, TemporaryFailed) as error:
        reason = error.reason if isinstance(error, TemporaryFailed) else _reason(error)
        raise UsageError(f"{flag} {folder}: cannot be written to ({reason}).") from error


def _reason(error: Exception) -> str:
    """Return the reason for an error as text, without the name of the temporary file."""
    return getattr(error, "strerror", None) or str(error)
