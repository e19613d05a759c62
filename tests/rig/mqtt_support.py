"""Make a fake MQTT broker, and an MQTT sink with a clock that the test advances."""

import json
from collections import deque
from collections.abc import Callable
from typing import Any, ClassVar

import pytest
from fltea.mqtt.connection import Acknowledged, Down, Session, Up
from fltea.records import clock
from fltea.records.records import AnyRecord, Estimate, Gap, Sample, Stats
from fltea.settings.mqtt import MqttConfig
from fltea.sinks.mqtt import sink as mqtt
from fltea.sinks.mqtt import status
from fltea.sinks.mqtt.sink import MqttSink

from tests.rig.blocks import as_items
from tests.rig.example_records import GOOD, STATS
from tests.rig.host_support import hello

S = 10**9


def sample(seq: int = 0) -> Sample:
    return Sample(seq, 1, seq, seq, (0.5,), device="due")


def estimate(seq: int) -> Estimate:
    return Estimate(seq, 1, seq, seq, "joint", {"gyro_x": GOOD}, device="due")


def stats() -> Stats:
    return STATS


def gap(seq: int = 0) -> Gap:
    return Gap(seq, 1, 1, 0, device="due")


class FakeConnection:
    """A fake connection to a broker.

    The connection accepts every message, but acknowledges a message only if the test requests it.

    `full`: whether the connection can send nothing at present.
    """

    made: ClassVar[list["FakeConnection"]] = []

    def __init__(self, broker: Any, client_id: str, session: Session) -> None:
        self.events: deque[Any] = deque()
        self.client_id, self.will = client_id, session.will
        self.sent: list[tuple[str, bytes, int, bool]] = []
        self.closed = self.full = False
        self.made.append(self)

    def publish(self, topic: str, payload: bytes, qos: int, retain: bool) -> int | None:
        if self.full:
            return None
        self.sent.append((topic, payload, qos, retain))
        return len(self.sent)

    def close(self) -> None:
        self.closed = True
        self.events.append(Down("broker_lost", "closed"))

    def acknowledge(self, *topics: str, refusal: str | None = None) -> None:
        """Let the broker acknowledge the messages on these topics, or on all topics if none is named."""
        for mid, (topic, *_) in enumerate(self.sent, 1):
            if not topics or topic in topics:
                self.events.append(Acknowledged(mid, refusal))

    def on(self, kind: str, device: str = "a0") -> list[Any]:
        return [json.loads(payload) for topic, payload, *_ in self.sent if topic == f"fltea/{device}/{kind}"]


class Driven:
    """An MQTT sink whose methods the test calls directly, without the queue that is before a sink."""

    def __init__(self, broker: str, **settings: Any) -> None:
        self.told: list[tuple[str, str]] = []
        config = MqttConfig(broker=broker, **settings)
        self.sink = MqttSink(config, "due", lambda kind, text: self.told.append((kind, text)))

    def write(self, *records: AnyRecord) -> None:
        for item in as_items(records):
            self.sink.write(item)
        self.sink.flush()


class Bench(Driven):
    """An MQTT sink with a fake broker, and a clock that the test advances."""

    def __init__(self, **settings: Any) -> None:
        super().__init__("broker.example", **settings)
        self.now_ns = 1000 * S

    def happens(self, *events: Any) -> None:
        self.connection.events.extend(events)
        self.sink.flush()

    def wait(self, seconds: float) -> None:
        self.now_ns += int(seconds * S)
        self.sink.flush()

    @property
    def connection(self) -> FakeConnection:
        return FakeConnection.made[-1]

    def statuses(self) -> list[str]:
        return [one["status"] for one in self.connection.on("status")]


MakeBench = Callable[..., Bench]


def make_bench(monkeypatch: pytest.MonkeyPatch) -> MakeBench:
    for name in ("FLTEA_MQTT_USER", "FLTEA_MQTT_PASSWORD"):
        monkeypatch.delenv(name, raising=False)
    FakeConnection.made.clear()

    def new(*, up: bool = True, **settings: Any) -> Bench:
        one = Bench(**settings)
        monkeypatch.setattr(clock, "host_ns", lambda: one.now_ns)
        if up:
            one.write(hello())
            one.happens(Up())
        return one

    monkeypatch.setattr(mqtt, "Connection", FakeConnection)
    monkeypatch.setattr(status, "unix_offset_ns", lambda: 5)
    monkeypatch.setattr(mqtt, "FAREWELL_S", 0.02)
    return new
