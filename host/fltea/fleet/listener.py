"""The fleet's part of MQTT: which messages of the sensors it subscribes to, and where it publishes."""

from collections.abc import Callable

from fltea.fleet.messages import KINDS
from fltea.mqtt.connection import Receiver, Session, Subscription
from fltea.mqtt.subscriber import Subscriber
from fltea.records.ports import Report
from fltea.settings.mqtt import MqttConfig

RETAINED = ("hello", "fit")
LONGEST_WAIT_S = 5.0
IN_FLIGHT = 65_535
"""Largest number of messages that the broker may send before they are acknowledged.

After an outage, many messages arrive at once.
"""


class Listener:
    """Subscribes to the messages of all sensors, and publishes alerts.

    `take`: function that processes the topic and the payload of a message. It is called in the connection's
    thread, and the broker waits meanwhile, so that messages do not pile up here.
    `report`: function that reports the kind and text of a connection error.
    `back`: function that is called when the connection works again after an outage.

    Raises:
        UsageError: the settings or the password files cannot be used.
    """

    def __init__(
        self,
        settings: MqttConfig,
        take: Callable[[str, bytes], None],
        report: Report,
        back: Callable[[], None],
    ) -> None:
        self._prefix = settings.prefix
        self._asked: list[str] = []
        wanted = [Subscription(f"{settings.prefix}/+/{kind}", kind != "fit") for kind in KINDS]
        receiver = Receiver(wanted, lambda topic, payload, _: take(topic, payload))
        self._subscriber = Subscriber(
            settings,
            "fltea-fleet",
            receiver,
            report,
            back,
            session=Session(in_flight=IN_FLIGHT),
            longest_wait_s=LONGEST_WAIT_S,
        )
        self.is_up = self._subscriber.is_up

    @property
    def connections(self) -> int:
        """Number of connections that worked."""
        return self._subscriber.connections

    @property
    def outages(self) -> int:
        """Number of connections that were lost."""
        return self._subscriber.outages

    def start(self) -> None:
        """Start to connect; a separate thread completes the connection."""
        self._subscriber.start()

    def publish(self, topic: str, payload: bytes, *, retain: bool) -> None:
        """Publish a message under the topic prefix; the message is lost if the broker is away."""
        self._subscriber.publish(f"{self._prefix}/{topic}", payload, retain=retain)

    def fetch(self, device_ids: list[str]) -> None:
        """Subscribe to the retained messages of some sensors.

        Each call ends the subscription of the previous call.

        Not all sensors are requested at once, since the broker would drop most messages. Mosquitto queues
        only 1,000 messages for a client that reads more slowly than the broker sends, and a fit has 25 kB.
        """
        if self._asked:
            self._subscriber.unsubscribe(self._asked)
        self._asked = [f"{self._prefix}/{name}/{kind}" for name in device_ids for kind in RETAINED]
        if self._asked:
            self._subscriber.subscribe([Subscription(topic) for topic in self._asked])

    def close(self) -> None:
        """Disconnect."""
        self._subscriber.close()
