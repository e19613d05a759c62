"""What is told again: at most once a minute, however often it happens."""

from collections.abc import Hashable

REPEAT_NS = 60 * 10**9


class OnceAMinute:
    """Remembers when each thing was told. Keys are bounded by what a program can tell, not by a device."""

    def __init__(self) -> None:
        self._told_ns: dict[Hashable, int] = {}

    def is_due(self, key: Hashable, now_ns: int) -> bool:
        """Whether to tell it now, on a monotonic clock in ns; if so, it counts as told."""
        told_ns = self._told_ns.get(key)
        if told_ns is not None and now_ns - told_ns < REPEAT_NS:
            return False
        self._told_ns[key] = now_ns
        return True

    def forget(self) -> None:
        """Let everything be news."""
        self._told_ns.clear()
