"""Imitate serial ports that tests plug in and unplug, and a port that sends bytes repeatedly."""

import contextlib
import os
import pty
import termios
import threading
import tty
from collections.abc import Callable, Iterator
from pathlib import Path


class Terminal:
    """A pseudo-terminal that imitates a serial port; it can be unplugged and plugged in again.

    `link`: a fixed name for the terminal, since the system may give a freed /dev/pts/N to another program.
    `master`: descriptor of the terminal's other end.
    """

    def __init__(self, link: Path) -> None:
        self.link = link
        self.plug()

    def plug(self) -> None:
        self.master, slave = pty.openpty()
        tty.setraw(slave)
        os.set_blocking(self.master, False)
        self.link.unlink(missing_ok=True)
        self.link.symlink_to(os.ttyname(slave))
        os.close(slave)

    def unplug(self) -> None:
        self.link.unlink(missing_ok=True)
        with contextlib.suppress(OSError):  # the test may have unplugged the terminal already
            os.close(self.master)

    def send(self, data: bytes) -> None:
        assert os.write(self.master, data) == len(data)


def unplug(made: list[Terminal]) -> None:
    for one in made:
        one.unplug()


class SpeakingPort:
    """A pseudo-terminal that sends bytes every `every_s` seconds.

    At the n-th time, it sends the bytes that `speech(n)` returns.
    """

    def __init__(self, speech: Callable[[int], bytes], every_s: float) -> None:
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.port = os.ttyname(self._slave)
        self.speech, self._every_s = speech, every_s
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._speak)

    def _speak(self) -> None:
        turn = 0
        while not self._stop.wait(self._every_s):
            with contextlib.suppress(BlockingIOError):
                os.write(self._master, self.speech(turn))
            turn += 1

    def speed(self) -> int:
        """The baud rate to which the terminal is set, as termios names it."""
        return int(termios.tcgetattr(self._slave)[4])


@contextlib.contextmanager
def speaking(speech: Callable[[int], bytes], every_s: float) -> Iterator[SpeakingPort]:
    """Start a `SpeakingPort` that sends until the `with` block ends."""
    port = SpeakingPort(speech, every_s)
    port._thread.start()
    try:
        yield port
    finally:
        port._stop.set()
        port._thread.join()
        os.close(port._master)
        os.close(port._slave)
