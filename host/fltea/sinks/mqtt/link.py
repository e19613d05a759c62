"""Keeps a sink connected to its broker: opens the connection, and after an outage opens it again."""

from collections.abc import Iterator

from fltea.records import clock
from fltea.records.ports import Report
from fltea.sinks.mqtt.broker import Broker
from fltea.sinks.mqtt.connection import Acknowledged, Connection, Down, Up, await_end
from fltea.sinks.mqtt.shared import SharedConnection, View

BACKOFF_S = (0.5, 1.0, 2.0, 5.0, 10.0, 30.0)
"""Time from a lost connection to the next attempt; it grows with each failure in a row."""

SETTLED_NS = 10 * 10**9
"""A connection that lived this long was a good one, so the backoff begins again."""

OPENING_NS = 45 * 10**9
"""A connection that is not open after this time is given up."""


class Link:
    """Has one connection at a time. All but the connection's own thread is one thread.

    shared: a connection that many devices have together; None: this one has its own. up: whether the broker
    takes messages now.
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
        """Whether a connection failed, and none has worked since."""
        return self._outage_since_ns is not None

    def is_due(self) -> bool:
        """Whether a connection is to be opened now."""
        return self._connection is None and clock.host_ns() >= self._retry_ns

    def open(self, client_id: str = "", will: tuple[str, bytes] = ("", b"")) -> None:
        """Open a connection in the background. client_id, will: of one of its own, not of a shared one."""
        self._opened_ns = clock.host_ns()
        if self._shared is not None:
            self._connection = self._shared.connect()
        else:
            self._connection = Connection(self.broker, client_id, will)

    def publish(self, topic: str, payload: bytes, qos: int, retain: bool) -> int | None:
        """Hand a message over, as `Connection.publish` does."""
        return None if self._connection is None else self._connection.publish(topic, payload, qos, retain)

    def events(self) -> Iterator[Up | Acknowledged | Down]:
        """Yield what happened since the last call; with `Down` the connection is gone."""
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
        """End the connection, and wait for its end until `time.monotonic()`; return whether there was one."""
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
