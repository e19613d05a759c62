"""Open the program's own files that it writes to repeatedly: locks and journals."""

import errno
import os
import stat
from pathlib import Path

FLAGS = os.O_CREAT | os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK
"""Flags for opening one of the program's own files.

Links are not followed, so that nobody can make the program write to another file by a link. Opening a pipe
does not wait.
"""


def open_own(path: Path, mode: int, *, append: bool = False) -> int:
    """Open a file to read and write, create it if it does not exist, and return its descriptor.

    `mode`: permissions of a new file, before the umask is applied.
    `append`: whether every write goes to the end of the file.

    Raises:
        OSError: the file cannot be opened, or is a link, a pipe or anything else that is no regular file.
        ValueError: the name holds a NUL.
    """
    try:
        descriptor = os.open(path, FLAGS | (os.O_APPEND if append else 0), mode)
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise OSError(errno.ELOOP, "it is a link, and has to be a file") from error
        raise
    status = os.fstat(descriptor)
    if stat.S_ISREG(status.st_mode) and status.st_nlink <= 1:
        return descriptor
    os.close(descriptor)
    if stat.S_ISREG(status.st_mode):
        raise OSError(errno.EMLINK, "it is a hard link to another file, and has to be a file of its own")
    raise OSError(errno.EINVAL, "it is a pipe or a device, and has to be a file")
