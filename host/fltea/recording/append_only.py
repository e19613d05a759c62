"""A new file that is written in one piece at every flush, and is seen to be still there each time."""

import contextlib
import errno
import fcntl
import os
from pathlib import Path
from typing import Literal

NO_RESERVING = (errno.EOPNOTSUPP, errno.EINVAL, errno.ENOSYS)

NAME_OF_DELETED = ".nfs"
"""How a file begins on NFS that was deleted while it was open: its server knows nothing of open files."""


class Meddled(OSError):
    """Another program deleted, moved or cut short a file while it was written; it gets nothing more.

    what: which of these. where: the path that a moved file has now, empty if the system does not tell.
    """

    def __init__(self, what: Literal["deleted", "moved", "cut short"], where: str = "") -> None:
        super().__init__(errno.ESTALE, f"another program has {what} its file")
        self.what, self.where = what, where


class AppendOnly:
    """A new file that is written in one piece at every flush.

    good_bytes: length after the last flush that succeeded; `cut` goes back to it.
    """

    def __init__(self, path: Path, reserve_bytes: int) -> None:
        self.good_bytes = 0
        self._path = path
        self._pending = bytearray()
        self._fd = os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY | os.O_CLOEXEC, 0o666)
        with contextlib.suppress(OSError):  # not every file system has locks
            fcntl.flock(self._fd, fcntl.LOCK_EX)  # whoever reads or mends the file sees that it is in use
        try:
            if reserve_bytes:
                _reserve(self._fd, reserve_bytes)
        except OSError:
            os.close(self._fd)
            path.unlink(missing_ok=True)
            raise

    def write(self, data: bytes) -> None:
        """Keep bytes for the next flush."""
        self._pending += data

    def tell(self) -> int:
        """Length of the file, as it will be after the next flush."""
        return self.good_bytes + len(self._pending)

    def check(self) -> None:
        """See that the file is still where it was begun, and has all that was written.

        Raises:
            Meddled: it is not, or has not.
            OSError: the disk does not answer.
        """
        ours = os.fstat(self._fd)
        if not self._is_named(ours):
            where = ""
            with contextlib.suppress(OSError):
                where = os.readlink(f"/proc/self/fd/{self._fd}")
            if ours.st_nlink and not Path(where).name.startswith(NAME_OF_DELETED):
                raise Meddled("moved", where)
            raise Meddled("deleted")
        if ours.st_size < self.good_bytes:
            raise Meddled("cut short")

    def flush(self) -> None:
        """Hand everything to the operating system; OSError if it does not take it."""
        done = 0
        while done < len(self._pending):
            done += os.write(self._fd, memoryview(self._pending)[done:])
        self.good_bytes += done
        self._pending.clear()

    def cut(self) -> None:
        """Remove what a failed flush wrote of a record, if the disk still lets us, and close."""
        with contextlib.suppress(OSError):
            if os.fstat(self._fd).st_size > self.good_bytes:
                os.ftruncate(self._fd, self.good_bytes)
        self.close()

    def close(self) -> None:
        """Close the file; may be called twice."""
        fd, self._fd = self._fd, -1
        if fd >= 0:
            with contextlib.suppress(OSError):
                os.close(fd)

    def _is_named(self, ours: os.stat_result) -> bool:
        """Whether the path still leads to the file.

        The number of links alone does not tell: a moved file has one, and some file systems of programs give
        0 for every file. Some network file systems number a file anew now and then: it has its size and time.
        """
        try:
            named = os.stat(self._path)
        except (FileNotFoundError, NotADirectoryError):
            return False
        except OSError:  # a folder above that may not be looked into any more: nobody can tell
            return True
        as_old = (named.st_size, named.st_mtime_ns) == (ours.st_size, ours.st_mtime_ns)
        return as_old or os.path.samestat(named, ours)


def _reserve(fd: int, size_bytes: int) -> None:
    """Make sure that there is room for so much, then give it back."""
    try:
        os.posix_fallocate(fd, 0, size_bytes)
    except OSError as error:
        if error.errno not in NO_RESERVING:
            raise
    os.ftruncate(fd, 0)
