"""Limit the number of device identities.

With this limit, a board that changes its name again and again cannot fill the memory.
"""

from collections.abc import Hashable

MOST = 4
PERIOD_NS = 3600 * 10**9


class FewIdentities:
    """Admits at most `MOST` different identities within `PERIOD_NS`.

    Nobody who exchanges boards by hand exceeds this number. An admitted identity stays admitted as long as it
    arrives at least once within each period.

    `turned_away`: number of refusals.
    """

    def __init__(self) -> None:
        self.turned_away = 0
        self._heard_ns: dict[Hashable, int] = {}
        self._sent_ns: int | None = None

    def admits(self, identity: Hashable, now_ns: int) -> bool:
        """Return whether this identity is admitted. `now_ns`: current time of a monotonic clock [ns]."""
        if identity not in self._heard_ns:
            self._heard_ns = {other: ns for other, ns in self._heard_ns.items() if now_ns - ns < PERIOD_NS}
            if len(self._heard_ns) >= MOST:
                self.turned_away += 1
                return False
        self._heard_ns[identity] = now_ns
        return True

    def is_to_tell(self, now_ns: int) -> bool:
        """Return whether to report a refusal now. After a True, all calls return False for `PERIOD_NS`."""
        if self._sent_ns is not None and now_ns - self._sent_ns < PERIOD_NS:
            return False
        self._sent_ns = now_ns
        return True
