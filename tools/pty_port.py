"""The serial port of a simulated board, as a pseudo-terminal.

The port knows its own name, the bytes that no program has read yet, and whether a program has the port open.
"""

import contextlib
import fcntl
import os
import select
import struct
import termios
import tty
from pathlib import Path

from fltea.records.errors import UsageError

PACKET_BYTES = 64
"""Number of bytes that a Due's bridge passes to the host in one USB packet."""
TIOCPKT = 0x5420
TIOCPKT_FLUSHREAD = 1
TCGETS2 = 0x802C542A
TERMIOS2 = struct.Struct("4I20s2I")


class PtyPort:
    """The board's end (master) of a pseudo-terminal in raw mode.

    `held`: whether written bytes are kept while no program has the port open. `link`: symbolic link to the
    port; see `show_as`.
    """

    def __init__(self, link: Path | None = None, *, held: bool = False) -> None:
        self.master, slave = os.openpty()
        tty.setraw(slave)
        self.name = os.ttyname(slave)
        self._open = [self.master, slave] if held else [self.master]
        if not held:
            os.close(slave)
        os.set_blocking(self.master, False)
        fcntl.ioctl(self.master, TIOCPKT, struct.pack("i", 1))
        self._unsent = b""
        self._emptied = False
        self._link: Path | None = None
        if link is not None:
            self.show_as(link)

    def show_as(self, link: Path) -> None:
        """Make a symbolic link that points to the port.

        Raises:
            UsageError: something other than a link has that name, or the link cannot be made.
        """
        if link.exists() and not link.is_symlink():
            raise UsageError(f"--link {link}: exists and is no link; choose another.")
        try:
            link.unlink(missing_ok=True)
            link.symlink_to(self.name)
        except OSError as error:
            raise UsageError(f"--link {link}: cannot be made ({error.strerror}).") from error
        self._link = link

    def close(self) -> None:
        """Close the port, and remove the link if it still points to the port."""
        link = self._link
        if link is not None and link.is_symlink() and str(link.readlink()) == self.name:
            link.unlink()
        for descriptor in self._open:
            os.close(descriptor)

    @property
    def is_open(self) -> bool:
        """Whether a program has the port open. If no program has, polling the master gives POLLHUP."""
        poll = select.poll()
        poll.register(self.master, 0)
        return not any(flags & select.POLLHUP for _, flags in poll.poll(0))

    @property
    def baud(self) -> int:
        """Baud rate that the program has set."""
        answer = fcntl.ioctl(self.master, TCGETS2, bytes(TERMIOS2.size))
        return int(TERMIOS2.unpack(answer)[-1])

    def put(self, byte: int) -> bool:
        """Queue a byte for the host; return False if the queue is full because the host does not read."""
        if len(self._unsent) >= PACKET_BYTES and not self.flush():
            return False
        self._unsent += bytes((byte,))
        return True

    def send(self, data: bytes) -> bool:
        """Send all of `data`, or return False if nothing could be sent.

        If only a part can be sent, the rest is sent later.
        """
        if not self.flush():
            return False
        self._unsent = data
        if self.flush() or len(self._unsent) < len(data):
            return True
        self._unsent = b""
        return False

    def flush(self) -> bool:
        """Send the queued bytes; return False if some are left."""
        try:
            while self._unsent:
                self._unsent = self._unsent[os.write(self.master, self._unsent) :]
        except BlockingIOError:
            return False
        except OSError:  # The client has just closed the port, so these bytes are lost.
            self._unsent = b""
        return True

    def heard(self) -> bytes:
        """Return the bytes that programs have sent to the board."""
        found = b""
        # OSError means that there are no more bytes, or that no program has the port open.
        with contextlib.suppress(OSError):
            while chunk := os.read(self.master, 4096):
                if chunk[0]:
                    self._emptied |= bool(chunk[0] & TIOCPKT_FLUSHREAD)
                else:
                    found += chunk[1:]
        return found

    def was_emptied(self) -> bool:
        """Return whether a program has emptied the port since the last call. Programs do so on opening it.

        To empty the port is to discard the board's bytes that no program has read. If a program has done so,
        this call in turn discards the bytes that programs have sent to the board.
        """
        poll = select.poll()
        poll.register(self.master, select.POLLPRI)
        if any(flags & select.POLLPRI for _, flags in poll.poll(0)):
            self.heard()
        emptied, self._emptied = self._emptied, False
        return emptied

    def fill(self) -> int:
        """Write idle bytes, which have no meaning, until the port's buffer is full; return their number."""
        written = 0
        with contextlib.suppress(BlockingIOError):
            while True:
                written += os.write(self.master, bytes(1024))
        return written

    def forget(self) -> None:
        """Discard the bytes that the last program did not read, as a real port does when it is closed."""
        self._unsent = b""
        port = os.open(self.name, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        termios.tcflush(port, termios.TCIOFLUSH)
        os.close(port)
