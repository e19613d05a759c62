"""Publishes the records of one device to an MQTT broker (host/README.md, MQTT)."""

import secrets
import time
from collections import deque
from typing import Literal, NamedTuple

import msgspec

from fltea.records.block import Block
from fltea.records.clock import host_ns, unix_offset_ns
from fltea.records.identities import MOST, FewIdentities
from fltea.records.ports import Item, Report, Sink
from fltea.records.records import AnyRecord, DeviceEstimates, DeviceFits, Estimate, Fit, Hello, Record, Stats
from fltea.settings.outputs import MqttConfig
from fltea.sinks.mqtt.broker import Broker
from fltea.sinks.mqtt.connection import Acknowledged, Connection, Down, Up
from fltea.sinks.mqtt.device_topics import Status, device_level
from fltea.sinks.mqtt.flight import Flight, Message
from fltea.sinks.mqtt.shared import SharedConnection, View

BACKLOG = 1000
"""Rare records that are kept while the broker is away; the oldest go first."""

IN_FLIGHT = 2000
"""Messages that the broker has not yet acknowledged; beyond it new ones are lost: the network is too slow."""

STALLED_NS = 2 * 10**9
REPEAT_NS = 30 * 10**9
"""The status is said again after this long: an earlier connection's will may come late and overwrite it."""

BACKOFF_S = (0.5, 1.0, 2.0, 5.0, 10.0, 30.0)
SETTLED_NS = 10 * 10**9
"""A connection that lived this long was a good one, so the backoff begins again."""

OPENING_NS = 45 * 10**9
FAREWELL_S = 0.4


class _Outage(NamedTuple):
    since_ns: int
    lost_before: int
    told: set[str]


class MqttSink(Sink):
    """One connection a device, since a connection has one last will.

    All here runs in the outlet's thread, which drives it by `write` and `flush`; the network has another.

    shared: a connection that many devices have together. Each then stands under its own name, since what its
    HELLO says may be another's.

    Raises:
        UsageError: settings or secrets that cannot be used.
    """

    name = "mqtt"

    def __init__(
        self, settings: MqttConfig, device: str, report: Report, shared: SharedConnection | None = None
    ) -> None:
        self._settings = settings
        self._shared = shared
        self._device = device
        self._report = report
        self._broker = Broker(settings) if shared is None else shared.broker
        self._encode = msgspec.json.Encoder().encode
        self._early: deque[AnyRecord] = deque()
        self._hello: Hello | None = None
        self._identities = FewIdentities()
        self._turned_away = False
        self._base = ""
        self._fit: bytes | None = None
        self._status: Status | None = None
        self._status_due_ns = 0
        self._sample_ns: int | None = None
        self._seen: dict[str, int] = {}
        self._client_id = ""
        self._connection: Connection | View | None = None
        self._began_ns = 0
        self._up = self._refusal_told = False
        self._backlog: deque[Message] = deque()
        self._outage: _Outage | None = None
        self._failures = 0
        self._retry_ns = 0
        self._flight = Flight()
        if shared is None and self._broker.shows_password:
            report(
                "broker_plain",
                f"{self._broker.address}: the password crosses the network in clear; use mqtts:// if the "
                "broker can.",
            )

    def write(self, item: Item) -> None:
        """Publish a record, or keep it until its device and the broker are there."""
        self._on_events()
        if isinstance(item, Block):
            self._on_block(item)
        elif not isinstance(item, Record):
            return
        elif isinstance(item, Hello):
            self._on_hello(item)
        elif self._hello is None and not self._turned_away:
            self._keep_early(item)
        elif isinstance(item, Estimate):
            if self._is_due("estimate", item.seq, self._settings.estimate_every):
                self._stream("estimate", item, self._settings.stream_qos)
        elif isinstance(item, DeviceEstimates):
            if self._is_due("device_estimate", item.seq, self._settings.estimate_every):
                self._stream("device_estimate", item, self._settings.stream_qos)
        elif isinstance(item, DeviceFits):
            self._stream("device_fit", item, 1)
        elif isinstance(item, Stats):
            self._stream("stats", item, 1)
        elif isinstance(item, Fit):
            self._on_fit(item)
        else:
            self._keep(Message(self._topic(type(item).__name__.lower()), self._encode(item), again=True))
            self._send_backlog()

    def _on_block(self, block: Block) -> None:
        """Publish the samples and estimates that are due."""
        if self._hello is None and not self._turned_away:
            return
        self._sample_ns = host_ns()
        if self._hello is not None and self._status is not None and self._status.status != "online":
            self._say("online")
        qos = self._settings.stream_qos
        for row in block.due_rows:
            seq, chosen = int(block.seq[row]), slice(row, row + 1)
            every = self._settings.sample_every
            if every and self._is_due("sample", seq, every):
                self._stream("sample", next(block.samples(chosen)), qos)
            if block.estimates and self._is_due("estimate", seq, self._settings.estimate_every):
                self._stream("estimate", next(block.estimate_records(chosen)), qos)

    def _is_due(self, kind: str, seq: int, every: int) -> bool:
        """Whether it is the first in `every` samples; a device, or `output.every`, may leave none at it."""
        before, self._seen[kind] = self._seen.get(kind, seq), seq
        return seq % every == 0 or seq // every > before // every

    def flush(self) -> None:
        """Look after the connection and the status."""
        self._on_events()
        if self._hello is None:
            return
        now_ns = host_ns()
        if self._connection is None:
            if now_ns >= self._retry_ns:
                self._connect()
        elif not self._up and now_ns - self._began_ns > OPENING_NS:
            self._on_down(Down(*self._broker.explain_failure(TimeoutError())))
        if self._sample_ns is not None and now_ns - self._sample_ns > STALLED_NS:
            self._sample_ns = None
            self._say("stalled")
        elif self._up and now_ns >= self._status_due_ns:
            self._publish_status()
        self._send_backlog()

    def close(self) -> None:
        """Say that the device is offline, and farewell; what the broker has not had by then is lost."""
        self.say_ended()
        self._leave(FAREWELL_S)
        self.lost += len(self._backlog) + len(self._early)

    def say_ended(self) -> None:
        """Say that the device is offline."""
        self._on_events()
        if self._hello is not None:
            self._say("offline", "ended")

    def leave(self) -> None:
        """Leave a shared connection, which its owner waits for."""
        self._leave(0.0)
        self.lost += len(self._backlog) + len(self._early)

    # --- the device ---

    def _on_hello(self, hello: Hello) -> None:
        if not self._identities.admits(self._id(hello), host_ns()):
            self._turn_away(hello)
            return
        self._turned_away = False
        if self._hello is None or self._id(self._hello) != self._id(hello):
            self._begin(hello)
        self._hello = hello
        self._publish_state("hello", self._encode(hello))
        while self._early:
            self.write(self._early.popleft())

    def _begin(self, hello: Hello) -> None:
        """From now on for this device, with a will of its own."""
        self._retire()
        device_id = self._id(hello)
        self._hello = hello
        self._base = f"{self._settings.prefix}/{device_id}"
        self._client_id = f"fltea-{device_id}-{secrets.token_hex(4)}"
        self._refusal_told = False
        self._say("stalled")
        self._connect()

    def _retire(self) -> None:
        """Say that the device was replaced, and end its connection."""
        if self._hello is None:
            return
        self._keep(Message(self._topic("status"), self._offline("replaced", host_ns()), True, again=True))
        self._leave(FAREWELL_S if self._shared is None else 0.0)
        self._hello = self._status = self._sample_ns = self._fit = None

    def _turn_away(self, hello: Hello) -> None:
        """Give a device no topics: what it says is counted as lost until one comes that may have some."""
        self._retire()
        self._turned_away = True
        self.lost += 1
        if self._identities.is_to_tell(host_ns()):
            text = (
                f"{hello.source} has said more than {MOST} different device_id within an hour, so further "
                "ones get no topics of MQTT; what they say is lost there and counted. Is the board faulty?"
            )
            self._report("too_many_devices", text)

    def _keep_early(self, record: AnyRecord) -> None:
        """Keep what is worth it until the first HELLO says whose it is."""
        if isinstance(record, Estimate | DeviceEstimates | DeviceFits | Fit | Stats):
            return
        self._early.append(record)
        if len(self._early) > BACKLOG:
            self._early.popleft()
            self.lost += 1

    def _on_fit(self, fit: Fit) -> None:
        """A state: whoever comes later, or after an outage, is told the newest one."""
        if self._turned_away:
            self.lost += 1
            return
        self._fit = self._encode(fit)
        self._publish_state("fit", self._fit)

    def _id(self, hello: Hello) -> str:
        """The device's level in the topics."""
        return device_level(hello, self._device) if self._shared is None else self._device

    # --- the status ---

    def _say(
        self, status: Literal["online", "stalled", "offline"], reason: Literal["ended"] | None = None
    ) -> None:
        assert self._hello is not None
        now_ns = host_ns() + unix_offset_ns()
        device_id = self._hello.device_id
        self._status = Status(status, now_ns, self._hello.source, device_id, self._device, reason)
        self._publish_status()

    def _publish_status(self) -> None:
        self._status_due_ns = host_ns() + REPEAT_NS
        self._publish_state("status", self._encode(self._status))

    def _offline(self, reason: Literal["connection_lost", "replaced"], since_ns: int | None) -> bytes:
        assert self._hello is not None
        if since_ns is not None:
            since_ns += unix_offset_ns()
        return self._encode(
            Status("offline", since_ns, self._hello.source, self._hello.device_id, self._device, reason)
        )

    # --- messages ---

    def _topic(self, kind: str) -> str:
        return f"{self._base}/{kind}"

    def _stream(self, kind: str, record: AnyRecord, qos: int) -> None:
        """Publish one of many: lost if the broker is away, or does not keep up."""
        if self._turned_away:
            self.lost += 1
            return
        message = Message(self._topic(kind), self._encode(record), again=kind != "stats", qos=qos)
        if self._up and not (len(self._flight) < IN_FLIGHT and self._publish(message)):
            self.lost += 1
        elif not self._up and self._outage is None and len(self._backlog) < BACKLOG:
            self._backlog.append(message)  # the first connection is being made: a matter of milliseconds
        elif not self._up:
            self.lost += 1

    def _publish_state(self, kind: str, payload: bytes) -> None:
        if self._up:
            self._publish(Message(self._topic(kind), payload, retain=True))

    def _keep(self, message: Message) -> None:
        if self._turned_away:
            self.lost += 1
            return
        self._backlog.append(message)
        if len(self._backlog) > BACKLOG:
            self._backlog.popleft()
            self.lost += 1

    def _send_backlog(self) -> None:
        while self._up and self._backlog and len(self._flight) < IN_FLIGHT:
            if not self._publish(self._backlog[0]):
                return
            self._backlog.popleft()

    def _publish(self, message: Message) -> bool:
        assert self._connection is not None
        mid = self._connection.publish(message.topic, message.payload, message.qos, message.retain)
        if mid is None:
            return False
        self._flight.began(mid, message)
        return True

    def _take_back(self) -> None:
        """The connection is gone: count what nobody acknowledged, keep what is sent again."""
        self._connection, self._up = None, False
        unsure, messages = self._flight.end()
        self.lost += unsure
        waiting, self._backlog = self._backlog, deque()
        for message in (*[m for m in messages if m.again], *waiting):
            self._keep(message)
        self.lost += sum(not (message.again or message.retain) for message in messages)

    # --- the connection ---

    def _connect(self) -> None:
        self._began_ns = host_ns()
        if self._shared is not None:
            self._connection = self._shared.connect()
            return
        will = (self._topic("status"), self._offline("connection_lost", None))
        self._connection = Connection(self._broker, self._client_id, will)

    def _leave(self, farewell_s: float) -> None:
        """Take leave of the broker, but not before it has acknowledged all: it may else publish the will."""
        deadline_s = time.monotonic() + farewell_s
        self._send_backlog()
        while self._up and self._flight.messages and time.monotonic() < deadline_s:
            time.sleep(0.002)
            self._on_events()
            self._send_backlog()
        connection = self._connection
        if connection is not None:
            connection.close()
            while self._up and time.monotonic() < deadline_s:
                time.sleep(0.002)
                self._up = not any(isinstance(event, Down) for event in connection.events)
            self._take_back()

    def _on_events(self) -> None:
        while self._connection is not None and self._connection.events:
            event = self._connection.events.popleft()
            if isinstance(event, Acknowledged):
                self._on_acknowledged(event)
            elif isinstance(event, Up):
                self._on_up()
            else:
                self._on_down(event)

    def _on_acknowledged(self, event: Acknowledged) -> None:
        message = self._flight.arrived(event.mid)
        if message is None or event.refusal is None:
            return
        self.lost += not message.retain
        if not self._refusal_told:
            self._refusal_told = True
            text = (
                f"{self._broker.address}: the broker does not take {message.topic} ({event.refusal}): its "
                f"access list has to let this user write to {self._base}/#."
            )
            self._report("broker_refused", text)

    def _on_up(self) -> None:
        self._up = True
        self._began_ns = host_ns()
        outage, self._outage = self._outage, None
        self._send_backlog()  # may hold an older status, so before the newest
        self._publish_state("hello", self._encode(self._hello))
        if self._fit is not None:
            self._publish_state("fit", self._fit)
        self._publish_status()
        if outage is not None:
            away_s, lost = (host_ns() - outage.since_ns) * 1e-9, self.lost - outage.lost_before
            count = f"{lost} records were lost" if lost else "nothing was lost"
            self._report("broker_back", f"{self._broker.address} is back after {away_s:.1f} s; {count}.")

    def _on_down(self, event: Down) -> None:
        now_ns = host_ns()
        if self._up and now_ns - self._began_ns > SETTLED_NS:
            self._failures = 0
        if self._outage is None:
            self._outage = _Outage(now_ns, self.lost, set())
        if self._connection is not None:
            self._connection.close()
        self._take_back()
        self._retry_ns = now_ns + int(BACKOFF_S[min(self._failures, len(BACKOFF_S) - 1)] * 1e9)
        self._failures += 1
        if event.kind not in self._outage.told:
            self._outage.told.add(event.kind)
            self._report(event.kind, event.message)
