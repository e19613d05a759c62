"""Keep a sink connected to its broker: open the connection, and open it again after an outage."""

from collections.abc import Iterator

from fltea.records import clock
from fltea.records.ports import Report
from fltea.sinks.mqtt.broker import Broker
from fltea.sinks.mqtt.connection import Acknowledged, Connection, Down, Up, await_end
from fltea.sinks.mqtt.shared import SharedConnection, View

BACKOFF_S = (0.5, 1.0, 2.0, 5.0, 10.0, 30.0)
"""Times from a lost connection to the next attempt, by the number of failures in a row [s]."""

SETTLED_NS = 10 * 10**9
"""Time after which a connection counts as good, so that the wait after a failure is short again [ns]."""

OPENING_NS = 45 * 10**9
"""Time after which a connection that has not opened is given up [ns]."""


class Link:
    """Has one connection at a time. One thread calls all methods; the connection itself has another.

    `shared`: a connection shared by many devices; None: the link has its own. `up`: whether the broker takes
    messages now.
    """

    def __init__(self, broker: Broker, report: Report, shared: SharedConnection | None) -> None:
        self.broker, self._report, self._shared = broker, report, shared
        self.up = False
        self._connection: Connection | View | None = None
        self._opened_ns = self._retry_ns = 0
        self._failures = 0
        self._outage_since_ns: int | None = None
        self._reported: set[str] = set()

    @property
    def in_outage(self) -> bool:
        """Whether a connection has failed, and none has worked since."""
        return self._outage_since_ns is not None

    def is_due(self) -> bool:
        """Return whether a connection is to be opened now."""
        return self._connection is None and clock.host_ns() >= self._retry_ns

    def open(self, client_id: str = "", will: tuple[str, bytes] = ("", b"")) -> None:
        """Open a connection in the background. `client_id`, `will`: unused if it is shared."""
        self._opened_ns = clock.host_ns()
        if self._shared is not None:
            self._connection = self._shared.connect()
        else:
            self._connection = Connection(self.broker, client_id, will)

    def publish(self, topic: str, payload: bytes, qos: int, retain: bool) -> int | None:
        """Pass a message on, as `Connection.publish` does."""
        return None if self._connection is None else self._connection.publish(topic, payload, qos, retain)

    def events(self) -> Iterator[Up | Acknowledged | Down]:
        """Yield what happened since the last call; after `Down` the connection is gone."""
        while self._connection is not None and self._connection.events:
            event = self._connection.events.popleft()
            if isinstance(event, Up):
                self.up, self._opened_ns = True, clock.host_ns()
            elif isinstance(event, Down):
                self._on_down(event)
            yield event
        if self._connection is not None and not self.up and clock.host_ns() - self._opened_ns > OPENING_NS:
            event = Down(*self.broker.explain_failure(TimeoutError()))
            self._on_down(event)
            yield event

    def end_outage(self) -> float | None:
        """Return for how many seconds the broker was away; None if it was not."""
        since_ns, self._outage_since_ns = self._outage_since_ns, None
        self._reported.clear()
        return None if since_ns is None else (clock.host_ns() - since_ns) * 1e-9

    def close(self, deadline_s: float) -> bool:
        """End the connection, and wait for it until `deadline_s`; return whether there was a connection."""
        connection, self._connection = self._connection, None
        if connection is None:
            return False
        connection.close()
        if self.up:
            await_end(connection.events, deadline_s)
        self.up = False
        return True

    def _on_down(self, event: Down) -> None:
        now_ns = clock.host_ns()
        if self.up and now_ns - self._opened_ns > SETTLED_NS:
            self._failures = 0
        if self._outage_since_ns is None:
            self._outage_since_ns = now_ns
        self.close(0.0)
        self._retry_ns = now_ns + int(BACKOFF_S[min(self._failures, len(BACKOFF_S) - 1)] * 1e9)
        self._failures += 1
        if event.kind not in self._reported:
            self._reported.add(event.kind)
            self._report(event.kind, event.message)
