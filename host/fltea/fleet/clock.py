"""The fleet's clocks: Unix time for its records, and how long it has been listening."""

import time
from collections.abc import Callable

JUMP_S = 60.0
"""The wall clock is taken as set again if it differs from the steady one by more."""

LONG_JUMP_S = 86_400.0
"""After such a jump nothing is pruned: nobody knows how old the rows are."""


class Clock:
    """Unix time that does not jump with the wall clock by itself, but follows it, and counts the jumps.

    `hearing` is a steady time in s that stands while the broker is away: nobody is silent whom nobody could
    have heard.
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
        """Return Unix time, as of now."""
        offset = self._wall() - self.steady()
        if abs(offset - self._offset) > JUMP_S:
            self.jumps += 1
            self.long_jump |= abs(offset - self._offset) > LONG_JUMP_S
            self._offset = offset
        return self.steady() + self._offset

    def hear(self, is_up: bool) -> None:
        """Take note of whether the broker is there."""
        if not is_up and self._deaf_since is None:
            self._deaf_since = self.steady()
        elif is_up and self._deaf_since is not None:
            self._deaf_s += self.steady() - self._deaf_since
            self._deaf_since = None

    def hearing(self) -> float:
        """Seconds on the clock that stands during outages."""
        return (self.steady() if self._deaf_since is None else self._deaf_since) - self._deaf_s
