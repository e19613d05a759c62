"""Tests of an ingest whose outputs are too slow.

The messages then wait in the broker, and every message that the ingest accepted is counted.
"""

import threading
from pathlib import Path
from typing import Any

import pytest
from fltea.records.block import Block
from fltea.records.clock import host_ns
from fltea.records.records import Error, Stats
from fltea.service.hub import Hub
from fltea.service.ingest.inbox import Inbox
from fltea.service.ingest.loop import Ingest
from fltea.service.ingest.mqtt import MqttFrames
from fltea.settings.config import load_configs
from fltea.settings.mqtt import MqttConfig
from fltea.stream.fit_worker import FitWorker
from paho.mqtt.client import Client
from paho.mqtt.enums import CallbackAPIVersion

from tests.rig.blocks import of
from tests.rig.frames_messages import second_of
from tests.rig.host_support import PATIENCE_S, closed, wait_until
from tests.rig.memory_sink import Memory
from tools.faults.server import Broker

SECONDS, DEVICES = 120, ("a", "b")
"""Each of these devices sends this many seconds of samples. Together these are more records than fit into a
queue of 10,000.
"""


class Flood:
    """A receiver that puts all messages into the inbox, from a thread, as fast as the inbox has room."""

    url, partitions, connected = "mqtt://test", None, True

    def __init__(self, inbox: Inbox) -> None:
        self._inbox, self._stop, self.taken = inbox, threading.Event(), 0
        self._thread = threading.Thread(target=self._run)

    def start(self) -> None:
        self._thread.start()

    def close(self) -> None:
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        for second in range(SECONDS):
            for k, name in enumerate(DEVICES):
                while not self._inbox.wait_for_room(0.01):
                    if self._stop.is_set():
                        return
                self._inbox.put(name, second_of(k, second))
                self.taken += 1


class Scene:
    """An ingest in its own thread, with a queue for 1 MB of messages, and one output."""

    def __init__(self, *, queue_bytes: int, **set_: Any) -> None:
        flags = {"name": "w", "format": "none", "live.on": False, "estimator.window": 200, **set_}
        (config,) = load_configs(None, flags, [Flood.url])
        self.sink, self.hub = Memory("held").held(), Hub(lambda error: None)
        self.sink_queue = self.hub.add(self.sink)
        self.errors: list[Exception | None] = []
        self.ingest = Ingest(
            config, self.hub, lambda inbox, report: self._flood(inbox), self._on_end, FitWorker()
        )
        self.ingest.inbox.queue_bytes = queue_bytes
        self._thread = threading.Thread(target=self.ingest.run)
        self._thread.start()

    def _flood(self, inbox: Inbox) -> Flood:
        self.flood = Flood(inbox)
        return self.flood

    def _on_end(self, ingest: Ingest, error: Exception | None) -> None:
        self.errors.append(error)

    @property
    def samples(self) -> int:
        """Return the number of samples that the output has received."""
        return sum(map(len, of(Block, self.sink.items)))

    def is_held(self) -> bool:
        """Return whether neither the output's queue nor the inbox has room."""
        return not (self.hub.wait_for_room(0) or self.ingest.inbox.wait_for_room(0))

    def end(self) -> None:
        self.ingest.close()
        self._thread.join(PATIENCE_S)
        self.sink.go.set()
        assert closed(self.hub)
        assert self.errors == [None]


def counted(scene: Scene) -> int:
    """Return the number of samples that the output received, plus the number of samples that were left in the
    inbox at the end.
    """
    left = sum(scene.ingest.inbox.overflow_bytes.values())
    return scene.samples + 100 * left // len(second_of(0, 1))


def test_an_output_that_takes_nothing_for_long_holds_the_broker_and_loses_nothing() -> None:
    scene = Scene(queue_bytes=100_000)
    wait_until(scene.is_held, "that the flood is held")
    assert scene.flood.taken < SECONDS * len(DEVICES)
    scene.sink.go.set()
    wait_until(lambda: scene.samples == 100 * len(DEVICES) * SECONDS, "all samples")
    scene.end()
    assert scene.sink_queue.stats().dropped == 0
    assert scene.ingest.inbox.overflow_bytes == {}
    (stats, *_) = reversed(of(Stats, scene.sink.items))
    assert (stats.sample_counts.lost, stats.link.overflow_bytes) == (0, 0)


def test_what_is_left_at_the_end_is_counted_and_said() -> None:
    scene = Scene(queue_bytes=100_000)
    wait_until(scene.is_held, "that the flood is held")
    scene.end()
    assert counted(scene) + scene.sink_queue.stats().dropped == 100 * scene.flood.taken
    texts = [one.message for one in of(Error, scene.sink.items) if one.kind == "frames_overflow"]
    assert any("when the program ended" in text for text in texts)
    last = {one.device: one.link.overflow_bytes for one in of(Stats, scene.sink.items)}
    assert sum(last.values()) == sum(scene.ingest.inbox.overflow_bytes.values())


def test_an_output_that_holds_all_up_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fltea.service.ingest.loop.HELD_S", 0.1)
    scene = Scene(queue_bytes=100_000)
    wait_until(scene.is_held, "that the flood is held")
    scene.end()
    texts = [one.message for one in of(Error, scene.sink.items) if one.kind == "output_slow"]
    assert len(texts) == 1
    assert "held" in texts[0]


@pytest.mark.slow
def test_a_broker_holds_what_has_no_room_and_does_not_give_us_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fltea.mqtt.connection.KEEPALIVE_S", 2)
    broker = Broker(tmp_path, settings=("max_queued_messages 0",))
    inbox, troubles, count, size = Inbox(10, 100_000), list[str](), 4000, 2000
    frames = MqttFrames(
        MqttConfig(broker=broker.url), inbox, lambda kind, text: troubles.append(f"{kind}: {text}")
    )
    publisher = Client(CallbackAPIVersion.VERSION2)
    try:
        frames.start()
        wait_until(lambda: frames.connected, "the connection")
        publisher.max_inflight_messages_set(0)
        publisher.connect("127.0.0.1", broker.port)
        publisher.loop_start()
        for k in range(count):
            publisher.publish("fltea/a/frames", k.to_bytes(2, "big").ljust(size), qos=1)
        wait_until(lambda: not publisher._out_messages, "that the broker has all")
        wait_until(lambda: not inbox.wait_for_room(0), "that no more has room")
        # The ingest subscribes again and again as a sign of life. Without these signs, the broker would close
        # the connection after 1.5 keepalive periods, and the client library after two. The test waits longer.
        wait_until(lambda: broker.said().count("Received SUBSCRIBE") > 8, "signs of life")
        found: list[int] = []
        while len(found) < count:
            taken, _ = inbox.take(PATIENCE_S)
            assert sum(len(one.data) for one in taken) <= 100_000 + size
            found += [int.from_bytes(one.data[:2], "big") for one in taken]
        assert found == list(range(count))
        assert troubles == []
    finally:
        publisher.loop_stop()
        frames.close()
        broker.kill()


def test_what_is_turned_away_just_before_the_end_is_told_of() -> None:
    scene = Scene(queue_bytes=1_000_000)
    scene.sink.go.set()
    wait_until(lambda: scene.samples == 100 * len(DEVICES) * SECONDS, "all samples")
    # The time of the last periodic check is set to the future, so that no further check runs before the end.
    scene.ingest.hearing.checked_ns = host_ns() + 10**12
    scene.ingest.inbox.put("bad name<b>", second_of(0, 0))
    scene.end()
    assert [one.kind for one in of(Error, scene.sink.items)] == ["devices_refused"]
