"""Measures for how long nothing has come from a sender, although this program listened."""

PATIENCE_NS = 5 * 10**9
"""After this time without input, a sender is reported as silent [ns]."""

STALL_NS = 2 * 10**9
"""If this program has not listened for longer than this, missing input does not prove that the sender was
silent [ns]. The program does not listen while it is stopped or the computer sleeps.
"""


class Silence:
    """Tells the silence of a sender from a stall of this program.

    The caller has to call `heard` or `lasts` at least once a second while it listens. `now_ns`: time at which
    the caller begins to listen [ns].
    """

    def __init__(self, now_ns: int) -> None:
        self._since_ns = self._listened_ns = now_ns

    def heard(self, now_ns: int) -> None:
        """Note that something came."""
        self._since_ns = self._listened_ns = now_ns

    def lasts(self, now_ns: int, patience_ns: int = PATIENCE_NS) -> bool:
        """Return whether nothing has come for `patience_ns`, and the program has listened all the time."""
        if now_ns - self._listened_ns > STALL_NS:
            self._since_ns = now_ns
        self._listened_ns = now_ns
        return now_ns - self._since_ns >= patience_ns
