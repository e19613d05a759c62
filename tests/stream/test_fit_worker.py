"""Fits run in another thread. A fit takes effect at a sample that was chosen when the fit began, however long
the fit takes.
"""

import itertools
import threading
import time
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any, TypeVar

import pytest
from fltea.estimator.offset_walk import Followed
from fltea.estimator.tracker import Remembered, TrackerModel
from fltea.records.events import LinkDown
from fltea.records.records import Estimate, Fit
from fltea.stream import fit_times, live, tracked_models
from fltea.stream.fit_worker import FitThread, FitWorker
from hypothesis import example, given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from tests.rig.blocks import cuts, in_blocks, ndjson, of, records_of
from tests.rig.device_stream_support import raw, run_pipeline
from tests.rig.host_support import hello
from tests.rig.quick_fit import QuickAxes
from tests.rig.tiers import long

T = TypeVar("T")


class Noticing(QuickAxes):
    """A tracker that reports a step every 17 seconds."""

    @property
    def noticed(self) -> int:
        return self.samples // 1700

    @noticed.setter
    def noticed(self, count: int) -> None: ...


class Unhurried(FitWorker):
    """A fit worker that pauses before each fit, for a different time before each. `fault`: exception that the
    fits then raise, or None.
    """

    def __init__(self, pauses_s: Iterable[float], fault: Exception | None = None) -> None:
        super().__init__()
        self._thread, self._pauses_s, self._fault = FitThread(), itertools.cycle(pauses_s), fault

    def begin(self, work: Callable[[], T]) -> Callable[[], T]:
        pause_s = next(self._pauses_s)

        def slowly() -> T:
            time.sleep(pause_s)
            if self._fault is not None:
                raise self._fault
            return work()

        return self._thread.begin(slowly)

    def close(self) -> bool:
        return self._thread.close(None)


PAUSES_S = st.lists(st.sampled_from([0.0, 1e-4, 2e-3]), min_size=1, max_size=5)


@pytest.mark.slow
@given(cuts(1300), st.sets(st.integers(1, 1298), max_size=5), PAUSES_S)
@settings(max_examples=6)
def test_fits_count_from_the_same_sample_however_long_they_take_and_the_blocks_are_cut(
    places: list[int], lost: set[int], pauses_s: list[float]
) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(live, "LiveAxes", Noticing)
        patch.setattr(tracked_models, "ENOUGH", 0)
        block = raw(k for k in range(1300) if k not in lost)
        items, pipeline = run_pipeline([hello(), block])
        whole = ndjson([*records_of(items), *pipeline.finish()])
        fit_worker = Unhurried(pauses_s)
        items, pipeline = run_pipeline([hello(), *in_blocks(block, places)], fit_worker=fit_worker)
        assert ndjson([*records_of(items), *pipeline.finish()]) == whole
        assert fit_worker.close()


def test_what_the_tracker_goes_by_is_made_with_the_looks_and_outlives_the_epoch(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made: list[object] = []
    of_parts = tracked_models.system_of

    def system_of(*args: Any, **options: Any) -> Followed:
        made.append(args)
        return of_parts(*args, **options)

    monkeypatch.setattr(live, "LiveAxes", Noticing)
    monkeypatch.setattr(tracked_models, "ENOUGH", 0)
    monkeypatch.setattr(tracked_models, "system_of", system_of)
    fit_worker = Unhurried([0.0])
    _, pipeline = run_pipeline([hello(), raw(range(700))], fit_worker=fit_worker)
    count = len(made)
    assert count
    for event in (LinkDown(1), hello(), raw(range(800, 810))):
        list(pipeline.feed(event))
    tracker = pipeline.stats().axes["gyro_x"].tracker
    assert tracker is not None
    assert tracker.model == "white + relaxation"
    assert fit_worker.close()
    assert len(made) == count


def test_what_is_remembered_is_filtered_with_the_looks_and_only_the_last_samples_in_the_walk(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    left, usual = list[tuple[int, str]](), live.REFILTERED
    refilter = TrackerModel.refilter

    def noted(self: TrackerModel, remembered: Remembered, to_come: int) -> None:
        left.append((to_come, threading.current_thread().name))
        refilter(self, remembered, to_come)

    monkeypatch.setattr(TrackerModel, "refilter", noted)
    monkeypatch.setattr(live, "LiveAxes", Noticing)
    monkeypatch.setattr(tracked_models, "ENOUGH", 0)

    def records(samples: int) -> list[bytes]:
        monkeypatch.setattr(live, "REFILTERED", samples)
        items, pipeline = run_pipeline(
            [hello(), raw(range(1300))], fit_worker=(fit_worker := Unhurried([0.0]))
        )
        assert fit_worker.close()
        return ndjson([*records_of(items), *pipeline.finish()])

    in_the_walk = records(0)
    assert not left
    for samples in (20, usual):
        assert records(samples) == in_the_walk
    assert {to_come for to_come, _ in left} >= {20}
    assert max(to_come for to_come, _ in left) <= usual
    assert {name for _, name in left} <= {"looks", threading.current_thread().name}


def test_a_fault_of_a_look_is_one_of_the_walk() -> None:
    fit_worker = Unhurried([0.0], KeyError("nothing of the kind"))
    with pytest.raises(KeyError, match="nothing of the kind"):
        run_pipeline([hello(), raw(range(200))], fit_worker=fit_worker)
    assert fit_worker.close()


def test_looks_of_two_devices_are_made_in_the_order_in_which_they_began() -> None:
    thread, order, gate, ended = FitThread(2), list[str](), threading.Event(), threading.Event()
    thread.begin(lambda: order.append(f"first {gate.wait()}"))
    for name in ("b", "a", "b"):
        thread.begin(partial(order.append, name))
    thread.begin(ended.set)
    assert not order
    gate.set()
    assert ended.wait(60)
    assert order == ["first True", "b", "a", "b"]
    assert thread.close(None)


def test_who_waits_for_what_nobody_has_begun_does_it_himself_and_nobody_again() -> None:
    thread, made = FitThread(), list[threading.Thread]()
    begins, gate, ended = threading.Event(), threading.Event(), threading.Event()
    thread.begin(lambda: begins.set() or gate.wait())
    second = thread.begin(lambda: made.append(threading.current_thread()) or 2)
    assert begins.wait(60)
    assert second() == second() == 2
    gate.set()
    thread.begin(ended.set)
    assert ended.wait(60)
    assert thread.close(None)
    assert made == [threading.current_thread()]
    assert thread.begin(lambda: 3)() == 3, "also after the end"


def test_two_devices_that_share_a_thread_say_what_each_says_alone() -> None:
    numbers = {"left": range(700), "right": range(90, 800)}
    alone = {k: run_pipeline([hello(), raw(seen)])[0] for k, seen in numbers.items()}
    fit_worker = Unhurried([2e-3, 0.0, 1e-4])
    each = {k: run_pipeline([hello()], fit_worker=fit_worker) for k in numbers}
    for begin in range(0, 800, 37):
        for k, seen in numbers.items():
            if part := seen[begin : begin + 37]:
                each[k][0].extend(each[k][1].feed(raw(part)))
    for k, (items, _) in each.items():
        assert ndjson(records_of(items)) == ndjson(records_of(alone[k]))
    assert fit_worker.close()


def test_at_the_end_what_was_not_begun_is_left_and_what_was_is_waited_for() -> None:
    thread, order = FitThread(), list[str]()
    begins, gate = threading.Event(), threading.Event()

    def first() -> None:
        begins.set()
        gate.wait()
        order.append("first")

    thread.begin(first)
    thread.begin(lambda: order.append("second"))
    assert begins.wait(60)
    assert not thread.close(0.0)
    gate.set()
    assert thread.close(None)
    assert order == ["first"]
    assert FitThread().close(None), "no thread, nothing to wait for"


def test_a_snapshot_in_the_middle_of_a_look_changes_nothing() -> None:
    def run(*, saves: bool) -> list[bytes]:
        items: list[object] = []
        fit_worker = Unhurried([2e-3])
        _, pipeline = run_pipeline([hello()], fit_worker=fit_worker)
        for begin in range(0, 400, 20):
            items += pipeline.feed(raw(range(begin, begin + 20)))
            if saves:
                assert pipeline.save() is not None or begin < 20
        assert fit_worker.close()
        return ndjson(items)

    assert run(saves=True) == run(saves=False)


def test_what_is_noticed_is_looked_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    usual, _ = run_pipeline([hello(), raw(range(1300))], live__period_s=5)
    assert [f.seq for f in of(Fit, usual)] == [499, 999]
    monkeypatch.setattr(fit_times, "REFIT_GROWTH", 1)
    monkeypatch.setattr(fit_times, "SEARCH_GROWTH", 1)
    usual, _ = run_pipeline([hello(), raw(range(1300))])
    assert [f.seq for f in of(Fit, usual)] == [99, 199, 399, 799]
    monkeypatch.setattr(Noticing, "noticed", property(lambda self: self.samples // 550, lambda *_: None))
    monkeypatch.setattr(live, "LiveAxes", Noticing)
    noticed, _ = run_pipeline([hello(), raw(range(1300))])
    assert [f.seq for f in of(Fit, noticed)] == [99, 199, 399, 599, 799, 1099]


def test_a_look_at_a_sensor_that_is_gone_is_not_told_and_one_at_the_same_counts_at_once() -> None:
    other = replace(hello(), boot_id=9, device_id="ff")
    items, _ = run_pipeline([hello(), raw(range(102)), LinkDown(1), other, raw(range(200, 350))])
    assert [(f.epoch, f.samples) for f in of(Fit, items)] == [(2, 100)]
    items, _ = run_pipeline([hello(), raw(range(102)), raw(range(200, 210))])
    assert [(f.epoch, f.samples) for f in of(Fit, items)] == [(1, 100)]


@pytest.mark.parametrize("examples", [4, long(25)])
def test_estimates_are_the_same_watched_or_not_whatever_is_lost(examples: int) -> None:
    """Fits that no output shows are not made. This changes no estimate, even if samples are lost."""

    @given(st.lists(st.tuples(st.integers(1, 12), st.integers(0, 20), st.integers(0, 39)), max_size=8))
    @settings(max_examples=examples)
    @example([(1, 0, 39), (2, 0, 39), (4, 0, 39), (7, 0, 39)])
    def holds(lost: list[tuple[int, int, int]]) -> None:
        gone = {k for at, before, after in lost for k in range(100 * at - before, 100 * at + after)}
        block = raw(k for k in range(1300) if k not in gone)
        details, full, unseen = (
            run_pipeline([hello(), block], prompt=prompt, watched=watched)[0]
            for prompt, watched in ((True, True), (False, True), (False, False))
        )
        assert ndjson(records_of(details)) == ndjson(records_of(full))
        assert of(Estimate, records_of(details)) == of(Estimate, records_of(unseen))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(live, "LiveAxes", Noticing)
        # the tracker uses fits soon and often: after 1, 2, 3, 5, 8 and 12 s
        patch.setattr(fit_times, "SEARCH_GROWTH", 2)
        holds()
