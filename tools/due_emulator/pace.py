"""Whether the board keeps up with real time, and the words for it when it does not."""

import math

BEHIND_S = 0.5
"""A lag behind real time that is worth a warning: at half the speed it takes a second to grow."""
AGAIN_S = 60.0
"""The shortest time between two warnings."""
WINDOW_S = 1.0
"""Time over which the speed is measured."""


class Pace:
    """Follows one run from its beginning; `look` with moments that never run backwards."""

    def __init__(self) -> None:
        self.worst_lag_s = 0.0
        self._mark = (0.0, 0.0)
        self._speed: float | None = None
        self._warned_s = -math.inf

    def look(self, real_s: float, board_s: float) -> str | None:
        """Return the warning that is due now, if one is.

        real_s, board_s: time since the beginning, and how much of it the board has lived [s].
        """
        lag_s = real_s - board_s
        self.worst_lag_s = max(self.worst_lag_s, lag_s)
        before_s, board_before_s = self._mark
        if real_s - before_s >= WINDOW_S:
            self._speed = (board_s - board_before_s) / (real_s - before_s)
            self._mark = (real_s, board_s)
        # A lag that shrinks is being made good.
        if lag_s <= BEHIND_S or real_s - self._warned_s < AGAIN_S or self._speed is None or self._speed >= 1:
            return None
        self._warned_s = real_s
        return (
            f"this machine is too slow or too busy: the board runs at {self._speed:.0%} of real time and is "
            f"{lag_s:.1f} s behind."
        )
