"""Writes a new file with one system call per flush, and can check whether anyone has deleted or moved it."""

import contextlib
import errno
import fcntl
import os
from pathlib import Path
from typing import Literal

NO_RESERVING = (errno.EOPNOTSUPP, errno.EINVAL, errno.ENOSYS)

NAME_OF_DELETED = ".nfs"
"""Prefix of the name that NFS gives to a file that was deleted while a program had it open."""


class Meddled(OSError):
    """Raised if another program deleted, moved or truncated a file that this program is writing.

    `what`: what happened to the file. `where`: new path of a moved file; "" if the operating system does not
    report it.
    """

    def __init__(self, what: Literal["deleted", "moved", "cut short"], where: str = "") -> None:
        super().__init__(errno.ESTALE, f"another program has {what} the file that fltea writes")
        self.what, self.where = what, where


class AppendOnly:
    """A new file that is only appended to. Each flush writes all pending data with one system call.

    `good_bytes`: length of the file after the last successful flush [bytes]; `cut` truncates the file to it.
    """

    def __init__(self, path: Path, reserve_bytes: int) -> None:
        self.good_bytes = 0
        self._path = path
        self._pending = bytearray()
        self._fd = os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY | os.O_CLOEXEC, 0o666)
        with contextlib.suppress(OSError):  # some file systems have no locks
            # the lock tells programs that read or repair the file that it is still being written
            fcntl.flock(self._fd, fcntl.LOCK_EX)
        try:
            if reserve_bytes:
                _reserve(self._fd, reserve_bytes)
        except OSError:
            os.close(self._fd)
            path.unlink(missing_ok=True)
            raise

    def write(self, data: bytes) -> None:
        """Keep `data` for the next flush."""
        self._pending += data

    def tell(self) -> int:
        """Return the length that the file will have after the next flush [bytes]."""
        return self.good_bytes + len(self._pending)

    def check(self) -> None:
        """Check that the file is still at its path, and that it holds everything that was flushed.

        Raises:
            Meddled: the file was deleted, moved or truncated.
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
        """Write all pending data to the file; raise OSError if the operating system refuses."""
        done = 0
        while done < len(self._pending):
            done += os.write(self._fd, memoryview(self._pending)[done:])
        self.good_bytes += done
        self._pending.clear()

    def cut(self) -> None:
        """Truncate the file to `good_bytes` after a failed flush, if the disk still permits, and close it."""
        with contextlib.suppress(OSError):
            if os.fstat(self._fd).st_size > self.good_bytes:
                os.ftruncate(self._fd, self.good_bytes)
        self.close()

    def close(self) -> None:
        """Close the file. A second call does nothing."""
        fd, self._fd = self._fd, -1
        if fd >= 0:
            with contextlib.suppress(OSError):
                os.close(fd)

    def _is_named(self, ours: os.stat_result) -> bool:
        """Return whether the file's path still leads to the open file. `ours`: status of the open file.

        The number of hard links alone does not show this: a moved file still has one link, and some
        user-space file systems report 0 links for every file. Some network file systems change a file's inode
        number now and then, so a file with equal size and modification time counts as the same file.
        """
        try:
            named = os.stat(self._path)
        except (FileNotFoundError, NotADirectoryError):
            return False
        except OSError:  # a parent folder is no longer readable, so this cannot be checked
            return True
        as_old = (named.st_size, named.st_mtime_ns) == (ours.st_size, ours.st_mtime_ns)
        return as_old or os.path.samestat(named, ours)


def _reserve(fd: int, size_bytes: int) -> None:
    """Raise OSError unless the disk has `size_bytes` of free space. The space is not kept reserved."""
    try:
        os.posix_fallocate(fd, 0, size_bytes)
    except OSError as error:
        if error.errno not in NO_RESERVING:
            raise
    os.ftruncate(fd, 0)
