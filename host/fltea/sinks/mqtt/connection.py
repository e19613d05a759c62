"""One connection to an MQTT broker, from its opening to its end; it is never opened again.

The library runs it in a thread of its own. What happens there is queued in `events` and read by the sink, so
nothing here needs a lock. Each attempt is a new client: one that reconnects by itself sends its old messages
after the sink's newest status.
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
    """The broker has let us in."""


class Acknowledged(NamedTuple):
    """A message is on its way (QoS 0) or at the broker (QoS 1). refusal: why the broker did not take it."""

    mid: int
    refusal: str | None


class Down(NamedTuple):
    """The connection has ended, or never began; kind and message of the `error` record."""

    kind: str
    message: str


class _Shared:
    """What the callbacks know; not the connection, or its sockets would wait for the garbage collector."""

    def __init__(self, broker: Broker) -> None:
        self.broker = broker
        self.events: deque[Up | Acknowledged | Down] = deque()
        self.answered = self.closed = False


class Connection:
    """Connects at once, in the background.

    will: topic and payload that the broker publishes, retained, if we vanish.
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
        """Hand a message over, without waiting.

        Returns:
            The number under which it will be acknowledged; None if it cannot be sent now.
        """
        info = self._client.publish(topic, payload, qos, retain)
        return info.mid if info.rc == 0 else None

    def close(self) -> None:
        """End the connection after all that was published, without waiting; the will is not published."""
        self._shared.closed = True
        self._client.disconnect()


def await_end(events: deque[Up | Acknowledged | Down], deadline_s: float) -> None:
    """Wait for the end of a connection that was closed, until `time.monotonic()`.

    A broker that is hung up on sooner would publish the will.
    """
    while time.monotonic() < deadline_s and not any(isinstance(event, Down) for event in events):
        time.sleep(POLL_S)


def _on_connect(
    client: Client, shared: _Shared, flags: ConnectFlags, reason: ReasonCode, properties: Properties | None
) -> None:
    if reason.is_failure:
        shared.events.append(Down(*shared.broker.explain_refusal(reason)))
    elif shared.closed:  # while it was being opened
        client.disconnect()
    else:
        shared.answered = True
        shared.events.append(Up())


def _on_connect_fail(client: Client, shared: _Shared) -> None:
    shared.events.append(Down(*shared.broker.explain_failure(sys.exception())))
    client.disconnect()  # or the library's thread would go on trying


def _on_publish(
    client: Client, shared: _Shared, mid: int, reason: ReasonCode, properties: Properties
) -> None:
    shared.events.append(Acknowledged(mid, reason.getName() if reason.is_failure else None))


def _on_disconnect(
    client: Client, shared: _Shared, flags: DisconnectFlags, reason: ReasonCode, properties: Properties | None
) -> None:
    shared.events.append(Down(*shared.broker.explain_end(reason, shared.answered)))
