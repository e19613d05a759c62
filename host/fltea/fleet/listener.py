"""What arrives from the broker. The library's thread hands each message on; it reconnects by itself."""

import contextlib
import secrets
import sys
import threading
from collections.abc import Callable

from paho.mqtt.client import Client, ConnectFlags, DisconnectFlags, MQTTMessage
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties
from paho.mqtt.reasoncodes import ReasonCode
from paho.mqtt.subscribeoptions import SubscribeOptions

from fltea.fleet.messages import KINDS
from fltea.settings.mqtt import MqttConfig
from fltea.sinks.mqtt.broker import KEEPALIVE_S, Broker

RETAINED = ("hello", "fit")
LONGEST_WAIT_S = 5
IN_FLIGHT = 65_535
"""Messages that the broker may send before we acknowledge one: after an outage it has one of each sensor."""


class Listener:
    """Subscribes to what a fleet is made of, and publishes alerts.

    take: is given topic and payload, in the library's thread; the broker waits for it, so nothing piles up
    here. report: is given kind and text of what is wrong with the connection, once an outage. back: is called
    when all is well again.

    Raises:
        UsageError: settings or secrets that cannot be used.
    """

    def __init__(
        self,
        settings: MqttConfig,
        take: Callable[[str, bytes], None],
        report: Callable[[str, str], None],
        back: Callable[[], None],
    ) -> None:
        self._broker = Broker(settings)
        self._prefix, self._take, self._report, self._back = settings.prefix, take, report, back
        self.is_up = threading.Event()
        self.outages = self.connections = 0
        self._reported = self._closed = False
        self._asked: list[str] = []
        name = f"fltea-fleet-{secrets.token_hex(4)}"
        self._client = client = self._broker.client(name, reconnects=True)
        client.on_connect, client.on_connect_fail = self._on_connect, self._on_connect_fail
        client.on_disconnect, client.on_message = self._on_disconnect, self._on_message
        client.reconnect_delay_set(1, LONGEST_WAIT_S)
        wishes = Properties(PacketTypes.CONNECT)  # type: ignore[no-untyped-call]
        wishes.ReceiveMaximum = IN_FLIGHT
        address = self._broker.address
        client.connect_async(address.host, address.port, KEEPALIVE_S, properties=wishes)

    def start(self) -> None:
        """Connect, in the background."""
        self._broker.report_plain(self._report)
        self._client.loop_start()

    def publish(self, topic: str, payload: bytes, *, retain: bool) -> None:
        """Publish below the prefix; lost where the broker is away."""
        with contextlib.suppress(ValueError, RuntimeError):  # its queue is full, or it was never connected
            if self.is_up.is_set():
                self._client.publish(f"{self._prefix}/{topic}", payload, qos=1, retain=retain)

    def fetch(self, device_ids: list[str]) -> None:
        """Ask for what the broker retains of some sensors; those of the call before have been answered.

        Of all at once it would drop most: mosquitto keeps 1,000 messages for a client that reads more slowly
        than it writes, and a fit has 25 kB.
        """
        if self._asked:
            self._client.unsubscribe(self._asked)
        self._asked = [f"{self._prefix}/{name}/{kind}" for name in device_ids for kind in RETAINED]
        if self._asked:
            self._client.subscribe([(topic, SubscribeOptions(qos=1)) for topic in self._asked])

    def close(self) -> None:
        """Disconnect."""
        self._closed = True
        self._client.disconnect()
        self._client.loop_stop()

    def _on_connect(
        self,
        client: Client,
        userdata: object,
        flags: ConnectFlags,
        reason: ReasonCode,
        properties: Properties | None,
    ) -> None:
        if reason.is_failure:
            self._down(*self._broker.explain_refusal(reason))
            return
        options = SubscribeOptions(qos=1)
        later = SubscribeOptions(qos=1, retainHandling=SubscribeOptions.RETAIN_DO_NOT_SEND)
        client.subscribe(
            [(f"{self._prefix}/+/{kind}", later if kind == "fit" else options) for kind in KINDS]
        )
        if self._reported:
            self._back()
        self._reported = False
        self.connections += 1
        self.is_up.set()

    def _on_connect_fail(self, client: Client, userdata: object) -> None:
        self._down(*self._broker.explain_failure(sys.exception()))

    def _on_disconnect(
        self,
        client: Client,
        userdata: object,
        flags: DisconnectFlags,
        reason: ReasonCode,
        properties: Properties | None,
    ) -> None:
        answered = self.is_up.is_set()
        self.is_up.clear()
        if not self._closed:
            self.outages += answered
            self._down(*self._broker.explain_end(reason, answered))

    def _down(self, kind: str, text: str) -> None:
        if not self._reported and not self._closed:
            self._reported = True
            self._report(kind, text)

    def _on_message(self, client: Client, userdata: object, message: MQTTMessage) -> None:
        try:
            topic = message.topic
        except UnicodeDecodeError:
            topic = ""
        self._take(topic, bytes(message.payload))
