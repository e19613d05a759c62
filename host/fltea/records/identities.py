"""A limit on identities: a board that says another name in every HELLO must not fill any memory."""

from collections.abc import Hashable

MOST = 4
PERIOD_NS = 3600 * 10**9


class FewIdentities:
    """Admits at most `MOST` different identities within `PERIOD_NS`: boards that are exchanged by hand.

    One that was admitted goes on being so for as long as it is heard once within the period. turned_away
    counts the others.
    """

    def __init__(self) -> None:
        self.turned_away = 0
        self._heard_ns: dict[Hashable, int] = {}
        self._sent_ns: int | None = None

    def admits(self, identity: Hashable, now_ns: int) -> bool:
        """Return whether to believe this identity now, on a monotonic clock in ns."""
        if identity not in self._heard_ns:
            self._heard_ns = {one: ns for one, ns in self._heard_ns.items() if now_ns - ns < PERIOD_NS}
            if len(self._heard_ns) >= MOST:
                self.turned_away += 1
                return False
        self._heard_ns[identity] = now_ns
        return True

    def is_to_tell(self, now_ns: int) -> bool:
        """Return whether to report that one was refused; if so, it counts as reported for a period."""
        if self._sent_ns is not None and now_ns - self._sent_ns < PERIOD_NS:
            return False
        self._sent_ns = now_ns
        return True
