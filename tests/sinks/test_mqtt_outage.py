"""Tests of the output to MQTT while no broker answers: which messages wait or are lost, and when the output
tries to connect again.
"""

import pytest
from fltea.mqtt.connection import Down, Up
from fltea.sinks.mqtt import delivery
from fltea.sinks.mqtt.delivery import BACKLOG, IN_FLIGHT
from hypothesis import given
from hypothesis import strategies as st

from tests.rig.host_support import hello
from tests.rig.mqtt_support import FakeConnection, MakeBench, estimate, gap, make_bench, sample, stats


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> MakeBench:
    return make_bench(monkeypatch)


# --- what waits, and what is lost ---


def test_what_comes_while_the_first_connection_is_made_is_not_lost(bench: MakeBench) -> None:
    b = bench(up=False, estimate_every=1)
    b.write(hello(), *map(estimate, range(BACKLOG + 5)))
    assert b.sink.lost == 5
    b.happens(Up())
    assert [one["seq"] for one in b.connection.on("estimate")] == list(range(BACKLOG))
    assert {qos for topic, _, qos, _ in b.connection.sent if topic.endswith("estimate")} == {0}


def test_outage_loses_streams_and_keeps_what_is_rare(bench: MakeBench) -> None:
    b = bench(estimate_every=1)
    b.happens(Down("broker_lost", "gone"))
    b.write(*map(estimate, range(20)), stats(), *map(gap, range(BACKLOG + 2)))
    assert b.sink.lost == 23
    b.wait(0.6)
    b.happens(Up())
    assert [one["seq"] for one in b.connection.on("gap")] == list(range(2, BACKLOG + 2))
    assert b.connection.on("estimate") == []
    assert b.told[0] == ("broker_lost", "gone")
    assert b.told[1][0] == "broker_back"
    assert "after 0.6 s" in b.told[1][1]
    assert "23 records were lost" in b.told[1][1]


def test_each_outage_states_its_own_losses(bench: MakeBench) -> None:
    b = bench(estimate_every=1)
    for records in (3, 2, 0):
        b.happens(Down("broker_lost", "gone"))
        b.write(*map(estimate, range(records)))
        b.wait(31)
        b.happens(Up())
        b.connection.acknowledge()
    ends = [text for kind, text in b.told if kind == "broker_back"]
    assert [text.split("; ")[1] for text in ends] == [
        "3 records were lost.",
        "2 records were lost.",
        "nothing was lost.",
    ]


def test_without_an_acknowledgement_after_it_a_stream_counts_as_lost(bench: MakeBench) -> None:
    b = bench(estimate_every=1)
    b.write(*map(estimate, range(7)), stats(), *map(estimate, range(7, 10)))
    b.connection.acknowledge("fltea/a0/stats")
    b.happens(Down("broker_lost", "gone"))
    assert b.sink.lost == 3


def test_what_is_not_acknowledged_is_sent_again_but_no_old_status(bench: MakeBench) -> None:
    b = bench(estimate_every=1, stream_qos=1)
    b.write(sample(), gap(1), estimate(2), stats())
    b.happens(Down("broker_lost", "gone"))
    assert b.sink.lost == 1
    b.wait(3)
    b.happens(Up())
    kinds = [topic.rpartition("/")[2] for topic, *_ in b.connection.sent]
    assert kinds == ["gap", "estimate", "hello", "status"], "the state once, as it is now"
    assert b.statuses() == ["stalled"]
    b.connection.acknowledge()
    b.happens(Down("broker_lost", "gone"))
    assert b.sink.lost == 1


def test_slow_network_loses_streams_and_holds_back_what_is_rare(bench: MakeBench) -> None:
    b = bench(estimate_every=1)
    b.connection.acknowledge()
    b.write(*map(estimate, range(IN_FLIGHT + 4)), gap(), stats())
    assert b.sink.lost == 5
    assert b.connection.on("gap") == []
    assert len(b.connection.on("estimate")) == IN_FLIGHT
    b.happens(Down("broker_lost", "gone"))
    assert b.sink.lost == 5 + IN_FLIGHT
    b.wait(1)
    b.happens(Up())
    assert len(b.connection.on("gap")) == 1
    # the error does not count the five records that were lost before this outage
    assert f"; {IN_FLIGHT} records were lost" in b.told[-1][1]


def test_socket_that_has_just_died_loses_streams_only(bench: MakeBench) -> None:
    b = bench(estimate_every=1)
    b.connection.acknowledge()
    b.connection.full = True
    b.write(estimate(0), gap())
    assert b.sink.lost == 1
    b.happens(Down("broker_lost", "gone"))
    b.wait(1)
    b.happens(Up())
    assert len(b.connection.on("gap")) == 1


@pytest.mark.parametrize("introduced", [True, False])
def test_end_without_a_broker_or_a_hello_counts_what_waited(bench: MakeBench, introduced: bool) -> None:
    b = bench(up=introduced)
    if introduced:
        b.connection.acknowledge()
        b.happens(Down("broker_lost", "gone"))
    b.write(gap(), gap())
    b.sink.close()
    assert b.sink.lost == 2


def test_refused_record_is_lost_and_told_once(bench: MakeBench) -> None:
    b = bench()
    b.connection.acknowledge()
    b.write(gap(), gap())
    b.connection.acknowledge("fltea/a0/gap", refusal="Not authorized")
    b.happens()
    assert b.sink.lost == 2
    assert [kind for kind, _ in b.told] == ["broker_refused"]
    assert "fltea/a0/#" in b.told[0][1]


OUTAGES = st.lists(
    st.sampled_from(["estimate", "gap", "stats", "up", "down", "acknowledge", "wait", "full"]), max_size=60
)


@given(OUTAGES, st.sampled_from([0, 1]))
def test_every_record_is_acknowledged_waiting_or_lost(steps: list[str], qos: int) -> None:
    """Whatever the broker does, every record is counted as acknowledged, waiting or lost.

    Only a record of which the acknowledgement is uncertain may be counted twice.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(delivery, "IN_FLIGHT", 6)
        patch.setattr(delivery, "BACKLOG", 4)
        b = make_bench(patch)(up=False, estimate_every=1, stream_qos=qos)
        b.write(hello())
        written = acknowledged = 0
        done: set[tuple[int, int]] = set()
        for step in steps:
            match step:
                case "estimate" | "gap" | "stats":
                    written += 1
                    b.write({"estimate": estimate(1), "gap": gap(), "stats": stats()}[step])
                case "up" if b.sink._link._connection is not None and not b.sink._link.up:
                    b.happens(Up())
                case "down" if b.sink._link._connection is not None:
                    b.happens(Down("broker_lost", "gone"))
                case "acknowledge" if b.sink._link.up:
                    c = b.connection
                    for mid, (*_, retain) in enumerate(c.sent, 1):
                        acknowledged += (id(c), mid) not in done and not retain
                        done.add((id(c), mid))
                    c.acknowledge()
                    last = [q for _, _, q, _ in c.sent]
                    # It is unknown whether messages of QoS 0 after the last message of QoS 1 arrived. Only
                    # the acknowledgement of a later message would prove it.
                    unsure = last[::-1].index(1) if 1 in last else len(last)
                    acknowledged -= unsure
                    done -= {(id(c), mid) for mid in range(len(last) - unsure + 1, len(last) + 1)}
                    b.happens()
                case "wait":
                    b.wait(40)
                case "full":
                    b.connection.full = not b.connection.full
            # at most IN_FLIGHT = 6 messages wait for an acknowledgement, besides the two retained state
            # messages, which are always sent
            assert len(b.sink._delivery._flight) <= 6 + 2
            assert len(b.sink._delivery._waiting) <= 4
            states = sum(m.retain for m in b.sink._delivery._flight.messages)
            waiting = len(b.sink._delivery._waiting) + len(b.sink._delivery._flight) - states
            assert acknowledged + waiting + b.sink.lost == written


# --- trying again ---


def test_backoff_grows_and_begins_anew_after_a_good_connection(bench: MakeBench) -> None:
    b = bench(up=False)
    b.write(hello())
    waits = []
    for _ in range(8):
        made = len(FakeConnection.made)
        b.happens(Down("broker_lost", "gone"))
        waited = 0.0
        while len(FakeConnection.made) == made:
            b.wait(0.5)
            waited += 0.5
        waits.append(waited)
    assert waits == [0.5, 1.0, 2.0, 5.0, 10.0, 30.0, 30.0, 30.0]
    b.happens(Up())
    b.wait(1)
    # a connection lost right after it was made counts as a failed attempt
    b.happens(Down("broker_lost", "gone"))
    b.wait(29)
    made = len(FakeConnection.made)
    b.wait(1)
    assert len(FakeConnection.made) == made + 1
    b.happens(Up())
    b.wait(11)
    b.happens(Down("broker_lost", "gone"))
    b.wait(0.5)
    assert len(FakeConnection.made) == made + 2


def test_one_outage_is_told_once_for_each_cause(bench: MakeBench) -> None:
    b = bench()
    for kind in ("broker_lost", "broker_lost", "broker_refused", "broker_lost", "broker_refused"):
        b.happens(Down(kind, "text"))
        b.wait(31)
    b.happens(Up())
    assert [kind for kind, _ in b.told] == ["broker_lost", "broker_refused", "broker_back"]
    b.happens(Down("broker_lost", "text"))
    assert [kind for kind, _ in b.told][3:] == ["broker_lost"]


def test_connection_that_comes_to_nothing_is_given_up(bench: MakeBench) -> None:
    b = bench(up=False)
    b.write(hello())
    first = b.connection
    b.wait(44)
    assert not first.closed
    b.wait(2)
    assert first.closed
    assert [kind for kind, _ in b.told] == ["broker_lost"]
    b.wait(1)
    assert b.connection is not first
