"""A limit on repeated messages: each goes out once a minute at most, however often its cause comes."""

from collections.abc import Hashable

REPEAT_NS = 60 * 10**9


class OnceAMinute:
    """Remembers when each message went out. The program bounds the number of keys, not a device."""

    def __init__(self) -> None:
        self._sent_ns: dict[Hashable, int] = {}

    def is_due(self, key: Hashable, now_ns: int) -> bool:
        """Return whether a message may go out now, by a monotonic clock in ns; if so, it counts as sent."""
        sent_ns = self._sent_ns.get(key)
        if sent_ns is not None and now_ns - sent_ns < REPEAT_NS:
            return False
        self._sent_ns[key] = now_ns
        return True

    def forget(self) -> None:
        """Let everything be news."""
        self._sent_ns.clear()
