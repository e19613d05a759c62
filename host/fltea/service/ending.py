"""Wait at the end of the program for sources, streams and outputs, with a time limit and messages."""

import time
from collections.abc import Callable, Sequence
from typing import NamedTuple

KEEP_S = 40.0
"""After a signal to end, writing snapshots and recordings may take this long [s]. The limit is long, since
their data exist nowhere else.
"""

OTHER_S = 10.0
"""After a signal to end, the program waits this long for sources, device streams and other outputs to end,
since they may hang [s].

This time and `KEEP_S`, the time for snapshots and recordings, are together less than 90 s. After 90 s, a
service manager kills the program.
"""

SAY_S, POLL_S = 3.0, 0.05


class Awaited(NamedTuple):
    """A task, such as the closing of an output, whose end the program waits for.

    `name`: name of the task, for messages. `done`: function that waits for the task up to the given time [s],
    and returns whether the task has ended.

    `kept`: whether the task writes data that exist nowhere else.
    """

    name: str
    done: Callable[[float], bool]
    kept: bool = False


class Ending:
    """Waits for tasks to end.

    As soon as a signal or a failure asks for the end, the waiting has a time limit.

    `asked`: function that returns whether a signal or a failure has asked for the end. `signals`: function
    that returns the number of signals received. After a few seconds, a message says for which task the
    program waits. One more signal after this message ends the waiting. `say`: function that writes a message.
    `left`: names of the tasks that did not end in time. `lost`: those of them whose data exist nowhere else.
    """

    def __init__(
        self, asked: Callable[[], bool], signals: Callable[[], int], say: Callable[[str], None]
    ) -> None:
        self._asked, self._signals, self._say = asked, signals, say
        self._patient_until: int | None = None
        self.left: list[str] = []
        self.lost: list[str] = []

    def wait(self, awaited: Sequence[Awaited]) -> None:
        """Wait for all tasks in `awaited`. The time limits begin for all tasks at the same time."""
        began_s: float | None = None
        for name, done, kept in awaited:
            most_s = KEEP_S if kept else OTHER_S
            while not done(POLL_S):
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
                    self._say(
                        f"waits for {name}, up to {most_s:g} s; another signal ends the waiting at once."
                    )

    def _is_urged(self) -> bool:
        return self._patient_until is not None and self._signals() > self._patient_until
