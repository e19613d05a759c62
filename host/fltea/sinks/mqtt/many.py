"""Publish the records of many devices over one connection (host/docs/guide/ingest.md).

Each device has an `MqttSink`, but all these sinks share one thread and one connection. So topics, states,
retries and counts of a device are the same as if it had a connection of its own. A device's topics contain
the name under which the broker let the device publish, never the identifier in its HELLO. The program
publishes a status of itself in the topic `<prefix>/<program>/ingest`. If the program vanishes, the
connection's last will publishes there that it is offline.
"""

import secrets
import time
from collections.abc import Collection, Iterator

import msgspec

from fltea.diagnostics.asked import AskedOutput
from fltea.diagnostics.finding import Finding
from fltea.mqtt.broker import Broker
from fltea.mqtt.connection import POLL_S, Up
from fltea.mqtt.link import Link
from fltea.records.block import Block
from fltea.records.clock import host_ns, unix_offset_ns
from fltea.records.ports import Departed, Item, Report, Sink
from fltea.records.records import Record
from fltea.records.repeat import OnceAMinute
from fltea.settings.mqtt import MqttConfig
from fltea.sinks.mqtt.shared import SharedConnection, check_broker
from fltea.sinks.mqtt.sink import FAREWELL_S, MqttSink
from fltea.sinks.mqtt.status import Status
from fltea.sinks.opening import Opening

UPDATE_S = 0.5
"""Time between two updates of the outputs of all devices [s]. The output of a device with new records is
updated at once.
"""

IDLE_NS = 3600 * 10**9
"""Time after which a device without records is forgotten [ns]."""

EVERY = 1000
"""Of each device, samples and estimates are published at most once in this number of samples. At 100 Hz, this
is once in ten seconds.
"""


class OwnStatus:
    """Publishes the status of this program, which is no device's, on each new connection.

    `program`: name of this program. `will`: message that the broker publishes if the program vanishes.
    """

    def __init__(self, settings: MqttConfig, program: str) -> None:
        self._program = program
        self._topic = f"{settings.prefix}/{program}/ingest"
        self.will = (self._topic, self._status("offline", "connection_lost"))

    def open(self, broker: Broker, shared: SharedConnection, report: Report) -> None:
        """Connect to the broker."""
        self._shared, self._link = shared, Link(broker, report)
        self._link.open(shared.connect())

    def look(self) -> None:
        """Connect again if the connection was lost. On each new connection, publish the status."""
        if self._link.is_due():
            self._link.open(self._shared.connect())
        for event in self._link.events():
            if isinstance(event, Up):
                self._link.end_outage()
                self._publish("online", None)

    def end(self) -> None:
        """Publish that the program has ended."""
        self._publish("offline", "ended")

    def _publish(self, status: str, reason: str | None) -> None:
        self._link.publish(self._topic, self._status(status, reason), 1, True)

    def _status(self, status: str, reason: str | None) -> bytes:
        since_ns = None if reason == "connection_lost" else host_ns() + unix_offset_ns()
        return msgspec.json.encode(
            Status(status, since_ns, "ingest", None, self._program, reason)  # type: ignore[arg-type]
        )


class ManyMqttSink(Sink):
    """Publishes the records of all devices that reach this program through MQTT brokers.

    `program`: name of this program in its status. `apart`: names of the devices that have outputs of their
    own. Records of these devices are ignored here.

    Raises:
        UsageError: settings or secrets cannot be used.
    """

    name = "mqtt"
    capacity = 200_000
    rest_s = 0.05

    def __init__(
        self, settings: MqttConfig, program: str, report: Report, apart: Collection[str] = ()
    ) -> None:
        every = max(EVERY, settings.estimate_every)
        sample_every = max(EVERY, settings.sample_every) if settings.sample_every else 0
        self._settings = msgspec.structs.replace(settings, estimate_every=every, sample_every=sample_every)
        self._apart = frozenset(apart)
        self._report, self._once_a_minute = report, OnceAMinute()
        broker = Broker(settings)
        self._own = OwnStatus(settings, program)
        self._shared = SharedConnection(broker, f"fltea-{program}-{secrets.token_hex(4)}", self._own.will)
        self._own.open(broker, self._shared, self._report_once)
        self._sinks: dict[str, MqttSink] = {}
        self._heard_ns: dict[str, int] = {}
        self._touched: set[str] = set()
        self._gone_lost = 0
        self._updated_s = time.monotonic()

    @property
    def lost(self) -> int:  # type: ignore[override]
        """Number of records that were not published, of all devices together."""
        return self._gone_lost + sum(sink.lost for sink in self._sinks.values())

    def write(self, item: Item) -> None:
        """Pass a record to the output of its device."""
        if not isinstance(item, Record | Block) or not item.device or item.device in self._apart:
            return
        self._shared.pump()
        name = item.device
        sink = self._sinks.get(name)
        if sink is None:
            sink = MqttSink(self._settings, name, self._report_once, self._shared)
            self._sinks[name] = sink
        self._heard_ns[name] = host_ns()
        sink.write(item)
        self._touched.add(name)

    def depart(self, departed: Departed) -> None:
        """Forget a device, and publish that it is offline.

        If the device has moved to another program, publish nothing, since the other program publishes the
        device's status.
        """
        if departed.device in self._sinks:
            self._forget(departed.device, end=not departed.moved)

    def flush(self) -> None:
        """Update the outputs of the devices with new records.

        Every `UPDATE_S`, update the outputs of all devices.
        """
        self._shared.pump()
        now_s = time.monotonic()
        touched, self._touched = self._touched, set()
        if now_s - self._updated_s >= UPDATE_S:
            self._updated_s = now_s
            self._own.look()
            self._forget_idle()
            touched = set(self._sinks)
        for name in touched:
            self._sinks[name].flush()

    def close(self) -> None:
        """Publish that all devices are offline, and end the connection."""
        self._shared.pump()
        for sink in self._sinks.values():
            sink.end()
        if self._shared.up:
            self._own.end()
        deadline_s = time.monotonic() + FAREWELL_S
        while self._shared.waiting and self._shared.up and time.monotonic() < deadline_s:
            time.sleep(POLL_S)
            self._shared.pump()
        for sink in self._sinks.values():
            sink.leave()
        self._shared.close(deadline_s)

    def _forget_idle(self) -> None:
        now_ns = host_ns()
        for name in [name for name, ns in self._heard_ns.items() if now_ns - ns > IDLE_NS]:
            self._forget(name, end=True)

    def _forget(self, name: str, *, end: bool) -> None:
        sink = self._sinks.pop(name)
        del self._heard_ns[name]
        self._touched.discard(name)
        if end:
            sink.end()
        sink.leave()
        self._gone_lost += sink.lost

    def _report_once(self, kind: str, message: str) -> None:
        """Report a trouble.

        If all devices have the same trouble, such as an absent broker, report it only once.
        """
        if self._once_a_minute.is_due(kind, host_ns()):
            self._report(kind, message)


def open_output(opening: Opening) -> ManyMqttSink:
    """Open the output for all devices that reach this program through MQTT brokers."""
    return ManyMqttSink(opening.program.mqtt, opening.shared[0], opening.report, set(opening.apart))


def check_output(asked: AskedOutput) -> Iterator[Finding]:
    """Yield whether something answers at the broker's address."""
    return check_broker(asked)
