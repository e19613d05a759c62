"""Limit repeated messages: each is sent at most once a minute, however often its cause occurs."""

from collections.abc import Hashable

REPEAT_NS = 60 * 10**9


class OnceAMinute:
    """Remembers when each message was last sent.

    The keys of the messages are chosen by the program, never by a device, so no device can fill the memory
    with them.
    """

    def __init__(self) -> None:
        self._sent_ns: dict[Hashable, int] = {}

    def is_due(self, key: Hashable, now_ns: int) -> bool:
        """Return whether the message `key` may be sent now. If so, it counts as sent.

        `now_ns`: current time of a monotonic clock [ns].
        """
        sent_ns = self._sent_ns.get(key)
        if sent_ns is not None and now_ns - sent_ns < REPEAT_NS:
            return False
        self._sent_ns[key] = now_ns
        return True

    def forget(self) -> None:
        """Forget all sent messages, so that each may be sent again at once."""
        self._sent_ns.clear()
