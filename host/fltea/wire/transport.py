"""Opens and reads serial ports by URL. Each failure becomes an event, and the port is opened again.

The class ReaderThread of pyserial ends silently if the port is unplugged, because `in_waiting` raises an
OSError. In this module, any exception closes the port and makes an event with the reason. Then the port is
opened again, after pauses that become longer with each failure.
"""

import contextlib
import errno
import os
import re
import threading
from urllib.parse import urlsplit

import serial
from serial.tools import list_ports

from fltea.records.clock import host_ns, unix_offset_ns
from fltea.records.errors import UsageError
from fltea.records.events import Chunk, Failed, Opened
from fltea.wire.permission import group_of, join_remedy, this_user
from fltea.wire.terminal import NO_PORT, is_terminal

FORBIDDEN_BAUD, MOST_BAUD = 1200, 100_000_000
"""Opening a Due's port at `FORBIDDEN_BAUD` erases the Due's flash. No port is faster than `MOST_BAUD`."""

DUE_VENDORS = (0x2341, 0x2A03)
DUE_PROGRAMMING_PORT = 0x003D
DUE_NATIVE_PORT = 0x003E
"""USB product IDs of the two ports of an Arduino Due; DUE_VENDORS are its USB vendor IDs. Source: boards.txt
of Arduino's SAM core.
"""

ANY_BOARD = f"hwgrep://VID:PID=({'|'.join(f'{v:04X}' for v in DUE_VENDORS)}):{DUE_PROGRAMMING_PORT:04X}"
"""URL that matches the programming port of any Arduino Due."""

READ_TIMEOUT_S = 0.1
SOCKET = "socket://"
SCHEMES = ("socket", "rfc2217", "hwgrep", "loop")
"""Schemes that the URL of a port may have. Other schemes of pyserial are refused, since they write files or
load classes.
"""

BACKOFF_S = (0.25, 0.5, 1.0, 2.0, 5.0)
QUEUE_BYTES = 1 << 20
"""Largest number of bytes from a port that may wait for the consumer. A serial port at full speed delivers
this number of bytes in half a minute.
"""

MAX_CHUNK = 1 << 16

AT_ONCE = 4
"""Largest number of ports that are opened at the same time. A port takes six file descriptors while it is
being opened, and one afterwards.
"""

_OPENING = threading.BoundedSemaphore(AT_ONCE)


def check_url(url: str, baud: int) -> None:
    """Refuse a URL or a baud rate with which every attempt to open the port would fail or do harm.

    Raises:
        UsageError: the URL's scheme is not in `SCHEMES`, or the speed is impossible, or it is 1200 baud,
            which erases a Due's flash.
    """
    if baud == FORBIDDEN_BAUD:
        raise UsageError(
            "1200 baud is refused: opening a Due's programming port at 1200 baud erases its flash. "
            "The firmware speaks 250000 baud."
        )
    if not 0 < baud <= MOST_BAUD:
        raise UsageError(f"a baud rate of {baud} is not possible; the firmware speaks 250000 baud.")
    try:
        # pyserial, too, takes what precedes `://` as the scheme
        scheme, is_url, _ = url.lower().partition("://")
        if is_url and scheme not in SCHEMES:
            raise ValueError(f"'{scheme}://' is not among the kinds of addresses that fltea opens")
        serial.serial_for_url(url, baudrate=baud, do_not_open=True)
        if scheme in ("socket", "rfc2217") and urlsplit(url).port is None:
            raise ValueError("its port number is missing")
    except (ValueError, re.error) as error:
        raise UsageError(
            f"'{url}' is no serial port that this program knows ({error}). Give a device path such as "
            "/dev/ttyACM0, or socket://HOST:PORT, rfc2217://HOST:PORT, hwgrep://REGEXP, loop://."
        ) from error
    except serial.SerialException:
        pass  # no port matches the URL hwgrep:// now, but a matching one may appear later


def list_ports_text() -> str:
    """Return one line of text that names the serial ports of this machine."""
    ports = sorted(list_ports.comports())
    if not ports:
        return "This machine has no serial port at the moment."
    return "Ports that exist: " + ", ".join(f"{p.device} ({p.description})" for p in ports) + "."


def explain_open_failure(url: str, error: Exception) -> tuple[str, str]:
    """Return the kind and text of the error for a port that cannot be opened.

    The text says what happened, the likely cause, and what to do.
    """
    number = getattr(error, "errno", None)
    if number in (errno.EACCES, errno.EPERM):
        remedy = join_remedy(url, group_of(url), this_user())
        return "no_permission", f"no permission to open {url}. {remedy} 'fltea doctor' checks more."
    if number in (errno.EBUSY, errno.EAGAIN):
        return "port_busy", (
            f"{url} is in use by another program (another fltea, a serial monitor, or ModemManager). "
            "Close it; 'fltea devices' names it."
        )
    if "://" in url and not url.startswith("hwgrep://"):
        return "no_port", f"cannot connect to {url}: {error}. Check that the other side listens."
    if number in (errno.ENOENT, errno.ENODEV, errno.ENXIO) or url.startswith("hwgrep://"):
        if url == ANY_BOARD:
            return "no_port", (
                "no Arduino Due on its programming port (the one beside the power socket), and no other "
                f"--source was given. Check the cable. {list_ports_text()} To run without a board: "
                "--source 'synthetic:?alpha=0.3&f=-1.5'."
            )
        return "no_port", f"there is no port {url}. Check the cable and the name. {list_ports_text()}"
    if not is_terminal(url):
        return "open_failed", f"cannot open {url}: it is {NO_PORT}. {list_ports_text()}"
    return "open_failed", f"cannot open {url}: {error}. {list_ports_text()}"


class Port:
    """One serial port. This class opens it, reads it, and computes the pauses between attempts to open it.

    The port is opened exclusively. Opening raises the signal DTR if the port has that signal, and this resets
    a Due. Afterwards this class does not change DTR.

    `url`: path of a device, or a URL with one of `SCHEMES`.
    `baud`: speed [baud].
    `latency_s`: longest time for which received bytes may wait until `Ports` yields them [s].
    `overflow_bytes`: number of bytes that were read and then dropped because the consumer was too slow.
    """

    def __init__(self, url: str, baud: int, latency_s: float = 0.0) -> None:
        check_url(url, baud)
        self.url = url
        self.baud = baud
        self.latency_s = latency_s
        self.overflow_bytes = 0
        self._serial: serial.Serial | None = None
        self._descriptor = -1
        self._failures = 0
        self._untold: Exception | None = None

    @property
    def has_descriptor(self) -> bool:
        """Whether the port has a file descriptor, through which the system reports that bytes wait."""
        return self.is_socket or "://" not in self.url or self.url.startswith("hwgrep://")

    @property
    def is_socket(self) -> bool:
        """Whether the port is a TCP socket, which the other side can close."""
        return self.url.startswith(SOCKET)

    def open(self) -> Opened | Failed:
        """Open the port; this may take seconds if it is on a network."""
        port = None
        try:
            port = serial.serial_for_url(self.url, baudrate=self.baud, do_not_open=True)
            port.timeout = READ_TIMEOUT_S
            port.exclusive = True
            if self.has_descriptor:
                with contextlib.nullcontext() if self.is_socket else _OPENING:
                    port.open()
                    self._descriptor = _descriptor_of(port)
            else:
                port.open()
                self._serial = port
        except Exception as error:  # a driver may raise any exception, and the reading thread must go on
            if port is not None:
                _release(port)
            try:
                return Failed(*explain_open_failure(self.url, error), host_ns(), unix_offset_ns())
            # The text of the failure names groups and ports of this machine, and reading these may fail as
            # well.
            except Exception as fault:
                text = f"cannot open {self.url}: {error}. The search for the cause failed, too ({fault})."
                return Failed("open_failed", text, host_ns(), unix_offset_ns())
        return Opened(host_ns(), unix_offset_ns())

    def fileno(self) -> int:
        """Return the file descriptor of the open port; -1 if the port has none."""
        return self._descriptor

    def has_worked(self) -> None:
        """Make the pauses between attempts to open the port short again.

        This method is called only when bytes have arrived, not as soon as the port is open: a port may be
        lost right after it was opened.
        """
        self._failures = 0

    def read_waiting(self) -> Chunk | Failed | None:
        """Wait up to `READ_TIMEOUT_S` for bytes from a port without a file descriptor.

        Return None if no bytes came.
        """
        port = self._serial
        assert port is not None
        if self._untold is not None:
            return self.lost(self._untold)
        data = b""
        try:
            data = port.read(1)
            if data:
                data += port.read(min(port.in_waiting, MAX_CHUNK))
        # if the port is lost, `error` may be an OSError, a SerialException or a TypeError, depending on the
        # driver
        except Exception as error:
            if not data:
                return self.lost(error)
            self._untold = error  # this call returns the bytes read so far; the next call reports the error
        if not data:
            return None
        self.has_worked()
        return Chunk(data, host_ns(), unix_offset_ns())

    def lost(self, error: Exception, *at: int) -> Failed:
        """Close the port, and return the event that the port was lost, with the reason.

        `at`: host time of the loss, and Unix time minus host time at that moment, both in ns. Without `at`,
        the present time is used.
        """
        self.close()
        message = f"{self.url} was lost ({error}): it was unplugged, or the other side has ended."
        return Failed("unplugged", message, *(at or (host_ns(), unix_offset_ns())))

    def backoff_s(self) -> float:
        """Return the pause before the next attempt to open the port [s].

        The pause becomes longer with each failure.
        """
        wait_s = BACKOFF_S[min(self._failures, len(BACKOFF_S) - 1)]
        self._failures += 1
        return wait_s

    def close(self) -> None:
        """Close the port."""
        port, self._serial, self._untold = self._serial, None, None
        if port is not None:
            _release(port)
        descriptor, self._descriptor = self._descriptor, -1
        if descriptor >= 0:
            with contextlib.suppress(OSError):  # the device is gone already
                os.close(descriptor)


def _descriptor_of(port: serial.Serial) -> int:
    """Return a file descriptor of an open port, and release pyserial's other resources.

    The lock on the port and the signal DTR stay as they are.
    """
    if (connection := getattr(port, "_socket", None)) is not None:
        port.is_open = False
        return int(connection.detach())
    descriptor = os.dup(port.fileno())
    port.close()
    return descriptor


def _release(port: serial.Serial) -> None:
    with contextlib.suppress(OSError):  # the device is gone already
        port.close()
