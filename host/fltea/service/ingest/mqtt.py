"""Receive frames of many devices from an MQTT broker, over one connection with one subscription."""

from collections.abc import Callable, Iterator
from functools import partial

from fltea.diagnostics.addresses import answers
from fltea.diagnostics.asked import AskedSource
from fltea.diagnostics.finding import Finding
from fltea.mqtt.connection import Receiver as Listener
from fltea.mqtt.connection import Session, Subscription
from fltea.mqtt.subscriber import Subscriber
from fltea.records.ports import Report
from fltea.service.ingest.inbox import Inbox
from fltea.service.ingest.receiver import Receiver
from fltea.settings.config import Config
from fltea.settings.ingest import broker_at
from fltea.settings.mqtt import MqttConfig

LEVEL = "frames"
"""Last part of the MQTT topics `<prefix>/<device>/frames`."""

LONGEST_WAIT_S = 10.0

SESSION_S = 600
"""The broker is asked to keep messages for this time after the connection was lost [s]."""


class MqttFrames:
    """Receives frames from an MQTT broker, and connects again whenever the connection is lost.

    While the inbox has no room, nothing is read from the connection, so messages wait at the broker. Messages
    that the broker has retained are left out, since the age of their frames is unknown.

    `partitions`: None, since a single worker receives all messages.

    Raises:
        UsageError: settings or secrets cannot be used.
    """

    partitions: None = None

    def __init__(self, settings: MqttConfig, inbox: Inbox, report: Report) -> None:
        self._inbox, self._report = inbox, report
        self._place = settings.prefix.count("/") + 1
        topic = Subscription(f"{settings.prefix}/+/{LEVEL}", retained=False)
        self._subscriber = Subscriber(
            settings,
            "fltea-frames",
            Listener([topic], self._take, inbox.wait_for_room),
            report,
            self._on_back,
            session=Session(kept_s=SESSION_S),
            longest_wait_s=LONGEST_WAIT_S,
        )
        self.url = str(self._subscriber.broker.address)

    @property
    def connected(self) -> bool:
        """Whether the connection works, so that messages can arrive."""
        return self._subscriber.is_up.is_set()

    def start(self) -> None:
        """Begin to receive messages."""
        self._subscriber.start()

    def close(self) -> None:
        """End the connection."""
        self._subscriber.close()

    def _take(self, topic: str, payload: bytes, retained: bool) -> None:
        if not retained:
            levels = topic.split("/")
            self._inbox.put(levels[self._place] if len(levels) > self._place else "", payload)

    def _on_back(self) -> None:
        self._report("broker_back", f"{self.url} is back; frames that the broker did not keep are lost.")


def receiver_of(config: Config) -> Callable[[Inbox, Report], Receiver]:
    """Return a function that makes the receiver for the broker of the source's URL.

    Raises:
        UsageError: the URL is not the address of a broker.
    """
    return partial(MqttFrames, broker_at(config.source or "", config.mqtt))


def check_source(asked: AskedSource) -> Iterator[Finding]:
    """Yield whether something answers at the broker's address."""
    broker = broker_at(asked.url or "", asked.config.mqtt).address()
    yield answers("source", "broker", broker.host, broker.port)
