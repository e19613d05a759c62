"""The fleet's clocks: Unix time for its records, and the time during which the broker was connected."""

import time
from collections.abc import Callable

JUMP_S = 60.0
"""Difference between the wall clock and the steady clock above which the wall clock counts as set anew
[s]."""

LONG_JUMP_S = 86_400.0
"""If the wall clock is set by more than this [s], the age of the history's rows is unknown. The program then
deletes none of them until it ends.
"""


class Clock:
    """Unix time that runs steadily.

    When the wall clock is set anew, this clock follows it and counts the event.

    `hearing` returns another time [s]: the time during which this program was connected to the broker. By
    this time, no sensor counts as silent because the broker was away.
    """

    def __init__(
        self, wall: Callable[[], float] = time.time, steady: Callable[[], float] = time.monotonic
    ) -> None:
        self._wall, self.steady = wall, steady
        self._offset = wall() - steady()
        self.jumps = 0
        self.long_jump = False
        self._deaf_s = 0.0
        self._deaf_since: float | None = steady()

    def unix_s(self) -> float:
        """Return the current Unix time [s]."""
        offset = self._wall() - self.steady()
        if abs(offset - self._offset) > JUMP_S:
            self.jumps += 1
            self.long_jump |= abs(offset - self._offset) > LONG_JUMP_S
            self._offset = offset
        return self.steady() + self._offset

    def hear(self, is_up: bool) -> None:
        """Record whether the broker is connected."""
        if not is_up and self._deaf_since is None:
            self._deaf_since = self.steady()
        elif is_up and self._deaf_since is not None:
            self._deaf_s += self.steady() - self._deaf_since
            self._deaf_since = None

    def hearing(self) -> float:
        """Return the time of the clock that stops during outages [s]."""
        return (self.steady() if self._deaf_since is None else self._deaf_since) - self._deaf_s
