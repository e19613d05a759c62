"""A pseudo-terminal on which something is said again and again, as by a board."""

import contextlib
import os
import pty
import termios
import threading
import tty
from collections.abc import Callable, Iterator


class SpeakingPort:
    """A pseudo-terminal on which `speech`, given the number of the turn, is said every `every_s`."""

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
        """The rate that the terminal is set to, as termios names it."""
        return int(termios.tcgetattr(self._slave)[4])


@contextlib.contextmanager
def speaking(speech: Callable[[int], bytes], every_s: float) -> Iterator[SpeakingPort]:
    """A port that speaks until the end of the block."""
    port = SpeakingPort(speech, every_s)
    port._thread.start()
    try:
        yield port
    finally:
        port._stop.set()
        port._thread.join()
        os.close(port._master)
        os.close(port._slave)
