"""Opens a Linux I²C bus for a sensor at one address, and explains failures."""

import errno
import fcntl
import glob
import os
import re
import struct
from typing import Any, Protocol

from smbus2 import SMBus

from fltea.wire.permission import group_of, join_remedy, this_user

I2C_TIMEOUT = 0x0702
"""Request to the kernel's driver i2c-dev (ioctl) that sets the timeout of the whole adapter, in units of 10
ms.
"""

TRANSFER_LIMIT_S = 0.1
"""Time after which the kernel abandons a transfer [s].

The kernel's default is one second, in which the sensor's FIFO would overflow. The longest transfer here takes
23 ms at 100 kHz.
"""


class Bus(Protocol):
    """The methods of `smbus2.SMBus` that the driver needs."""

    def i2c_rdwr(self, *messages: Any) -> None:
        """Run several `smbus2.i2c_msg` messages as one transaction; raise OSError if it fails."""

    def close(self) -> None:
        """Release the bus."""


def open_bus(path: str, address: int) -> Bus:
    """Open a bus for the sensor at one address.

    Raises:
        OSError: see `explain_open_failure`.
    """
    bus = SMBus(path)
    try:
        assert bus.fd is not None
        take(bus.fd, address)
        fcntl.ioctl(bus.fd, I2C_TIMEOUT, round(TRANSFER_LIMIT_S * 100))
    except OSError:
        bus.close()
        raise
    return bus


def take(fd: int, address: int) -> None:
    """Lock the sensor for this process. A second fltea would take some of the samples from its FIFO.

    `fd`: the open device file of the bus. Only one byte of this file is locked: byte number `address`. So
    sensors at other addresses stay free. The lock ends when `fd` is closed.

    Raises:
        OSError: another process has the lock (EAGAIN or EACCES).
    """
    one_byte = struct.pack("hhqqi", fcntl.F_WRLCK, os.SEEK_SET, address, 1, 0)
    fcntl.fcntl(fd, fcntl.F_OFD_SETLK, one_byte)


def explain_open_failure(path: str, address: int, error: OSError) -> tuple[str, str]:
    """Return kind and text of the `error` record about a bus that cannot be opened.

    The text says what happened, the likely cause, and what to do.
    """
    match error.errno:
        case errno.EAGAIN:
            return "port_busy", (
                f"another fltea reads the sensor at 0x{address:02X} on {path}; each would get only a part of "
                f"its samples. End it; 'fltea devices' names it."
            )
        case errno.EACCES | errno.EPERM:
            remedy = join_remedy(path, group_of(path), this_user())
            return "no_permission", f"no permission to open {path}. {remedy}"
        case errno.ENOENT | errno.ENXIO | errno.ENODEV:
            return "no_port", (
                f"there is no I²C bus {path}. {_buses_text()} On a Raspberry Pi switch it on with "
                "'sudo raspi-config nonint do_i2c 0' (or the line dtparam=i2c_arm=on in "
                "/boot/firmware/config.txt and a restart); pins 3 and 5 are /dev/i2c-1."
            )
        case errno.ENOTTY:
            return "open_failed", f"{path} is no I²C bus. {_buses_text()}"
    return "open_failed", f"cannot open {path}: {error}. {_buses_text()}"


def detect_command(path: str) -> str:
    """Return the shell command that shows which addresses answer on a bus."""
    number = re.search(r"(\d+)$", path)
    return f"i2cdetect -y {number[1] if number else 'NUMBER'}"


def _buses_text() -> str:
    buses = sorted(glob.glob("/dev/i2c-*"))
    return f"Buses that exist: {', '.join(buses)}." if buses else "This machine has no I²C bus at the moment."
