"""Let a signal ask the program to end in an orderly way."""

import contextlib
import signal
from types import FrameType

from fltea.process.interrupted import Interrupted
from fltea.process.wake_up import WakeUp


class StopOnSignal(contextlib.AbstractContextManager["StopOnSignal"]):
    """Makes SIGINT, SIGTERM and SIGHUP ask the program to end.

    While `armed` is false, the signals raise Interrupted instead.

    `count`: number of signals so far. `wake_up`: flag that is set when the end is asked for. A
    `threading.Event` in place of this flag could hang: if a second signal came while the first is handled,
    its handler would wait forever for the event's lock.
    """

    def __init__(self) -> None:
        self.asked = self.armed = False
        self.wake_up = WakeUp()
        self.count = 0
        self._before: dict[signal.Signals, object] = {}

    def __enter__(self) -> "StopOnSignal":
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            if number == signal.SIGHUP and signal.getsignal(number) == signal.SIG_IGN:
                continue  # the program was started by nohup, so it goes on when its terminal is closed
            self._before[number] = signal.signal(number, self._on_signal)
        return self

    def __exit__(self, *exception: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)  # type: ignore[arg-type]

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        if not self.armed:
            raise Interrupted(number)
        self.count += 1
        self.ask()

    def ask(self) -> None:
        """Ask the program to end."""
        self.asked = True
        self.wake_up.ring()
