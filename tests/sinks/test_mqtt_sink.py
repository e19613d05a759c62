"""Tests of the output to MQTT without a real broker: topics, payloads, and the status of the device."""

import json

import pytest
from fltea.mqtt.connection import Down, Up
from fltea.records import identities
from fltea.records.records import Epoch, Error, Estimate, EstimatorInfo, Fit, Sample
from fltea.sinks.mqtt import delivery
from fltea.sinks.mqtt import sink as mqtt
from fltea.sinks.mqtt.delivery import BACKLOG
from fltea.sinks.mqtt.sink import LONGEST_NAME, device_level
from fltea.sinks.record_json import record_json
from hypothesis import given
from hypothesis import strategies as st

from tests.rig.example_records import MOVES, STEP
from tests.rig.fit_support import FRACTIONAL
from tests.rig.host_support import hello
from tests.rig.mqtt_support import FakeConnection, MakeBench, estimate, gap, make_bench, sample, stats

INFO = EstimatorInfo("joint", "host", "compressed", "consistent", 3000, 500, (), ())


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> MakeBench:
    return make_bench(monkeypatch)


# --- what is published, and where ---


def test_every_kind_has_a_topic_a_quality_and_the_line_of_ndjson(bench: MakeBench) -> None:
    b = bench(estimate_every=1, sample_every=1)
    records = [
        Epoch(1, "start", 0, 0, 0, 7, INFO, device="due"),
        sample(),
        estimate(0),
        fit(),
        gap(),
        STEP,
        MOVES,
        stats(),
        Error("silent", "nothing came", 1, device="due"),
    ]
    b.write(*records)
    sent = {topic: (payload, qos, retain) for topic, payload, qos, retain in b.connection.sent}
    assert set(sent) == {
        f"fltea/a0/{kind}"
        for kind in (
            *("hello", "status", "epoch", "sample", "estimate", "fit"),
            *("gap", "step", "motion", "stats", "error"),
        )
    }
    for record in (hello(), *records):
        payload, qos, retain = sent[f"fltea/a0/{type(record).__name__.lower()}"]
        assert payload == record_json(record)
        assert qos == (0 if isinstance(record, Sample | Estimate) else 1)
        assert retain == (record == hello() or isinstance(record, Fit))
    assert sent["fltea/a0/status"][1:] == (1, True)


def fit(samples: int = 100) -> Fit:
    return Fit(samples - 1, 1, 0, 0, samples, {"gyro_x": FRACTIONAL}, device="due")


def test_the_newest_fit_is_said_again_after_an_outage_and_none_is_counted_as_lost(bench: MakeBench) -> None:
    b = bench()
    b.write(fit(100))
    b.happens(Down("broker_lost", "gone"))
    b.write(fit(200), fit(300))
    b.wait(1.0)
    b.happens(Up())
    assert [one["samples"] for one in b.connection.on("fit")] == [300]
    assert b.sink.lost == 0


def test_another_board_is_not_told_the_fit_of_the_one_before(bench: MakeBench) -> None:
    b = bench()
    b.write(fit(), hello(device_id="b1"))
    b.happens(Up())
    assert b.connection.on("fit", "b1") == []


def test_by_default_every_tenth_estimate_and_no_sample(bench: MakeBench) -> None:
    b = bench()
    b.write(*(record for seq in range(7, 51) for record in (sample(seq), estimate(seq))))
    assert [one["seq"] for one in b.connection.on("estimate")] == [10, 20, 30, 40, 50]
    assert b.connection.on("sample") == []
    assert b.sink.lost == 0


def test_samples_and_quality_on_request(bench: MakeBench) -> None:
    b = bench(sample_every=4, stream_qos=1, prefix="lab/3")
    b.write(*map(sample, range(9)))
    found = [(topic, qos) for topic, _, qos, _ in b.connection.sent if topic.endswith("sample")]
    assert found == [("lab/3/a0/sample", 1)] * 3


@given(st.text(min_size=1))
def test_topic_of_any_device_is_one_level_and_no_pattern(name: str) -> None:
    level = device_level(hello(device_id=name), "due")
    assert level
    assert not set("+#/\0\n") & set(level)
    assert len(level) == min(len(name), LONGEST_NAME)


def test_device_without_an_identifier_has_its_name(bench: MakeBench) -> None:
    b = bench(up=False)
    b.write(hello(device_id=None))
    assert b.connection.will[0] == "fltea/due/status"


def test_client_id_is_another_in_another_process(bench: MakeBench) -> None:
    bench()
    bench()
    ids = {connection.client_id for connection in FakeConnection.made}
    assert len(ids) == 2
    assert all(one.startswith("fltea-a0-") for one in ids)


# --- before the first HELLO ---


def test_what_is_rare_waits_for_the_first_hello_and_no_connection_is_made(bench: MakeBench) -> None:
    b = bench(up=False)
    b.write(*(Error("no_port", str(k), 1, device="due") for k in range(BACKLOG + 3)), stats())
    b.wait(100)
    assert FakeConnection.made == []
    assert b.sink.lost == 3
    b.write(hello())
    b.happens(Up())
    assert [one["message"] for one in b.connection.on("error")] == [str(k) for k in range(3, BACKLOG + 3)]


# --- the status ---


def test_status_follows_the_samples(bench: MakeBench) -> None:
    b = bench()
    assert b.statuses() == ["stalled"]
    b.write(sample())
    b.write(sample(), stats(), sample())
    assert b.statuses() == ["stalled", "online"]
    b.wait(1.9)
    assert b.statuses()[-1] == "online"
    b.wait(0.2)
    b.wait(1.0)
    assert b.statuses() == ["stalled", "online", "stalled"]
    b.write(sample())
    assert b.statuses()[-1] == "online"
    said = b.connection.on("status")[-1]
    assert said == {
        "status": "online",
        "since_ns": b.now_ns + 5,
        "source": "test:",
        "device_id": "a0",
        "device": "due",
        "reason": None,
    }


def test_status_is_said_again_with_the_time_since_when(bench: MakeBench) -> None:
    """The status is published again after each connection. The last will of an earlier connection may have
    replaced it.

    This happens if the broker notices late that the earlier connection was lost.
    """
    b = bench()
    b.wait(29)
    assert len(b.statuses()) == 1
    b.wait(2)
    first, again = b.connection.on("status")
    assert first == again


def test_will_and_farewell(bench: MakeBench) -> None:
    b = bench()
    topic, payload = b.connection.will
    will = json.loads(payload)
    assert topic == "fltea/a0/status"
    assert [will[name] for name in ("status", "reason", "since_ns")] == ["offline", "connection_lost", None]
    b.connection.acknowledge()
    b.sink.close()
    last = b.connection.on("status")[-1]
    assert (last["status"], last["reason"]) == ("offline", "ended")
    assert b.connection.closed
    assert b.sink.lost == 0


def test_farewell_waits_for_acknowledgements(bench: MakeBench, monkeypatch: pytest.MonkeyPatch) -> None:
    """The output closes its connection only after the acknowledgements. If it closed while the broker still
    answers, the broker might publish the last will after the final status.
    """
    b = bench()
    b.write(gap())
    naps: list[bool] = []

    def nap(seconds: float) -> None:
        naps.append(b.connection.closed)
        if len(naps) == 3:
            b.connection.acknowledge()

    monkeypatch.setattr(delivery.time, "sleep", nap)
    monkeypatch.setattr(mqtt, "FAREWELL_S", 60.0)
    b.sink.close()
    assert naps[:3] == [False] * 3
    assert b.connection.closed


def test_another_board_on_the_same_port(bench: MakeBench) -> None:
    b = bench()
    b.write(sample())
    first = b.connection
    b.write(hello(boot_id=8))
    assert len(first.on("hello")) == 2
    b.write(hello(device_id="b1"), gap())
    second = b.connection
    assert second is not first
    assert first.closed
    last = first.on("status")[-1]
    assert (last["status"], last["reason"]) == ("offline", "replaced")
    b.happens(Up())
    assert second.will[0] == "fltea/b1/status"
    assert second.client_id != first.client_id
    assert len(second.on("gap", "b1")) == 1
    assert second.on("status", "b1")[-1]["status"] == "stalled"


def test_another_board_while_the_broker_is_away(bench: MakeBench) -> None:
    b = bench()
    b.write(sample(), gap())
    b.happens(Down("broker_lost", "gone"))
    b.write(hello(device_id="b1"))
    b.happens(Up())
    assert b.connection.on("status")[-1]["reason"] == "replaced"
    assert len(b.connection.on("gap")) == 1
    assert b.connection.on("status", "b1")[-1]["status"] == "stalled"


# --- a board that states another name in every HELLO ---


def topics() -> set[str]:
    return {topic for connection in FakeConnection.made for topic, *_ in connection.sent}


def test_ever_new_names_get_few_topics_and_are_told_once(bench: MakeBench) -> None:
    """A board that states another name again and again gets few topics. Such a board once created 768
    retained topics on a broker in 8 s.
    """
    b = bench()
    for k in range(100):
        b.write(hello(device_id=f"n{k}"), sample(k))
        if not b.sink._turned_away:
            b.happens(Up())
        b.wait(0.01)
    devices = {topic.split("/")[1] for topic in topics()}
    assert devices == {"a0", "n0", "n1", "n2"}
    assert [kind for kind, _ in b.told] == ["too_many_devices"]
    assert len(FakeConnection.made) == identities.MOST
    assert FakeConnection.made[-1].closed
    last = [one for topic, one, *_ in FakeConnection.made[-1].sent if topic == "fltea/n2/status"][-1]
    assert (json.loads(last)["status"], json.loads(last)["reason"]) == ("offline", "replaced")


def test_what_a_device_without_topics_says_is_lost_and_counted(bench: MakeBench) -> None:
    b = bench(sample_every=2, estimate_every=10)
    for k in range(5):
        b.write(hello(device_id=f"n{k}"))
    before, sent = b.sink.lost, topics()
    b.write(*map(sample, range(10)), *map(estimate, range(1, 20)), gap(), stats())
    b.wait(100)
    assert b.sink.lost - before == 5 + 1 + 1 + 1
    assert topics() == sent
    b.sink.close()


def test_a_known_device_comes_back_and_a_new_one_after_an_hour(bench: MakeBench) -> None:
    b = bench()
    for k in range(5):
        b.write(hello(device_id=f"n{k}"))
    b.write(hello(device_id="n1"), gap(3))
    b.happens(Up())
    assert b.connection.will[0] == "fltea/n1/status"
    assert [one["seq"] for one in b.connection.on("gap", "n1")] == [3]
    b.wait(3601)
    b.write(hello(device_id="n9"), gap(4))
    b.happens(Up())
    assert [one["seq"] for one in b.connection.on("gap", "n9")] == [4]
