"""Publishes alerts to the broker."""

from collections import deque
from collections.abc import Callable, Sequence

import msgspec

from fltea.fleet.alerts import Alert, AlertList
from fltea.fleet.listener import Listener

MOST_UNSENT = 10_000
"""Largest number of alerts that wait while the broker is away; further alerts are only counted."""


class AlertPost:
    """Publishes each alert once, and the list of all alerts, which the broker retains.

    While the broker is away, the alerts wait.

    `unsent`: number of alerts that are never published, since too many were waiting.
    """

    def __init__(self, listener: Listener) -> None:
        self.unsent = 0
        self._listener = listener
        self._waiting: deque[Alert] = deque()
        self._list_sent = 0
        """Number of the connection to the broker on which the list was published last."""

    def add(self, new: Sequence[Alert]) -> None:
        """Add alerts, which the next call of `publish` sends."""
        room = MOST_UNSENT - len(self._waiting)
        self._waiting.extend(new[:room])
        self.unsent += len(new[room:])

    def publish(self, listed: Callable[[], AlertList]) -> None:
        """Publish the waiting alerts. `listed`: returns the list of all alerts."""
        # A new connection also needs a new list: the broker may still retain one from before the outage, or
        # one of an earlier run of this program.
        if self._waiting or self._list_sent != self._listener.connections:
            self._list_sent = self._listener.connections
            self._listener.publish("fleet/alerts", msgspec.json.encode(listed()), retain=True)
        while self._waiting:
            alert = self._waiting.popleft()
            self._listener.publish("fleet/alert", msgspec.json.encode(alert), retain=False)
