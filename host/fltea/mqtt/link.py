"""Keep a part of the program connected to an MQTT broker: open another connection after each outage."""

from collections import deque
from collections.abc import Iterator
from typing import Protocol

from fltea.mqtt.broker import Broker
from fltea.mqtt.connection import Acknowledged, Down, Event, Up, await_end
from fltea.records import clock
from fltea.records.ports import Report

BACKOFF_S = (0.5, 1.0, 2.0, 5.0, 10.0, 30.0)
"""Times to wait before connecting again [s]: after the first failure, the second one in a row, and so on."""

SETTLED_NS = 10 * 10**9
"""If a connection has worked for this time [ns] when it is lost, the waits of BACKOFF_S begin anew with the
first one.
"""

OPENING_NS = 45 * 10**9
"""Time after which a connection that has not opened is given up [ns]."""


class Opened(Protocol):
    """What a `Link` holds: a connection to a broker, or one device's view of a connection that many share."""

    events: deque[Event]

    def publish(self, topic: str, payload: bytes, qos: int, retain: bool) -> int | None:
        """Pass a message on to be sent, as `Connection.publish` does."""

    def close(self) -> None:
        """End the connection without waiting."""


class Link:
    """Keeps one connection at a time. One thread calls all methods; the connection has its own thread.

    `report`: function that reports a failure to connect. In an outage, it is called once for each kind of
    failure. `up`: whether the broker takes messages at present. `longest_wait_s`: longest wait before another
    attempt [s].
    """

    def __init__(self, broker: Broker, report: Report, longest_wait_s: float = BACKOFF_S[-1]) -> None:
        self.broker, self._report = broker, report
        self._backoff_s = [min(wait_s, longest_wait_s) for wait_s in BACKOFF_S]
        self.up = False
        self._connection: Opened | None = None
        self._opened_ns = self._retry_ns = 0
        self._failures = 0
        self._outage_since_ns: int | None = None
        self._reported: set[str] = set()

    @property
    def in_outage(self) -> bool:
        """Whether a connection has failed, and no connection has worked since."""
        return self._outage_since_ns is not None

    def is_due(self) -> bool:
        """Return whether a connection is to be opened now."""
        return self._connection is None and clock.host_ns() >= self._retry_ns

    def open(self, connection: Opened) -> None:
        """Let this be the link's connection from now on. It has just begun to open."""
        self._opened_ns = clock.host_ns()
        self._connection = connection

    def publish(self, topic: str, payload: bytes, qos: int, retain: bool) -> int | None:
        """Pass a message on to be sent, as `Connection.publish` does."""
        return None if self._connection is None else self._connection.publish(topic, payload, qos, retain)

    def events(self) -> Iterator[Up | Acknowledged | Down]:
        """Yield the connection's events since the last call. After `Down` the connection is gone."""
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
        """End the outage, and return how long the broker was away [s]; None if there was no outage."""
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
        self._retry_ns = now_ns + int(self._backoff_s[min(self._failures, len(BACKOFF_S) - 1)] * 1e9)
        self._failures += 1
        if event.kind not in self._reported:
            self._reported.add(event.kind)
            self._report(event.kind, event.message)
