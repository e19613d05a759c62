"""Make all temporary files of the program.

Most temporary files have no name, so the system removes them when their process ends, even if it is killed.
Files that other code must open by name are kept in a work folder, on which the process holds a lock. If a
work folder has no lock, its process was killed, and the folder is removed.
"""

import atexit
import contextlib
import errno
import fcntl
import functools
import io
import os
import shutil
import signal
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO, cast

from fltea.records.errors import FlteaError

PREFIX, NEW_PREFIX = "fltea-work-", "fltea-new-"
"""Two beginnings of the names of work folders. The first is for folders that are locked, and the second for
new folders that are not locked yet.
"""

YOUNG_S = 60.0
"""A new folder younger than this is not removed [s], since its process may be about to lock it."""

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
ENDING = signal.SIGTERM, signal.SIGHUP

_IN_USE: set[Path] = set()
"""Work folders and files of this process that a signal which ends the process removes."""


class TemporaryFailed(FlteaError):
    """The folder for temporary files is full or unusable. `reason`: the system's text for the error."""

    reason = ""


def _failed(folder: object, error: OSError) -> TemporaryFailed:
    what = "is full" if error.errno in FULL else "cannot be used"
    reason = error.strerror or str(error)
    failed = TemporaryFailed(
        f"{folder}: the folder for temporary files {what} ({reason}). The files that are read are not the "
        "cause. Make room in that folder, or name a larger folder with the variable TMPDIR."
    )
    failed.reason = reason
    return failed


class _File(io.FileIO):
    """A temporary file that raises `TemporaryFailed` in place of OSError.

    An OSError then always comes from reading the user's recording, and not from a temporary file.
    """

    def __init__(self, file: Any, mode: str, folder: object) -> None:
        super().__init__(file, mode)
        self._folder = folder

    def write(self, data: Any) -> Any:
        """Write data; a full disk raises `TemporaryFailed`."""
        try:
            return super().write(data)
        except OSError as error:
            raise _failed(self._folder, error) from error

    def readinto(self, buffer: Any) -> Any:
        """Read data; an error of the disk raises `TemporaryFailed`."""
        try:
            return super().readinto(buffer)
        except OSError as error:
            raise _failed(self._folder, error) from error


def nameless_file(folder: Path | None = None) -> BinaryIO:
    """Return a new file without a name, open for writing and reading.

    `folder`: the folder of the file; None: the folder for temporary files.

    Raises:
        TemporaryFailed: the file cannot be made. Writes raise this error when the disk is full.
    """
    where = folder or _temporary_folder()
    try:
        if folder is None:
            _remove_left_once()
        with tempfile.TemporaryFile(dir=where, buffering=0) as made:
            descriptor = os.dup(made.fileno())
    except OSError as error:
        raise _failed(where, error) from error
    return cast(BinaryIO, io.BufferedRandom(_File(descriptor, "r+b", where)))


def named_file(path: Path) -> BinaryIO:
    """Return a new file in a folder of `work_folder`, open for writing and reading.

    Raises:
        TemporaryFailed: the file cannot be made. Writes raise this error when the disk is full.
    """
    try:
        return cast(BinaryIO, io.BufferedRandom(_File(path, "x+b", path.parent)))
    except OSError as error:
        raise _failed(path.parent, error) from error


@contextlib.contextmanager
def work_folder() -> Iterator[Path]:
    """Yield a new folder for temporary files, after removing folders that killed processes left.

    The process holds a lock on its folder, which the system releases when the process ends. SIGTERM and
    SIGHUP first remove the folder and then end the process as usual.

    Raises:
        TemporaryFailed: the folder cannot be made.
    """
    with _new_folder() as made, removed_by_signals(made):
        yield made


@functools.cache
def process_folder() -> Path:
    """Return a folder for temporary files, the same at each call, which is removed when this process ends.

    Only `work_folder` handles SIGTERM and SIGHUP. If such a signal comes while `work_folder` is in use, the
    folder is removed at once. If it comes at another time, a later process removes the folder.

    Raises:
        TemporaryFailed: the folder cannot be made.
    """
    kept = contextlib.ExitStack()
    atexit.register(kept.close)
    made = kept.enter_context(_new_folder())
    _IN_USE.add(made)
    return made


@contextlib.contextmanager
def _new_folder() -> Iterator[Path]:
    where, owner = _temporary_folder(), os.getpid()
    try:
        _remove_left(where)
        made = Path(tempfile.mkdtemp(prefix=NEW_PREFIX, dir=where))
        held = os.open(made, os.O_RDONLY | os.O_DIRECTORY)
    except OSError as error:
        raise _failed(where, error) from error
    try:
        # the file system has no locks, so no folders of killed processes are removed
        with contextlib.suppress(OSError):
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
            made = made.rename(made.with_name(made.name.replace(NEW_PREFIX, PREFIX, 1)))
        yield made
    finally:
        if os.getpid() == owner:  # a forked process must not remove the folder
            shutil.rmtree(made, ignore_errors=True)
        os.close(held)


def _temporary_folder() -> Path:
    try:
        return Path(tempfile.gettempdir())
    except OSError as error:  # none of the usual folders for temporary files can be written to
        raise _failed(os.environ.get("TMPDIR", "/tmp"), error) from error


@contextlib.contextmanager
def removed_by_signals(path: Path) -> Iterator[None]:
    """Make SIGTERM and SIGHUP remove a file or folder before they end the process.

    If the program handles these signals itself, or in another thread than the main one, nothing is done.
    """
    owner = os.getpid()

    def end(number: int, _: object) -> None:
        for used in tuple(_IN_USE) if os.getpid() == owner else ():
            _remove(used)
        signal.signal(number, signal.SIG_DFL)
        os.kill(os.getpid(), number)

    _IN_USE.add(path)
    ours = []
    if threading.current_thread() is threading.main_thread():
        ours = [number for number in ENDING if signal.getsignal(number) == signal.SIG_DFL]
    for number in ours:
        signal.signal(number, end)
    try:
        yield
    finally:
        _IN_USE.discard(path)
        for number in ours:
            if signal.getsignal(number) is end:
                signal.signal(number, signal.SIG_DFL)


def _remove(path: Path) -> None:
    shutil.rmtree(path, ignore_errors=True)
    with contextlib.suppress(OSError):  # it was a folder, and is gone
        path.unlink()


@functools.cache
def _remove_left_once() -> None:
    _remove_left(_temporary_folder())


def _remove_left(where: Path) -> None:
    """Remove work folders that killed processes have left in `where`."""
    for prefix, least_s in ((PREFIX, 0.0), (NEW_PREFIX, YOUNG_S)):
        for folder in where.glob(f"{prefix}*"):
            with contextlib.suppress(OSError):
                _remove_if_left(folder, least_s)


def _remove_if_left(folder: Path, least_s: float) -> None:
    held = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    try:
        about = os.fstat(held)
        if about.st_uid == os.geteuid() and time.time() - about.st_mtime >= least_s:
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
            shutil.rmtree(folder, ignore_errors=True)
    finally:
        os.close(held)
