"""What the program waits for at its end, for how long, and what it says meanwhile."""

import time
from collections.abc import Callable, Sequence
from typing import NamedTuple

KEEP_S = 40.0
"""What nothing else has, snapshots and recordings, gets so long to be written after a signal."""

OTHER_S = 10.0
"""Sources, walks and other outputs get so long: a bus may hang, and a reader may have stopped reading.

All together is less than the 90 s after which a service manager kills.
"""

SAY_S, LOOK_S = 3.0, 0.05


class Awaited(NamedTuple):
    """Something that ends. name: for people. done: waits so many seconds for it; whether it has ended.

    kept: it writes what nothing else has.
    """

    name: str
    done: Callable[[float], bool]
    kept: bool = False


class Ending:
    """Waits for what ends: as long as it takes, and up to a limit once the end was asked for.

    asked: whether it was, by a signal or a failure. signals: how many there were; one that comes after it was
    said what is waited for ends the waiting. say: writes a line. left: what did not end in time; lost: those
    of it that write what nothing else has.
    """

    def __init__(
        self, asked: Callable[[], bool], signals: Callable[[], int], say: Callable[[str], None]
    ) -> None:
        self._asked, self._signals, self._say = asked, signals, say
        self._patient_until: int | None = None
        self.left: list[str] = []
        self.lost: list[str] = []

    def wait(self, awaited: Sequence[Awaited]) -> None:
        """Wait for all of these, side by side."""
        began_s: float | None = None
        for name, done, kept in awaited:
            most_s = KEEP_S if kept else OTHER_S
            while not done(LOOK_S):
                if not self._asked():
                    continue
                began_s = time.monotonic() if began_s is None else began_s
                waited_s = time.monotonic() - began_s
                if waited_s >= most_s or self._is_urged():
                    self.left.append(name)
                    self.lost += [name] if kept else []
                    self._say(f"{name} did not end in time; its last data are lost.")
                    break
                if waited_s >= SAY_S and self._patient_until is None:
                    self._patient_until = self._signals()
                    self._say(f"waits for {name}, up to {most_s:g} s; another signal ends it at once.")

    def _is_urged(self) -> bool:
        return self._patient_until is not None and self._signals() > self._patient_until
