"""Keep one connection to an MQTT broker from its opening to its end. It is never opened a second time.

Each connection has a thread of its own, which runs the client of the library paho-mqtt. The thread puts
everything that happens into the queue `events`, which the connection's owner reads. So no lock is needed
here. Each attempt to connect uses a new client. If a client connected again, it would send the old messages
that it still holds, even after a newer status of the output.
"""

import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import NamedTuple

from paho.mqtt.client import Client, ConnectFlags, DisconnectFlags, MQTTMessage
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties
from paho.mqtt.reasoncodes import ReasonCode
from paho.mqtt.subscribeoptions import SubscribeOptions

from fltea.mqtt.broker import Broker, Failure

KEEPALIVE_S = 15
"""Interval of keep-alive messages [s]. A broker that vanishes is noticed after at most twice this time."""

POLL_S = 0.002
HOLD_S = 0.1
TURN_S = 1.0
"""Longest time for which the thread waits for the network before it examines the connection again [s]. A
message to send ends the wait earlier.
"""


class Up(NamedTuple):
    """The broker has accepted the connection and at least one of its subscriptions, if there are any.

    `unreadable`: topics that the broker does not let this user read, each with the broker's reason.
    """

    unreadable: tuple[str, ...] = ()


class Acknowledged(NamedTuple):
    """A message was sent (if it has QoS 0), or the broker has acknowledged it (QoS 1).

    `mid`: number of the message, as `publish` returned it. `refusal`: why the broker refused the message;
    None if it did not.
    """

    mid: int
    refusal: str | None


class Down(NamedTuple):
    """The connection has ended, or could not be opened.

    `kind`, `message`: fields of the `error` record that says why.
    """

    kind: str
    message: str


Event = Up | Acknowledged | Down


class Subscription(NamedTuple):
    """A topic filter to subscribe to.

    `retained`: whether the broker also sends the messages that it retains for the topic.
    """

    topic: str
    retained: bool = True


class Receiver(NamedTuple):
    """What a connection does with incoming messages.

    `take`: function that processes a message, given topic, payload, and whether the message was retained. The
    topic is empty if it is not valid UTF-8. The function is called in the connection's thread, and the broker
    waits meanwhile. `has_room`: function that waits until there is room for messages, at most for the given
    time [s], and returns whether there is room. While there is no room, nothing is read, so messages wait at
    the broker.
    """

    subscriptions: Sequence[Subscription]
    take: Callable[[str, bytes, bool], None]
    has_room: Callable[[float], bool] | None = None


class Session(NamedTuple):
    """What a connection asks of the broker.

    `will`: topic and payload that the broker publishes, retained, if the program vanishes. `kept_s`: time
    after a loss of the connection for which the broker keeps messages, as far as it has room [s]; 0: it keeps
    none. `resumed`: whether to receive the messages kept for the same client identifier. `in_flight`: largest
    number of messages that the broker may send before they are acknowledged; None: the broker's own limit.
    """

    will: tuple[str, bytes] | None = None
    kept_s: int = 0
    resumed: bool = False
    in_flight: int | None = None


class _State:
    """What the callbacks of the library's client need to know of a connection.

    The callbacks refer to this object and not to the `Connection`, so that the connection's sockets are freed
    as soon as it is dropped.
    """

    def __init__(self, broker: Broker, receiver: Receiver | None, wake: Callable[[], None]) -> None:
        self.broker, self.receiver = broker, receiver
        self._wake = wake
        self.events: deque[Event] = deque()
        self.is_answered = self.is_up = self.is_closed = self._has_ended = False
        self.subscribing: int | None = None

    def add(self, event: Event) -> None:
        self.events.append(event)
        self._wake()

    def up(self, unreadable: tuple[str, ...] = ()) -> None:
        if not self.is_up:
            self.is_up = True
            self.add(Up(unreadable))

    def end(self, failure: Failure) -> None:
        """Note the end of the connection with its reason. Only the first reason counts."""
        if not self._has_ended:
            self._has_ended = True
            self.add(Down(*failure))


class Connection:
    """A connection to a broker. It begins to open in the background as soon as this object is made.

    `receiver`: what to subscribe to; None for a connection that only publishes. `wake`: function that is
    called after each new event, in the connection's thread.
    """

    def __init__(
        self,
        broker: Broker,
        client_id: str,
        session: Session,
        receiver: Receiver | None = None,
        wake: Callable[[], None] = lambda: None,
    ) -> None:
        self._state = state = _State(broker, receiver, wake)
        self.events = state.events
        self._keeps = session.kept_s > 0
        self._client = client = broker.client(client_id, state)
        client.on_connect, client.on_disconnect = _on_connect, _on_disconnect
        client.on_publish, client.on_subscribe, client.on_message = _on_publish, _on_subscribe, _on_message
        # If this callback is set, the library leaves all writing to the thread that calls `loop`, not to the
        # thread that publishes.
        client.on_socket_register_write = lambda *_: None
        if session.will is not None:
            client.will_set(*session.will, qos=1, retain=True)
        threading.Thread(target=_run, args=(client, state, session), name="mqtt", daemon=True).start()

    def publish(self, topic: str, payload: bytes, qos: int, retain: bool) -> int | None:
        """Pass a message on to be sent, without waiting.

        Returns:
            The number under which the message will be acknowledged; None if it cannot be sent now.
        """
        info = self._client.publish(topic, payload, qos, retain)
        return info.mid if info.rc == 0 else None

    def subscribe(self, subscriptions: Sequence[Subscription]) -> None:
        """Subscribe to more topics."""
        _subscribe(self._client, subscriptions)

    def unsubscribe(self, topics: list[str]) -> None:
        """End subscriptions to topics."""
        self._client.unsubscribe(topics)

    def close(self) -> None:
        """Let the connection end once all published messages are sent. Do not wait for its end.

        The broker does not publish the will of a connection that is closed in this way.
        """
        self._state.is_closed = True
        self._client.disconnect(properties=_expiry(PacketTypes.DISCONNECT, 0) if self._keeps else None)


def await_end(events: deque[Event], deadline_s: float) -> None:
    """Wait until a closed connection has ended, at most until `deadline_s` of `time.monotonic()`.

    If the program ended before the connection has, the broker would publish the will.
    """
    while time.monotonic() < deadline_s and not any(isinstance(event, Down) for event in events):
        time.sleep(POLL_S)


def _run(client: Client, state: _State, session: Session) -> None:
    """Open the connection, and exchange messages until it ends."""
    properties = _expiry(PacketTypes.CONNECT, session.kept_s)
    if session.in_flight is not None:
        properties.ReceiveMaximum = session.in_flight
    address = state.broker.address
    try:
        client.connect(
            address.host, address.port, KEEPALIVE_S, clean_start=not session.resumed, properties=properties
        )
        _exchange(client, state)
    except Exception as error:  # network and TLS may raise anything
        state.end(state.broker.explain_failure(error))
    reason = ReasonCode(PacketTypes.DISCONNECT, "Unspecified error")
    state.end(state.broker.explain_end(reason, state.is_answered))


def _exchange(client: Client, state: _State) -> None:
    """Send and receive until the connection ends.

    While the receiver has no room for messages, do not read any. A broker drops a client that is silent for
    too long. A client that does not read cannot ping: it could not read the answer without reading messages,
    too, and the library would end the connection for lack of an answer. So the client subscribes to its
    topics again, which changes nothing but shows the broker that it lives.
    """
    alive_s = time.monotonic()
    while client.socket() is not None:
        if _can_read(state):
            if client.loop(TURN_S):
                return
        elif time.monotonic() - alive_s >= KEEPALIVE_S / 3 and state.receiver is not None:
            alive_s = time.monotonic()
            _subscribe(client, state.receiver.subscriptions)
            if client.loop_write():
                return


def _can_read(state: _State) -> bool:
    """Return whether to read: the receiver has room for messages, or the connection is not up.

    Over a connection that is not up, no messages come. This function may wait up to HOLD_S for room.
    """
    if state.receiver is None or state.receiver.has_room is None or not state.is_up or state.is_closed:
        return True
    return state.receiver.has_room(HOLD_S)


def _subscribe(client: Client, subscriptions: Sequence[Subscription]) -> int | None:
    """Subscribe, and return the number of the request; None if it could not be sent."""
    send, leave_out = SubscribeOptions.RETAIN_SEND_ON_SUBSCRIBE, SubscribeOptions.RETAIN_DO_NOT_SEND
    options = [
        (topic, SubscribeOptions(qos=1, retainHandling=send if retained else leave_out))
        for topic, retained in subscriptions
    ]
    return client.subscribe(options)[1]


def _expiry(packet: int, seconds: int) -> Properties:
    """Return the property that states how long the broker keeps the session of an ended connection."""
    found = Properties(packet)  # type: ignore[no-untyped-call]
    found.SessionExpiryInterval = seconds
    return found


def _on_connect(
    client: Client, state: _State, flags: ConnectFlags, reason: ReasonCode, properties: Properties | None
) -> None:
    if reason.is_failure:
        state.end(state.broker.explain_refusal(reason))
        client.disconnect()
        return
    state.is_answered = True
    if state.is_closed:  # `close` was called before the broker had accepted the connection
        client.disconnect()
    elif state.receiver is None:
        state.up()
    else:
        state.subscribing = _subscribe(client, state.receiver.subscriptions)


def _on_subscribe(
    client: Client, state: _State, mid: int, reasons: list[ReasonCode], properties: Properties | None
) -> None:
    if mid != state.subscribing or state.receiver is None:
        return
    asked = zip(state.receiver.subscriptions, reasons, strict=True)
    unreadable = tuple(f"{one.topic} ({reason.getName()})" for one, reason in asked if reason.is_failure)
    if len(unreadable) < len(reasons):
        state.up(unreadable)
        return
    state.end(state.broker.explain_unreadable(unreadable))
    client.disconnect()


def _on_publish(client: Client, state: _State, mid: int, reason: ReasonCode, properties: Properties) -> None:
    state.add(Acknowledged(mid, reason.getName() if reason.is_failure else None))


def _on_message(client: Client, state: _State, message: MQTTMessage) -> None:
    try:
        topic = message.topic
    except UnicodeDecodeError:
        topic = ""
    if state.receiver is not None:
        state.receiver.take(topic, bytes(message.payload), message.retain)


def _on_disconnect(
    client: Client, state: _State, flags: DisconnectFlags, reason: ReasonCode, properties: Properties | None
) -> None:
    state.end(state.broker.explain_end(reason, state.is_answered))
