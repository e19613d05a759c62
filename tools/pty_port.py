"""A board's port as a pseudo-terminal: its name, what waits for whoever opens it, and whether anybody has."""

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
"""What the bridge hands to the host in one piece of USB."""
TIOCPKT = 0x5420
TIOCPKT_FLUSHREAD = 1
TCGETS2 = 0x802C542A
TERMIOS2 = struct.Struct("4I20s2I")


class PtyPort:
    """Master side of a pseudo-terminal in raw mode.

    held: it keeps what is written while no program has it open. link: a symbolic link to it, under a name of
    one's own; see `show_as`.
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
        """Let a symbolic link point to it.

        Raises:
            UsageError: something else has that name, or it cannot be made.
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
        """Vanish, with the link if it is still ours."""
        link = self._link
        if link is not None and link.is_symlink() and str(link.readlink()) == self.name:
            link.unlink()
        for descriptor in self._open:
            os.close(descriptor)

    @property
    def is_open(self) -> bool:
        """Whether a program has the port open: until then the master's poll says POLLHUP."""
        poll = select.poll()
        poll.register(self.master, 0)
        return not any(flags & select.POLLHUP for _, flags in poll.poll(0))

    @property
    def baud(self) -> int:
        """Baud rate that the program has set."""
        answer = fcntl.ioctl(self.master, TCGETS2, bytes(TERMIOS2.size))
        return int(TERMIOS2.unpack(answer)[-1])

    def put(self, byte: int) -> bool:
        """Take a byte for the host; False while it does not read."""
        if len(self._unsent) >= PACKET_BYTES and not self.flush():
            return False
        self._unsent += bytes((byte,))
        return True

    def send(self, data: bytes) -> bool:
        """Send it all, or say that there was no room for any of it; what is begun is always finished."""
        if not self.flush():
            return False
        self._unsent = data
        if self.flush() or len(self._unsent) < len(data):
            return True
        self._unsent = b""
        return False

    def flush(self) -> bool:
        """Hand over what waits; False if some is left."""
        try:
            while self._unsent:
                self._unsent = self._unsent[os.write(self.master, self._unsent) :]
        except BlockingIOError:
            return False
        except OSError:  # the client has just gone, and its bytes with it
            self._unsent = b""
        return True

    def heard(self) -> bytes:
        """What programs have sent to the board."""
        found = b""
        with contextlib.suppress(OSError):  # nothing more, or nobody has the port open
            while chunk := os.read(self.master, 4096):
                if chunk[0]:
                    self._emptied |= bool(chunk[0] & TIOCPKT_FLUSHREAD)
                else:
                    found += chunk[1:]
        return found

    def was_emptied(self) -> bool:
        """Whether a program has thrown away what waited for it since this was asked last.

        Each does while it opens the port. What programs have sent is lost.
        """
        poll = select.poll()
        poll.register(self.master, select.POLLPRI)
        if any(flags & select.POLLPRI for _, flags in poll.poll(0)):
            self.heard()
        emptied, self._emptied = self._emptied, False
        return emptied

    def fill(self) -> None:
        """Put idle bytes, which mean nothing, on the line until there is no more room."""
        with contextlib.suppress(BlockingIOError):
            while True:
                os.write(self.master, bytes(1024))

    def forget(self) -> None:
        """Throw away what the last program did not fetch, as a real port does when it is closed."""
        self._unsent = b""
        port = os.open(self.name, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        termios.tcflush(port, termios.TCIOFLUSH)
        os.close(port)
