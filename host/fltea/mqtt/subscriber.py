"""Receive the messages of some topics from an MQTT broker, and connect again after each outage."""

import secrets
import threading
import time
from collections.abc import Callable, Sequence

from fltea.mqtt.broker import Broker
from fltea.mqtt.connection import Connection, Down, Receiver, Session, Subscription, Up
from fltea.mqtt.link import Link
from fltea.records.ports import Report
from fltea.settings.mqtt import MqttConfig

RETRY_S = 0.1
"""During an outage, the thread checks at this interval [s] whether to try again to connect."""

PLAIN = Session()
"""A session for which the broker keeps no messages, and publishes none if the program vanishes."""

FAREWELL_S = 1.0
"""Longest wait for a connection to end after it was closed [s]."""


# Why more than 12 attributes: what the caller asks for, and what becomes of one connection after another.
class Subscriber:
    """Receives messages until it is closed. A thread of its own keeps it connected.

    `name`: beginning of the client identifier. `session`: what each connection asks of the broker; if the
    broker keeps messages, later connections resume them. `on_back`: function that is called, in the thread of
    the subscriber, when the broker is back after an outage. `longest_wait_s`: longest wait before another
    attempt [s].

    `is_up`: an event that is set while messages can come. `connections`: number of connections that worked.
    `outages`: number of these connections that were lost. Each kind of failure is reported once in an outage.

    Raises:
        UsageError: the settings, or the files of passwords and certificates that they name, cannot be used.
    """

    def __init__(
        self,
        settings: MqttConfig,
        name: str,
        receiver: Receiver,
        report: Report,
        on_back: Callable[[], None],
        *,
        session: Session = PLAIN,
        longest_wait_s: float,
    ) -> None:
        self.broker = Broker(settings)
        self._receiver, self._report, self._on_back, self._session = receiver, report, on_back, session
        self.is_up = threading.Event()
        self.connections = self.outages = 0
        self._client_id = f"{name}-{secrets.token_hex(4)}"
        self._link = Link(self.broker, report, longest_wait_s)
        self._connection: Connection | None = None
        self._wake, self._stop = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def start(self) -> None:
        """Begin to connect to the broker and to receive messages."""
        self.broker.report_plain(self._report)
        self._thread.start()

    def publish(self, topic: str, payload: bytes, *, retain: bool) -> None:
        """Publish a message with QoS 1. The message is lost if the broker is away."""
        if (connection := self._working()) is not None:
            connection.publish(topic, payload, 1, retain)

    def subscribe(self, subscriptions: Sequence[Subscription]) -> None:
        """Subscribe to more topics on the present connection. A later connection does not have them."""
        if (connection := self._working()) is not None:
            connection.subscribe(subscriptions)

    def unsubscribe(self, topics: list[str]) -> None:
        """End subscriptions to topics on the present connection."""
        if (connection := self._working()) is not None:
            connection.unsubscribe(topics)

    def close(self) -> None:
        """End the connection, and receive no further messages."""
        self._stop.set()
        self._wake.set()
        if self._thread.is_alive():
            self._thread.join(2 * FAREWELL_S)

    def _working(self) -> Connection | None:
        return self._connection if self.is_up.is_set() else None

    def _run(self) -> None:
        while not self._stop.is_set():
            if self._link.is_due():
                self._connect()
            self._wake.wait(None if self.is_up.is_set() else RETRY_S)
            self._wake.clear()
            for event in self._link.events():
                if isinstance(event, Up):
                    self._on_up(event)
                elif isinstance(event, Down):
                    self._on_down()
        self._link.close(time.monotonic() + FAREWELL_S)
        self.is_up.clear()

    def _connect(self) -> None:
        self._connection = Connection(
            self.broker, self._client_id, self._session, self._receiver, self._wake.set
        )
        self._link.open(self._connection)

    def _on_up(self, event: Up) -> None:
        was_away = self._link.end_outage() is not None
        self._session = self._session._replace(resumed=self._session.kept_s > 0)
        self.connections += 1
        self.is_up.set()
        if was_away:
            self._on_back()
        if event.unreadable:
            self._report(*self.broker.explain_unreadable(event.unreadable))

    def _on_down(self) -> None:
        self.outages += self.is_up.is_set()
        self.is_up.clear()
