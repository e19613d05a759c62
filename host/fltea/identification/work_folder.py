"""Where copies and parts of recordings are kept: a folder that goes with its process, or after it."""

import contextlib
import fcntl
import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

PREFIX = "fltea-work-"
YOUNG_S = 60.0
"""Seconds; less goes by between making a folder and locking it."""


@contextlib.contextmanager
def work_folder() -> Iterator[Path]:
    """Yield a folder for temporary files; before it is made those go that killed processes left.

    Whoever works holds a lock on its folder, which the system takes away with the process.
    """
    for folder in Path(tempfile.gettempdir()).glob(f"{PREFIX}*"):
        with contextlib.suppress(OSError):
            _remove_if_left(folder)
    with tempfile.TemporaryDirectory(prefix=PREFIX, ignore_cleanup_errors=True) as made:
        held = os.open(made, os.O_RDONLY)
        try:
            with contextlib.suppress(OSError):  # a file system without locks: nothing is removed there
                fcntl.flock(held, fcntl.LOCK_EX)
            yield Path(made)
        finally:
            os.close(held)


def _remove_if_left(folder: Path) -> None:
    held = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    try:
        about = os.fstat(held)
        if about.st_uid == os.geteuid() and time.time() - about.st_mtime > YOUNG_S:
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
            shutil.rmtree(folder, ignore_errors=True)
    finally:
        os.close(held)
