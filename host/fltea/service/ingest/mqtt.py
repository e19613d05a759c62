"""Receive frames of many devices from an MQTT broker, over one connection with one subscription."""

import secrets
import threading
import time
from typing import Any

from paho.mqtt.client import Client, ConnectFlags, DisconnectFlags, MQTTMessage
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties
from paho.mqtt.reasoncodes import ReasonCode
from paho.mqtt.subscribeoptions import SubscribeOptions

from fltea.records.ports import Report
from fltea.service.ingest.inbox import Inbox
from fltea.settings.mqtt import MqttConfig
from fltea.sinks.mqtt.broker import KEEPALIVE_S, Broker

BACKOFF_S = (0.5, 1.0, 2.0, 5.0, 10.0)
LEVEL = "frames"
"""Last level of the topics `<prefix>/<device>/frames`."""

SESSION_S = 600
"""Time after a loss of the connection for which the broker keeps messages, as far as it has room [s]."""

HOLD_S = 0.1
POLL_S = 1.0

NEW_ONLY = 2
"""Option of MQTT 5: the broker sends no retained messages, since these are frames of unknown age."""


class MqttFrames:
    """Receives in a thread of its own until it is closed; an absent broker is tried again.

    While the inbox has no room, nothing is read, so messages wait at the broker.

    `connected`: whether a connection exists now. Each outage is reported once, with its reason, and again
    when it is over. `partitions`: None, since no other worker shares these messages.

    Raises:
        UsageError: settings or secrets cannot be used.
    """

    partitions: None = None

    def __init__(self, settings: MqttConfig, inbox: Inbox, report: Report) -> None:
        self._broker = Broker(settings)
        self._inbox, self._report = inbox, report
        self._topic = f"{settings.prefix}/+/{LEVEL}"
        self._place = settings.prefix.count("/") + 1
        self.url = str(self._broker.address)
        self.connected = False
        self._reported: set[str] = set()
        self._answered = False
        self._failures = 0
        self._name = f"fltea-frames-{secrets.token_hex(4)}"
        self._has_session = False
        self._stop = threading.Event()
        self._client: Client | None = None
        self._thread = threading.Thread(target=self._run, name="frames", daemon=True)
        self._broker.report_plain(report)

    def start(self) -> None:
        """Begin to receive."""
        self._thread.start()

    def close(self) -> None:
        """Receive no more."""
        self._stop.set()
        client = self._client
        if client is not None:
            client.disconnect(properties=_session(PacketTypes.DISCONNECT, 0))
        if self._thread.is_alive():
            self._thread.join(1.0)

    def _run(self) -> None:
        """Connect again and again; each connection has a client of its own, which runs in this thread."""
        while not self._stop.is_set():
            client = self._new_client()
            self._client, self._answered = client, False
            try:
                client.connect(
                    self._broker.address.host,
                    self._broker.address.port,
                    keepalive=KEEPALIVE_S,
                    clean_start=not self._has_session,
                    properties=_session(PacketTypes.CONNECT, SESSION_S),
                )
                if self._stop.is_set():
                    client.disconnect()
                self._receive(client)
            except Exception as error:  # anything that network and TLS raise
                self._report_once(*self._broker.explain_failure(error))
            self.connected = False
            self._failures += 1
            self._stop.wait(BACKOFF_S[min(self._failures, len(BACKOFF_S)) - 1])

    def _receive(self, client: Client) -> None:
        """Take messages until the connection ends; while the inbox has no room, leave them at the broker.

        A broker drops a silent client. The answer to a ping could not be read here, and the library would
        then end the connection. So the client subscribes again instead, which changes nothing.
        """
        alive_s = time.monotonic()
        while client.socket() is not None:
            if self._stop.is_set() or self._inbox.wait_for_room(HOLD_S):
                if client.loop(POLL_S):
                    return
            elif time.monotonic() - alive_s >= KEEPALIVE_S / 3:
                alive_s = time.monotonic()
                self._subscribe(client)
                if client.loop_write():
                    return

    def _new_client(self) -> Client:
        client = self._broker.client(self._name)
        client.on_connect, client.on_disconnect = self._on_connect, self._on_disconnect
        client.on_message, client.on_subscribe = self._on_message, self._on_subscribe
        return client

    def _on_connect(
        self, client: Client, _: Any, flags: ConnectFlags, reason: ReasonCode, properties: Properties | None
    ) -> None:
        if reason.is_failure:
            self._report_once(*self._broker.explain_refusal(reason))
            client.disconnect()
            return
        self._answered = self._has_session = True
        self._subscribe(client)

    def _subscribe(self, client: Client) -> None:
        client.subscribe(self._topic, options=SubscribeOptions(qos=1, retainHandling=NEW_ONLY))

    def _on_subscribe(
        self, client: Client, _: Any, mid: int, reasons: list[ReasonCode], properties: Properties | None
    ) -> None:
        if reasons[0].is_failure:
            text = (
                f"{self.url}: the broker does not let this user read {self._topic} ({reasons[0].getName()}): "
                "its access list has to."
            )
            self._report_once("broker_refused", text)
            client.disconnect()
            return
        self.connected, self._failures = True, 0
        if self._reported:
            self._report("broker_back", f"{self.url} is back; frames that it did not keep are lost.")
            self._reported = set()

    def _on_disconnect(
        self, client: Client, _: Any, flags: DisconnectFlags, reason: ReasonCode, properties: Any
    ) -> None:
        self.connected = False
        if not self._stop.is_set() and reason.is_failure:
            self._report_once(*self._broker.explain_end(reason, self._answered))

    def _on_message(self, client: Client, _: Any, message: MQTTMessage) -> None:
        if not message.retain:
            levels = message.topic.split("/")
            self._inbox.put(levels[self._place], bytes(message.payload))

    def _report_once(self, kind: str, text: str) -> None:
        if kind not in self._reported and not self._stop.is_set():
            self._reported.add(kind)
            self._report(kind, text)


def _session(packet: int, expiry_s: int) -> Properties:
    """Return how long the broker keeps the session of a connection that has ended."""
    found = Properties(packet)  # type: ignore[no-untyped-call]
    found.SessionExpiryInterval = expiry_s
    return found
