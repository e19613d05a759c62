"""Keep one connection to an MQTT broker from its opening to its end; it is never opened again.

The library runs the connection in a thread of its own. Its events are queued in `events`, which the sink
reads, so no lock is needed here. Each attempt uses a new client, since a client that reconnects sends its old
messages after the sink's newest status.
"""

import sys
import time
from collections import deque
from typing import NamedTuple

from paho.mqtt.client import Client, ConnectFlags, DisconnectFlags
from paho.mqtt.properties import Properties
from paho.mqtt.reasoncodes import ReasonCode

from fltea.sinks.mqtt.broker import KEEPALIVE_S, Broker

POLL_S = 0.002


class Up(NamedTuple):
    """The broker has accepted the connection."""


class Acknowledged(NamedTuple):
    """A message was sent (QoS 0), or reached the broker (QoS 1). `refusal`: why it was not taken."""

    mid: int
    refusal: str | None


class Down(NamedTuple):
    """The connection has ended, or could not be opened; kind and message of the `error` record."""

    kind: str
    message: str


class _Shared:
    """What the callbacks need; not the connection itself, so that its sockets are freed at once."""

    def __init__(self, broker: Broker) -> None:
        self.broker = broker
        self.events: deque[Up | Acknowledged | Down] = deque()
        self.answered = self.closed = False


class Connection:
    """Connects at once, in the background.

    `will`: topic and payload that the broker publishes, retained, if the program vanishes.
    """

    def __init__(self, broker: Broker, client_id: str, will: tuple[str, bytes]) -> None:
        self._shared = _Shared(broker)
        self.events = self._shared.events
        self._client = client = broker.client(client_id, userdata=self._shared)
        client.on_connect = _on_connect
        client.on_connect_fail = _on_connect_fail
        client.on_publish = _on_publish
        client.on_disconnect = _on_disconnect
        client.will_set(*will, qos=1, retain=True)
        client.connect_async(broker.address.host, broker.address.port, keepalive=KEEPALIVE_S)
        client.loop_start()

    def publish(self, topic: str, payload: bytes, qos: int, retain: bool) -> int | None:
        """Pass a message on without waiting.

        Returns:
            The number under which the message will be acknowledged; None if it cannot be sent now.
        """
        info = self._client.publish(topic, payload, qos, retain)
        return info.mid if info.rc == 0 else None

    def close(self) -> None:
        """End the connection after all published messages, without waiting; the will is not published."""
        self._shared.closed = True
        self._client.disconnect()


def await_end(events: deque[Up | Acknowledged | Down], deadline_s: float) -> None:
    """Wait for the end of a closed connection, at most until `deadline_s` of `time.monotonic()`.

    If the program hung up sooner, the broker would publish the will.
    """
    while time.monotonic() < deadline_s and not any(isinstance(event, Down) for event in events):
        time.sleep(POLL_S)


def _on_connect(
    client: Client, shared: _Shared, flags: ConnectFlags, reason: ReasonCode, properties: Properties | None
) -> None:
    if reason.is_failure:
        shared.events.append(Down(*shared.broker.explain_refusal(reason)))
    elif shared.closed:  # `close` was called while the connection was being opened
        client.disconnect()
    else:
        shared.answered = True
        shared.events.append(Up())


def _on_connect_fail(client: Client, shared: _Shared) -> None:
    shared.events.append(Down(*shared.broker.explain_failure(sys.exception())))
    client.disconnect()  # otherwise the library's thread would try again


def _on_publish(
    client: Client, shared: _Shared, mid: int, reason: ReasonCode, properties: Properties
) -> None:
    shared.events.append(Acknowledged(mid, reason.getName() if reason.is_failure else None))


def _on_disconnect(
    client: Client, shared: _Shared, flags: DisconnectFlags, reason: ReasonCode, properties: Properties | None
) -> None:
    shared.events.append(Down(*shared.broker.explain_end(reason, shared.answered)))
