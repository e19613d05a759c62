"""Publish the records of one device to an MQTT broker (host/docs/guide/outputs.md)."""

import re
import secrets
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

from fltea.diagnostics.asked import AskedOutput
from fltea.diagnostics.finding import Finding
from fltea.mqtt.broker import Broker
from fltea.mqtt.connection import Connection, Session
from fltea.mqtt.link import Link
from fltea.records import clock
from fltea.records.block import Block
from fltea.records.identities import MOST, FewIdentities
from fltea.records.ports import Item, Report, Sink, Wanted
from fltea.records.records import AnyRecord, DeviceEstimates, DeviceFits, Estimate, Fit, Hello, Record, Stats
from fltea.settings.mqtt import MqttConfig
from fltea.sinks.json_lines import BlockLines
from fltea.sinks.mqtt.delivery import BACKLOG, Delivery, Message
from fltea.sinks.mqtt.discovery import discovery, discovery_topic
from fltea.sinks.mqtt.shared import SharedConnection, check_broker
from fltea.sinks.mqtt.status import DeviceStatus, status_of
from fltea.sinks.opening import Opening
from fltea.sinks.record_json import record_json

FAREWELL_S = 5.0
"""Longest wait for the broker to acknowledge the last messages [s]."""

LONGEST_NAME = 64
"""Largest number of characters of a device's name in its topics. A recording may state an identifier of any
length.
"""

KINDS = {
    "sample": Wanted(samples=True),
    "estimate": Wanted(estimates=True),
    "corrected": Wanted(corrected=True),
}
"""The kinds of records that a block contains once for each sample. For each kind: the argument `wanted` with
which `BlockLines.of` returns the records of this kind, and no others.
"""


@dataclass(slots=True)
class Published:
    """The published states of one device, kept until another device takes its place on the same port.

    `level`: the part of the device's topics that names the device. `fit`: newest fit, as JSON. `discovery`:
    configuration for Home Assistant. `offered`: the HELLO and the units of the axes from which this
    configuration was made.
    """

    hello: Hello
    level: str
    client_id: str
    status: DeviceStatus
    fit: bytes | None = None
    discovery: Message | None = None
    offered: tuple[Hello, dict[str, str]] | None = None


class MqttSink(Sink):
    """Publishes the records of one device.

    The sink usually has a connection of its own, so that the connection's only last will can be the device's
    status.

    All methods run in the thread of the sink queue, which calls `write` and `flush`. Another thread handles
    the network.

    `shared`: a connection shared by many devices. The topics then contain the device's name and not the
    identifier in its HELLO, which may be that of another device.

    Raises:
        UsageError: settings or secrets cannot be used.
    """

    name = "mqtt"

    def __init__(
        self, settings: MqttConfig, device: str, report: Report, shared: SharedConnection | None = None
    ) -> None:
        self._settings, self._device, self._report = settings, device, report
        self._shared = shared
        broker = Broker(settings) if shared is None else shared.broker
        self._link = Link(broker, report)
        self._delivery = Delivery(self._link, report, self._introduce)
        self._lines = BlockLines()
        self._early: deque[AnyRecord] = deque()
        self._published: Published | None = None
        self._identities = FewIdentities()
        self._turned_away = False
        self._seen: dict[str, int] = {}
        if shared is None:
            broker.report_plain(report)

    @property
    def lost(self) -> int:  # type: ignore[override]
        """Number of records that no broker accepted, or of which it is uncertain whether they arrived."""
        return self._delivery.lost

    def write(self, item: Item) -> None:
        """Publish a record.

        Until the first HELLO, and while the connection is lost, only rare records are kept for later.
        Frequent ones, such as estimates, are dropped.
        """
        self._delivery.poll()
        if isinstance(item, Block):
            self._on_block(item)
        elif not isinstance(item, Record):
            return
        elif isinstance(item, Hello):
            self._on_hello(item)
        elif self._published is None and not self._turned_away:
            self._keep_early(item)
        elif isinstance(item, Estimate | DeviceEstimates):
            if self._is_due(_kind(item), item.seq, self._settings.estimate_every):
                self._stream(_kind(item), record_json(item), self._settings.stream_qos)
        elif isinstance(item, DeviceFits | Stats):
            if isinstance(item, Stats):
                self._offer_discovery(item)
            self._stream(_kind(item), record_json(item), 1, again=not isinstance(item, Stats))
        elif self._published is None:
            self._delivery.lost += 1
        # a fit is published as a state, so that later subscribers get the newest one
        elif isinstance(item, Fit):
            self._published.fit = record_json(item)
            self._publish_state("fit", self._published.fit)
        else:
            self._delivery.keep(Message(self._topic(_kind(item)), record_json(item), again=True))
            self._delivery.send_waiting()

    def _on_block(self, block: Block) -> None:
        """Publish those samples and estimates of the block that are due."""
        published = self._published
        if published is None and not self._turned_away:
            return
        if published is not None and published.status.on_sample(published.hello, clock.host_ns()):
            self._publish_status()
        every = self._settings.sample_every
        for row in block.due_rows:
            seq, due = int(block.seq[row]), []
            if every and self._is_due("sample", seq, every):
                due.append("sample")
            if block.estimates and self._is_due("estimate", seq, self._settings.estimate_every):
                due += ["estimate", *(["corrected"] if block.corrected_dps is not None else [])]
            for kind in due:
                line = self._lines.of(block, KINDS[kind], range(row, row + 1))
                self._stream(kind, line[:-1], self._settings.stream_qos)

    def _is_due(self, kind: str, seq: int, every: int) -> bool:
        """Return whether to publish the record of the sample with number `seq`.

        It is published if `seq` is a multiple of `every`. If the sample with such a number is missing, the
        next sample that arrives is published instead.
        """
        before, self._seen[kind] = self._seen.get(kind, seq), seq
        return seq % every == 0 or seq // every > before // every

    def flush(self) -> None:
        """Handle the events of the connection, and publish the status if it is due."""
        self._delivery.poll()
        published = self._published
        if published is None:
            return
        if self._link.is_due():
            self._connect(published)
        if published.status.check(published.hello, clock.host_ns()):
            self._publish_status()
        self._delivery.send_waiting()

    def close(self) -> None:
        """Publish that the device is offline, and end the connection.

        Messages that the broker has not acknowledged within `FAREWELL_S` are lost.
        """
        self.end()
        self.leave(FAREWELL_S)

    def end(self) -> None:
        """Publish that the device is offline."""
        self._delivery.poll()
        if self._published is not None:
            self._published.status.change("offline", self._published.hello, clock.host_ns())
            self._publish_status()

    def leave(self, farewell_s: float = 0.0) -> None:
        """End the connection. If other devices share the connection, only stop using it."""
        self._delivery.leave(farewell_s)
        self._delivery.give_up()
        self._delivery.lost += len(self._early)

    # --- the device ---

    def _on_hello(self, hello: Hello) -> None:
        if not self._identities.admits(self._level_of(hello), clock.host_ns()):
            self._turn_away(hello)
            return
        self._turned_away = False
        if self._published is None or self._published.level != self._level_of(hello):
            self._begin(hello)
        else:
            self._published.hello = hello
        self._publish_state("hello", record_json(hello))
        while self._early:
            self.write(self._early.popleft())

    def _begin(self, hello: Hello) -> None:
        """Publish for the device of this HELLO from now on.

        The last will of the new connection is the status of this device.
        """
        self._retire()
        level = self._level_of(hello)
        client_id = f"fltea-{level}-{secrets.token_hex(4)}"
        status = DeviceStatus(self._device, hello, clock.host_ns())
        self._published = Published(hello, level, client_id, status)
        self._delivery.begin()
        self._connect(self._published)

    def _connect(self, published: Published) -> None:
        if self._shared is not None:
            self._link.open(self._shared.connect())
            return
        status = status_of("offline", published.hello, self._device, None, "connection_lost")
        will = self._topic("status"), record_json(status)
        self._link.open(Connection(self._link.broker, published.client_id, Session(will)))

    def _retire(self) -> None:
        """Publish that the present device was replaced by another one, and end its connection."""
        if self._published is None:
            return
        status = status_of("offline", self._published.hello, self._device, clock.host_ns(), "replaced")
        self._delivery.keep(Message(self._topic("status"), record_json(status), True, again=True))
        self._delivery.leave(0.0 if self._shared else FAREWELL_S)
        self._published = None

    def _turn_away(self, hello: Hello) -> None:
        """Refuse to publish for a device if its port has reported too many different device IDs.

        All records count as lost until the port reports a device that is accepted.
        """
        self._retire()
        self._turned_away = True
        self._delivery.lost += 1
        if self._identities.is_to_tell(clock.host_ns()):
            text = (
                f"{hello.source} reported more than {MOST} device IDs in an hour; further "
                "ones get no MQTT topics, and their records are counted as lost. Is the board faulty?"
            )
            self._report("too_many_devices", text)

    def _keep_early(self, record: AnyRecord) -> None:
        """Keep a rare record until the first HELLO tells which device it is from.

        Estimates, fits and statistics are not kept, since they come often.
        """
        if isinstance(record, Estimate | DeviceEstimates | DeviceFits | Fit | Stats):
            return
        self._early.append(record)
        if len(self._early) > BACKLOG:
            self._early.popleft()
            self._delivery.lost += 1

    def _level_of(self, hello: Hello) -> str:
        """Return the part of the device's topics that names the device."""
        return self._device if self._shared else device_level(hello, self._device)

    # --- messages ---

    def _introduce(self) -> None:
        """Publish the device's last HELLO, fit, discovery and status on a new connection."""
        published = self._published
        if published is None:
            return
        self._publish_state("hello", record_json(published.hello))
        if published.fit is not None:
            self._publish_state("fit", published.fit)
        if published.discovery is not None:
            self._delivery.state(published.discovery)
        self._publish_status()

    def _offer_discovery(self, stats: Stats) -> None:
        """Publish the configuration for Home Assistant when the axes become known or change."""
        published, root = self._published, self._settings.discovery
        units = {axis: one.unit for axis, one in stats.axes.items()}
        if root is None or published is None or not units or published.offered == (published.hello, units):
            return
        published.offered = published.hello, units
        level = published.level
        found = discovery(f"{self._settings.prefix}/{level}", level, published.hello, stats.axes)
        message = Message(discovery_topic(root, level), record_json(found), retain=True)
        # if the new HELLO differs from the last one only in its times, the configuration stays the same
        if message != published.discovery:
            published.discovery = message
            self._delivery.state(message)

    def _publish_status(self) -> None:
        if self._published is not None:
            self._publish_state("status", record_json(self._published.status.take(clock.host_ns())))

    def _publish_state(self, kind: str, payload: bytes) -> None:
        self._delivery.state(Message(self._topic(kind), payload, retain=True))

    def _stream(self, kind: str, payload: bytes, qos: int, *, again: bool = True) -> None:
        if self._published is None:
            self._delivery.lost += 1
            return
        self._delivery.stream(Message(self._topic(kind), payload, again=again, qos=qos))

    def _topic(self, kind: str) -> str:
        assert self._published is not None
        return f"{self._settings.prefix}/{self._published.level}/{kind}"


def _kind(record: Record) -> str:
    """Return the last part of a record's topic, which is the type of the record."""
    return str(record.__struct_config__.tag)


def device_level(hello: Hello, device: str) -> str:
    """Return the board's own identifier, or else the device's name, as one part of a topic."""
    name = (hello.device_id or device)[:LONGEST_NAME]
    return re.sub(r"[+#/\x00-\x1f\x7f-\x9f]", "_", name) or "_"


def open_output(opening: Opening) -> MqttSink:
    """Open the output to MQTT for one device."""
    return MqttSink(opening.program.mqtt, opening.device, opening.report)


def check_output(asked: AskedOutput) -> Iterator[Finding]:
    """Yield whether something answers at the broker's address."""
    return check_broker(asked)
