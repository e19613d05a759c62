"""Tests of outputs behind their queues. An output that is too slow loses only its own records. It counts
them, and ends in order.
"""

import threading
from unittest.mock import Mock

import pytest
from fltea.process.wake_up import WakeUp
from fltea.records.events import Chunk
from fltea.records.ports import LATENCY_BOUNDS_MS, Latency, Printed, Sink, SinkClosed, Wanted
from fltea.records.records import AnyRecord, Error, Gap
from fltea.service.hub import Hub, Tap
from fltea.service.sink_queue import SinkQueue, SinkThread
from hypothesis import given
from hypothesis import strategies as st

from tests.rig.host_support import PATIENCE_S, closed, wait_until
from tests.rig.memory_sink import Memory


def gap(seq: int) -> Gap:
    return Gap(seq, 1, 1, 0, device="due")


class Wire(Memory):
    takes_wire = True


class Together(Memory):
    together = True


class Lossless(Memory):
    lossless = True


def started(sink: Sink) -> tuple[SinkQueue, list[Exception | None]]:
    found: list[Exception | None] = []
    sink_queue = SinkQueue(sink, lambda _, error: found.append(error))
    sink_queue.start()
    return sink_queue, found


def finish(sink_queue: SinkQueue) -> None:
    sink_queue.close()
    assert sink_queue.join(PATIENCE_S)


def test_everything_in_order_flushed_and_closed() -> None:
    sink = Memory()
    sink_queue, ended = started(sink)
    for k in range(0, 300, 3):
        sink_queue.put([gap(k), gap(k + 1), gap(k + 2)])
    finish(sink_queue)
    assert sink.items == [gap(k) for k in range(300)]
    assert sink.closed
    assert sink.flushes
    assert ended == []
    assert (sink_queue.stats().written, sink_queue.stats().dropped, sink_queue.stats().queued) == (300, 0, 0)


def test_a_slow_sink_loses_the_newest_and_is_told_where() -> None:
    sink = Memory(capacity=10).held()
    sink_queue, _ = started(sink)
    sink_queue.put([gap(0)])
    assert sink.entered.wait(PATIENCE_S)
    sink_queue.put([gap(k) for k in range(1, 31)])
    assert (sink_queue.stats().dropped, sink_queue.stats().queued) == (20, 11)
    sink.go.set()
    finish(sink_queue)
    assert sink.items == [gap(k) for k in range(11)]
    # the loss is reported after 11 records: one that was being written, and ten that filled the queue
    assert sink.overflows == [(11, 20)]
    assert sink_queue.stats().written + sink_queue.stats().dropped == 31


def test_outlets_of_one_thread_share_what_may_wait(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fltea.service.sink_queue.MOST_WAITING", 20)
    sinks = [Memory(capacity=10).held() for _ in range(4)]
    thread = SinkThread("sinks")
    sink_queues = [SinkQueue(sink, lambda *_: None, thread) for sink in sinks]
    sink_queues[0].start()
    sink_queues[0].put([gap(0)])
    assert sinks[0].entered.wait(PATIENCE_S)
    sink_queues[0].put([gap(k) for k in range(1, 16)])
    assert (sink_queues[0].stats().dropped, sink_queues[0].stats().queued) == (5, 11)
    for sink_queue in sink_queues[1:]:
        sink_queue.start()
        sink_queue.put([gap(k) for k in range(8)])
        sink_queue.close()
    assert [sink_queue.stats().dropped for sink_queue in sink_queues] == [5, 0, 2, 3]
    for sink in sinks:
        sink.go.set()
    sink_queues[0].close()
    assert all(sink_queue.join(PATIENCE_S) for sink_queue in sink_queues)
    assert [len(sink.items) for sink in sinks] == [11, 8, 6, 5]
    assert sinks[3].overflows == [(5, 3)]


def test_who_comes_faster_than_it_writes_may_wait_for_room() -> None:
    sink = Memory(capacity=10).held()
    hub = Hub(lambda error: None)
    hub.add(sink)
    hub.publish("due", [gap(0)])
    assert sink.entered.wait(PATIENCE_S)
    hub.publish("due", [gap(seq) for seq in range(1, 5)])
    assert hub.wait_for_room(0.0)
    hub.publish("due", [gap(5)])
    assert not hub.wait_for_room(0.01)
    sink.go.set()
    assert hub.wait_for_room(PATIENCE_S)
    assert closed(hub)
    assert len(sink.items) == 6


def test_a_patient_writer_loses_nothing() -> None:
    sink = Lossless(capacity=5)
    sink_queue, _ = started(sink)
    for k in range(500):
        sink_queue.put([gap(k)], wait=True)
    finish(sink_queue)
    assert sink.items == [gap(k) for k in range(500)]
    assert sink_queue.stats().dropped == 0


def test_nobody_waits_for_a_sink_that_may_lose_something() -> None:
    sink = Memory(capacity=5).held()
    sink_queue, _ = started(sink)
    sink_queue.put([gap(k) for k in range(20)], wait=True)
    sink.go.set()
    finish(sink_queue)
    assert sink_queue.stats().dropped == 20 - sink_queue.stats().written > 0


@pytest.mark.parametrize("wait", [False, True])
def test_the_wire_waits_as_its_source_does(wait: bool) -> None:
    sink_queue = Mock()
    Tap(lambda: [sink_queue], wait)(Chunk(b"abc", 5))
    assert sink_queue.put.call_args.kwargs == {"wait": wait}


@pytest.mark.parametrize("error", [SinkClosed(), OSError(28, "No space left"), ZeroDivisionError()])
def test_a_sink_that_ends_takes_nothing_more_and_counts_it(error: Exception) -> None:
    sink = Memory()
    sink.fail = lambda: error
    sink_queue, ended = started(sink)
    sink_queue.put([gap(0)])
    assert sink_queue.join(PATIENCE_S)
    sink_queue.put([gap(1), gap(2)], wait=True)
    assert ended == [None if isinstance(error, SinkClosed) else error]
    assert sink_queue.stats().dropped >= 2
    assert sink_queue.stats().written == 0


def test_what_was_in_hand_when_a_sink_broke_is_counted_too() -> None:
    """If an output fails, every record still counts exactly once: as written, dropped or waiting.

    Records that the output itself lost count as dropped.
    """
    sink = Memory().held()
    sink_queue, _ = started(sink)
    sink_queue.put([gap(0)])
    assert sink.entered.wait(PATIENCE_S)
    sink_queue.put([gap(k) for k in range(1, 10)])
    sink.go.set()
    wait_until(lambda: len(sink.items) == 10, "ten records")
    sink.lost = 2
    sink.entered.clear()
    sink.held()
    sink_queue.put([gap(k) for k in range(10, 30)])
    assert sink.entered.wait(PATIENCE_S)
    sink_queue.put([gap(k) for k in range(30, 35)])
    sink.lost = 7
    stats = sink_queue.stats()
    # records that the output lost later do not reduce the number of written records
    assert (stats.written, stats.dropped, stats.queued) == (8, 2, 25)
    sink.fail = ZeroDivisionError
    sink.go.set()
    assert sink_queue.join(PATIENCE_S)
    stats = sink_queue.stats()
    assert (stats.written, stats.dropped, stats.queued) == (8, 27, 0)


@given(st.lists(st.tuples(st.floats(0, 5000), st.integers(1, 5))))
def test_latency_counts_every_record_in_its_class(values: list[tuple[float, int]]) -> None:
    latency = Latency()
    for ms, weight in values:
        latency.add(ms, weight)
    assert sum(latency.counts) == sum(weight for _, weight in values)
    for k, bound in enumerate(LATENCY_BOUNDS_MS):
        assert sum(latency.counts[: k + 1]) == sum(weight for ms, weight in values if ms <= bound)


# --- the hub, which gives each record to all outputs ---


def hub() -> tuple[Hub, list[Exception | None]]:
    stops: list[Exception | None] = []
    return Hub(stops.append), stops


def errors(sink: Memory) -> list[tuple[str, str | None]]:
    return [(item.kind, item.device) for item in sink.items if isinstance(item, Error)]


def test_each_output_gets_what_concerns_it() -> None:
    all_outputs, _ = hub()
    shared, left, right, log = Memory("stdout"), Memory("mqtt"), Memory("mqtt"), Memory("log")
    all_outputs.add(shared)
    all_outputs.add(left, "left")
    all_outputs.add(right, "right")
    all_outputs.add_log(log)
    trouble: list[AnyRecord] = [gap(1), Error("silent", "text", 1, device="left")]
    all_outputs.publish("left", trouble)
    all_outputs.publish("right", [gap(2)])
    all_outputs.publish("right", [Error("last", "told at the end", 1)], log=False)
    assert closed(all_outputs)
    assert sorted(map(str, shared.items)) == sorted(map(str, left.items + right.items))
    assert left.items == trouble
    assert log.items == trouble[1:]
    assert all_outputs.stats("left").keys() == {"stdout", "mqtt"}
    assert all_outputs.stats("left")["mqtt"].written == 2
    assert [device for device, _ in all_outputs.sink_queues()] == [None, "left", "right"]


def test_outputs_that_print_the_same_are_given_the_same_lines() -> None:
    all_outputs, _ = hub()
    some, others = Wanted(samples=True), Wanted(estimates=True)
    shared, left, right, plain = (Memory(name) for name in ("stdout", "left", "right", "plain"))
    shared.prints = left.prints = some
    right.prints = others
    sink_queues = [all_outputs.add(shared), all_outputs.add(left, "left")]
    all_outputs.add(right, "right")
    all_outputs.add(plain)
    assert all_outputs.printing("left") == {some: sink_queues}
    assert all_outputs.printing("right").keys() == {some, others}
    assert all_outputs.printing("other") == {some: sink_queues[:1]}
    printed: list[AnyRecord | Printed] = [gap(1), Printed(b"lines", 8)]
    all_outputs.publish("left", [gap(1)], printed={some: printed})
    all_outputs.publish("right", [gap(2)], printed={some: printed})
    assert closed(all_outputs)
    assert left.items == printed
    assert shared.items == printed * 2
    assert right.items == [gap(2)], "of its text nothing was printed"
    assert plain.items == [gap(1), gap(2)]
    assert all_outputs.stats("left")["left"].written == 9


def test_a_bell_rings_until_it_is_cleared() -> None:
    wake_up = WakeUp()
    assert not wake_up.wait(0)
    threading.Thread(target=wake_up.ring).start()
    assert wake_up.wait(PATIENCE_S)
    assert wake_up.wait(0)
    wake_up.clear()
    assert not wake_up.wait(0.001)


def test_one_held_output_holds_up_no_other() -> None:
    all_outputs, _ = hub()
    slow, quick = Memory("slow", capacity=3).held(), Memory("quick")
    all_outputs.add(slow)
    all_outputs.add(quick)
    for k in range(100):
        # `wait` has no effect here: it concerns only lossless outputs, and neither output is lossless
        all_outputs.publish("due", [gap(k)], wait=True)
    all_outputs._shared[1].close()
    assert all_outputs._shared[1].join(PATIENCE_S)
    assert len(quick.items) == 100
    assert [one.name for one in all_outputs.close() if not one.done(0.2)] == ["slow"]
    slow.go.set()
    assert closed(all_outputs)
    stats = all_outputs.stats("due")["slow"]
    assert stats.written + stats.dropped == 100
    # at most six records were not dropped: three were being written, three were in the queue
    assert stats.dropped >= 94


def test_who_waits_for_room_is_let_go_at_the_end() -> None:
    all_outputs, _ = hub()
    held = Lossless("stdout", capacity=1).held()
    all_outputs.add(held)
    replay = threading.Thread(
        target=all_outputs.publish, args=("due", [gap(k) for k in range(5)]), kwargs={"wait": True}
    )
    replay.start()
    assert held.entered.wait(PATIENCE_S)
    all_outputs.release()
    replay.join(PATIENCE_S)
    assert not replay.is_alive()
    held.go.set()
    assert closed(all_outputs)
    stats = all_outputs.stats("due")["stdout"]
    assert stats.written + stats.dropped == 5


def test_a_report_reaches_every_output_of_the_device_and_the_log() -> None:
    all_outputs, _ = hub()
    shared, left, right, log = Memory("stdout"), Memory("record"), Memory("record"), Memory("log")
    all_outputs.add(shared)
    all_outputs.add(left, "left")
    all_outputs.add(right, "right")
    all_outputs.add_log(log)
    all_outputs.report("left")("disk_full", "no room")
    all_outputs.report()("state_failed", "no")
    assert closed(all_outputs)
    both = [("disk_full", "left"), ("state_failed", None)]
    assert (errors(shared), errors(left), errors(log)) == (both, both, both)
    assert errors(right) == [("state_failed", None)]


@pytest.mark.parametrize("error", [SinkClosed(), OSError(28, "No space left")])
def test_the_only_output_ends_the_program_and_one_among_others_does_not(error: Exception) -> None:
    for others in (0, 1):
        all_outputs, stops = hub()
        failing, other = Memory("stdout"), Memory("mqtt")
        failing.fail = lambda: error
        all_outputs.add(failing)
        if others:
            all_outputs.add(other, "due")
        all_outputs.publish("due", [gap(1)])
        assert all_outputs._shared[0].join(PATIENCE_S)
        assert closed(all_outputs)
        expected = None if isinstance(error, SinkClosed) else error
        assert stops == ([] if others else [expected])
        assert errors(other) == ([("output_lost", None)] if others else [])
        why = "(its reader left)" if expected is None else "(OSError: [Errno 28] No space left)"
        assert all(why in item.message for item in other.items if isinstance(item, Error))


def test_the_wire_goes_only_to_those_who_take_it() -> None:
    all_outputs, _ = hub()
    record = Wire("record")
    all_outputs.add(record, "left")
    all_outputs.add(Memory("mqtt"), "right")
    assert not all_outputs.tap("right", wait=False).wanted
    tap = all_outputs.tap("left", wait=False)
    assert tap.wanted
    tap(Chunk(b"abc", 5))
    all_outputs.publish("left", [gap(1)])
    assert closed(all_outputs)
    assert record.items == [Chunk(b"abc", 5), gap(1)]


def test_when_the_last_output_goes_after_stdout_the_program_stops() -> None:
    all_outputs, stops = hub()
    first, last = Memory("stdout"), Memory("record")
    all_outputs.add(first)
    all_outputs.add(last, "due")
    first.fail = SinkClosed
    all_outputs.publish("due", [gap(1)])
    assert all_outputs._shared[0].join(PATIENCE_S)
    assert stops == []
    last.fail = lambda: OSError(5, "gone")
    all_outputs.publish("due", [gap(2)])
    assert all_outputs._of["due"][0].join(PATIENCE_S)
    assert [type(stop) for stop in stops] == [OSError]
