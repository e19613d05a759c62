"""Tells serial ports from other devices and files without opening them, since opening a port resets a Due."""

import os
import stat
from pathlib import Path

DRIVERS = "/proc/tty/drivers"
"""The kernel's list of the drivers of terminals, to which serial ports and pseudo-terminals belong (proc(5)).
Each line has a name, a folder, a major number, one or a range of minor numbers, and a type.
"""


NO_PORT = "a file, a folder or another device, and no serial port"
"""Words for something that `is_terminal` does not take for a port."""


def is_terminal(path: str | Path) -> bool:
    """Return whether a file that exists can be a serial port.

    If the file or the kernel's list cannot be read, return True.
    """
    try:
        status = os.stat(path)
        drivers = Path(DRIVERS).read_text(encoding="utf-8", errors="replace")
    except OSError:
        return True
    if not stat.S_ISCHR(status.st_mode):
        return False
    device = os.major(status.st_rdev), os.minor(status.st_rdev)
    return any(_serves(line.split(), *device) for line in drivers.splitlines())


def _serves(words: list[str], major: int, minor: int) -> bool:
    """Return whether the driver in a line of `DRIVERS` serves a device."""
    if len(words) < 5 or words[-3] != str(major):
        return False
    first, _, last = words[-2].partition("-")
    return int(first) <= minor <= int(last or first)
