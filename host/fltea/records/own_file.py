"""Files that the program keeps for itself and writes to again: locks and journals."""

import errno
import os
import stat
from pathlib import Path

FLAGS = os.O_CREAT | os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK
"""A link is not followed, lest what it leads to is emptied; a pipe is not waited for."""


def open_own(path: Path, mode: int, *, append: bool = False) -> int:
    """Return the descriptor of a file to read and write, which is made if it is not there.

    mode: of a new one, less the umask. append: what is written goes to its end.

    Raises:
        OSError: it cannot be opened, or it is a link, a pipe or anything else that is no file.
        ValueError: its name has a NUL.
    """
    try:
        found = os.open(path, FLAGS | (os.O_APPEND if append else 0), mode)
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise OSError(errno.ELOOP, "it is a link, and has to be a file") from error
        raise
    if stat.S_ISREG(os.fstat(found).st_mode):
        return found
    os.close(found)
    raise OSError(errno.EINVAL, "it is a pipe or a device, and has to be a file")
