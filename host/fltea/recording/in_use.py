"""Tells whether a program is writing a recording at present. Such a program holds a lock on the file."""

import fcntl
from typing import BinaryIO


def is_in_use(file: BinaryIO) -> bool:
    """Return whether a writer has locked the file; False if the file system has no locks."""
    try:
        fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    fcntl.flock(file, fcntl.LOCK_UN)
    return False
