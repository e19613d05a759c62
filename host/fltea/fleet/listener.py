"""The fleet's connection to the MQTT broker; paho's thread receives messages and reconnects automatically."""

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
"""Most messages that the broker may send before they are acknowledged; an outage ends with many at once."""


class Listener:
    """Subscribes to the messages of all sensors, and publishes alerts.

    `take`: function that processes the topic and the payload of a message. It is called in paho's thread, and
    the broker waits meanwhile, so that messages do not pile up here.
    `report`: function that reports the kind and text of a connection error, once in each outage.
    `back`: function that is called when the connection works again after an outage.

    Raises:
        UsageError: the settings or the password files cannot be used.
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
        """Start to connect; a separate thread completes the connection."""
        self._broker.report_plain(self._report)
        self._client.loop_start()

    def publish(self, topic: str, payload: bytes, *, retain: bool) -> None:
        """Publish a message under the topic prefix; the message is lost if the broker is away."""
        with contextlib.suppress(ValueError, RuntimeError):  # paho's queue is full, or paho never connected
            if self.is_up.is_set():
                self._client.publish(f"{self._prefix}/{topic}", payload, qos=1, retain=retain)

    def fetch(self, device_ids: list[str]) -> None:
        """Subscribe to the retained messages of some sensors.

        This ends the subscription of the previous call.

        Not all sensors are requested at once, since the broker would drop most messages. Mosquitto queues
        only 1,000 messages for a client that reads more slowly than the broker sends, and a fit has 25 kB.
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
