"""Tests of the program behind `fltea fleet` with an MQTT broker that stops and comes back."""

import json
import re
import threading
from collections.abc import Iterator
from typing import Any

import pytest
from fltea.fleet import program
from fltea.fleet.program import Fleet, Plan
from fltea.settings.mqtt import MqttConfig

HELLO = b'{"rate_hz":100.0}'
FIT = b'{"seq":1,"epoch":1,"samples":1,"axes":{"gyro_x":{"verdict":"white","text":"","unit":"deg/s"}}}'
ONLINE = b'{"status":"online"}'
OFFLINE = b'{"status":"offline","reason":"connection_lost"}'


class Broker:
    """A simulated broker, which takes the place of the fleet's class `Listener`.

    `published`: topic and content of each message that the fleet published.
    """

    def __init__(self, *_: object) -> None:
        self.is_up = threading.Event()
        self.connections = self.outages = 0
        self.published: list[tuple[str, Any]] = []
        self.asked: list[str] = []

    def come(self) -> None:
        self.connections += 1
        self.is_up.set()

    def publish(self, topic: str, payload: bytes, *, retain: bool) -> None:
        assert self.is_up.is_set()
        self.published.append((topic, json.loads(payload)))

    def fetch(self, device_ids: list[str]) -> None:
        self.asked += device_ids

    def close(self) -> None:
        pass


class Stage:
    """A fleet with a simulated broker, and a clock that the test advances.

    `said`: the lines of text that the fleet wrote to its log.
    """

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(program, "Listener", Broker)
        self.said: list[str] = []
        self.fleet = Fleet(Plan(MqttConfig(broker="x"), compare_every_s=1.0), self.said.append)
        assert isinstance(self.fleet.listener, Broker)
        self.broker = self.fleet.listener
        self.now = 0.0
        monkeypatch.setattr(self.fleet.clock, "steady", lambda: self.now)
        self.fleet.clock._deaf_since = 0.0

    def wait(self, seconds: int) -> None:
        for _ in range(seconds):
            self.now += 1.0
            self.fleet.turn()

    def kinds(self) -> list[tuple[str, str]]:
        """Return, for each published message, the state and kind of its alert. For a list of alerts, return
        the number of alerts instead.
        """
        return [
            (content["state"], content["kind"]) if topic == "fleet/alert" else ("list", content["count"])
            for topic, content in self.broker.published
        ]


@pytest.fixture
def stage(monkeypatch: pytest.MonkeyPatch) -> Iterator[Stage]:
    """Return a fleet whose broker has been connected once."""
    made = Stage(monkeypatch)
    made.broker.come()
    made.fleet.turn()
    yield made
    made.fleet.close()


def test_an_outage_of_the_broker_makes_nobody_silent(stage: Stage) -> None:
    for payload, kind in ((HELLO, "hello"), (ONLINE, "status")):
        stage.fleet.take(f"fltea/a/{kind}", payload)
    stage.wait(30)
    stage.broker.is_up.clear()
    stage.wait(3600)
    assert stage.fleet.summary()["states"] == {"online": 1}
    stage.broker.come()
    stage.wait(50)
    assert stage.kinds() == [("list", 0), ("list", 0)]
    stage.wait(60)
    assert stage.kinds()[2:] == [("list", 1), ("raised", "silent")]


def test_what_the_broker_took_meanwhile_is_asked_for(stage: Stage) -> None:
    """The broker retains the newest fit of each sensor.

    When the broker is back, the fleet requests the retained fits. Otherwise it would have to wait until the
    sensors send new fits.
    """
    for payload, kind in ((HELLO, "hello"), (ONLINE, "status"), (FIT, "fit")):
        stage.fleet.take(f"fltea/a/{kind}", payload)
    stage.wait(100)
    assert stage.broker.asked == ["a"]
    stage.broker.is_up.clear()
    stage.wait(100)
    stage.broker.come()
    stage.wait(100)
    assert stage.broker.asked == ["a", "a"]


def test_alerts_wait_for_the_broker_and_none_ends_that_never_began(stage: Stage) -> None:
    stage.fleet.take("fltea/a/hello", HELLO)
    stage.fleet.take("fltea/a/status", OFFLINE)
    stage.broker.is_up.clear()
    stage.wait(10)
    stage.fleet.take("fltea/a/status", ONLINE)
    stage.wait(10)
    assert stage.kinds() == [("list", 0)]
    stage.broker.come()
    stage.wait(1)
    assert stage.kinds()[1:] == [("list", 0), ("raised", "offline"), ("cleared", "offline")]


def test_what_made_up_names_leave_behind_is_bounded(stage: Stage) -> None:
    stage.fleet.roll.most = 50
    for number in range(500):
        stage.fleet.take(f"fltea/{number}/status", ONLINE)
        stage.wait(1)
    assert len(stage.fleet.roll.candidates) <= 50
    assert len(stage.fleet._requests) <= 51
    assert stage.fleet.summary()["sensors"] == 0


def test_a_history_that_cannot_be_written_is_told_once_and_its_end_too(stage: Stage) -> None:
    database: Any = stage.fleet.history._database
    database.connection.execute("PRAGMA query_only = 1")
    stage.fleet.take("fltea/a/hello", HELLO)
    stage.fleet.take("fltea/a/status", OFFLINE)
    for _ in range(10):
        stage.wait(1)
        stage.fleet.history.settle()
    database.connection.execute("PRAGMA query_only = 0")
    for _ in range(3):
        stage.wait(1)
        stage.fleet.history.settle()
    assert [line.partition(":")[0] for line in stage.said] == ["history_lost", "history_back"]
    # At this time, the row of OFFLINE may or may not have been written by the writing thread.
    assert re.search(r"Rows that wait: [01]; lost: 0\.$", stage.said[0])
    assert stage.fleet.history.alerts().result()[0]["kind"] == "offline"


def test_the_end_says_how_many_rows_it_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    stage = Stage(monkeypatch)
    stage.fleet.history.lost = 2
    database: Any = stage.fleet.history._database
    database.connection.execute("PRAGMA query_only = 1")
    stage.fleet.history.add_alert(0.0, "raised", "offline", "a", "a: went offline.")
    stage.fleet.close()
    assert stage.said[-1].endswith("Rows that waited and are lost: 1.")


def test_the_summary_says_how_long_a_look_takes(stage: Stage, monkeypatch: pytest.MonkeyPatch) -> None:
    times_s = iter([10.0, 10.25])
    with monkeypatch.context() as clock:
        clock.setattr(program.time, "perf_counter", lambda: next(times_s))
        stage.fleet.look_now()
    assert stage.fleet.summary()["comparison_ms"] == 250.0
