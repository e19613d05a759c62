"""Whether a program writes a recording at this moment, which holds its file locked."""

import fcntl
from typing import BinaryIO


def is_in_use(file: BinaryIO) -> bool:
    """Whether the file is locked by who writes it; False where the file system has no locks."""
    try:
        fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    fcntl.flock(file, fcntl.LOCK_UN)
    return False
