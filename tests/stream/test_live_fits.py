"""The live fit in the pipeline: when a refit is due, which samples it uses, and after which interruptions the
record continues.
"""

import itertools
from collections.abc import Iterable

import pytest
from fltea.records.block import Block
from fltea.records.events import Break, Event, LinkDown
from fltea.records.records import Epoch, Error, Estimate, Fit, Hello, Stats
from fltea.spectrum.evidence import ANYTIME_LEVEL
from fltea.spectrum.live_axes import LiveAxes
from fltea.stream import live
from fltea.stream.fit_times import Refit, RefitTimes, turn
from fltea.stream.fit_worker import FitWorker
from fltea.stream.snapshot import DeviceState
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from tests.rig.blocks import cuts, in_blocks, ndjson, of, records_of
from tests.rig.device_stream_support import raw, run_pipeline
from tests.rig.estimating_board import Board, events, noise
from tests.rig.host_support import hello


def left_out(fit: Fit) -> int:
    return fit.axes["gyro_x"].left_out["lost"]


def test_a_fit_knows_all_until_the_last_sample_of_a_second_and_counts_half_a_second_later() -> None:
    items, _ = run_pipeline([hello(), raw(range(350))])
    assert [(f.seq, f.samples, f.device_us, f.host_ns) for f in of(Fit, items)] == [
        (k, k + 1, k * 10_000, k * 10_000_000) for k in (99, 199, 299)
    ]
    for place, item in enumerate(items):
        if isinstance(item, Fit):
            before = items[place - 1]
            assert isinstance(before, Block)
            assert before.seq[-1] == item.seq + 50
    assert list(of(Fit, items)[0].axes) == ["gyro_x", "gyro_y", "gyro_z"]
    assert of(Fit, items)[0].device == "due"


@pytest.mark.parametrize(("period_s", "seqs"), [(0.5, [49, 99, 149]), (1.2, [119])])
def test_the_period_is_a_setting(period_s: float, seqs: list[int]) -> None:
    items, pipeline = run_pipeline([hello(), raw(range(180))], live__period_s=period_s)
    assert [f.seq for f in of(Fit, items)] == seqs
    assert pipeline.stats().fit_period_s == period_s


def test_it_can_be_switched_off() -> None:
    items, pipeline = run_pipeline([hello(), raw(range(350))], live__on=False)
    assert not of(Fit, items)
    assert [type(item) for item in pipeline.finish()] == [Stats]
    assert pipeline.stats().fit_period_s is None


def test_fits_do_not_depend_on_how_many_samples_are_written() -> None:
    whole, _ = run_pipeline([hello(), raw(range(350))])
    thin, _ = run_pipeline([hello(), raw(range(350))], output__every=70)
    assert of(Fit, thin) == of(Fit, whole)


@pytest.mark.parametrize("who", ["device", "both"])
def test_the_axes_of_a_board_that_estimates_are_fitted_here(who: str) -> None:
    items, _ = run_pipeline(events(Board().run(noise(360))), estimator__estimate_on=who)
    assert [f.samples for f in of(Fit, items)] == [100, 200, 300]


def test_named_axes_of_both_sensors_are_fitted() -> None:
    items, _ = run_pipeline([hello(), raw(range(160))], channels=["gyro_z", "accel_x"])
    (fit,) = of(Fit, items)
    assert {axis: one.unit for axis, one in fit.axes.items()} == {"gyro_z": "deg/s", "accel_x": "m/s^2"}


def test_with_many_devices_the_default_period_is_longer() -> None:
    for devices, period_s, seqs in ((12, 1.0, [99, 199, 299]), (30, 2.5, [249])):
        items, pipeline = run_pipeline([hello(), raw(range(380))], fit_worker=FitWorker(devices))
        assert pipeline.stats().fit_period_s == period_s
        assert [f.seq for f in of(Fit, items)] == seqs
    items, _ = run_pipeline([hello(), raw(range(350))], fit_worker=FitWorker(50), live__period_s=1)
    assert [f.seq for f in of(Fit, items)] == [99, 199, 299]


def test_many_devices_have_turns_so_that_their_fits_do_not_come_together() -> None:
    found = []
    for number in range(6):
        items, _ = run_pipeline([hello(), raw(range(800))], fit_worker=FitWorker(24), number=number)
        seqs = [f.seq for f in of(Fit, items)]
        assert seqs[1] - seqs[0] == 200, "and each as often as before"
        found.append(seqs[0])
    assert found[0] == 199
    ends = [*sorted(found), found[0] + 200]
    assert min(b - a for a, b in itertools.pairwise(ends)) >= 18
    items, _ = run_pipeline([hello(), raw(range(350))], fit_worker=FitWorker(2), number=1)
    assert [f.seq for f in of(Fit, items)] == [99, 199, 299], "few need none"


@given(st.integers(13, 2000), st.integers(1, 5000))
def test_turns_are_spread_over_the_period(devices: int, period: int) -> None:
    turns = sorted(turn(FitWorker(devices), number, period) for number in range(devices))
    assert turns[0] == 0
    assert turns[-1] < period
    assert max(b - a for a, b in itertools.pairwise([*turns, period])) <= 3 * period / devices + 1


def refits_of(samples: int, *, every: bool, period: int = 100) -> list[tuple[int, Refit]]:
    times, found = RefitTimes(100.0, grows=True, every=every), []
    times.begin(period)
    while (number := times.due) <= samples:
        refit = times.at(number, number, period, noticed=False)
        assert refit is not None
        found.append((number, refit))
    return found


def test_looks_follow_the_growth_of_the_record() -> None:
    found = refits_of(2_000_000, every=True)
    numbers = [number for number, _ in found]
    assert numbers[:100] == list(range(100, 10_100, 100))
    assert all(100 <= b - a <= min(a / 100 + 100, 6000) for a, b in itertools.pairwise(numbers))
    assert 400 <= sum(number <= 360_000 for number in numbers) <= 500
    searches = [number for number, refit in found if refit.settles]
    assert all(a / 10 <= b - a <= a / 10 + 100 for a, b in itertools.pairwise(searches) if a > 1000)
    assert 65 <= sum(number <= 360_000 for number in searches) <= 72
    assert searches == [number for number, _ in refits_of(2_000_000, every=False)]


def test_curves_of_many_devices_come_every_fourth_period() -> None:
    drawn = [number for number, refit in refits_of(30_000, every=True, period=2500) if refit.curves]
    assert drawn == [2500, 12_500, 22_500]


@pytest.mark.slow
@given(
    st.sets(st.integers(1, 40_000), max_size=20),
    st.sets(st.integers(1, 40_000), max_size=20),
    st.integers(1, 150),
    st.integers(0, 100_000),
)
def test_the_fits_that_settle_are_the_same_whether_or_not_there_are_others(
    breaks: set[int], news: set[int], period: int, before: int
) -> None:
    """The fits that the filters use come at the same samples, whether or not further fits are made between
    them.

    After each number in `breaks`, 70 samples are lost. `before`: number of samples that the fitted record
    already has from before the last restart.
    """

    def accepted(*, every: bool) -> list[int]:
        times, found = RefitTimes(100.0, grows=True, every=every), []
        times.begin(period)
        taken, counts, noticed = before, 0, False
        for number in range(1, 40_001):
            if any(number - 70 <= at < number for at in breaks):
                continue
            taken += 1
            noticed = noticed or number in news
            if number < times.check:
                continue
            refit = times.at(number, taken, period, noticed=noticed, busy=number < counts)
            if refit is not None:
                assert refit.counts > number
                counts, noticed = refit.counts, False
                if refit.settles:
                    found.append(number)
        return found

    assert accepted(every=True) == accepted(every=False)


def test_something_that_is_noticed_is_looked_at_within_the_second() -> None:
    times = RefitTimes(100.0, grows=True, every=True)
    times.begin(100)
    while times.due < 50_000:
        times.at(times.due, times.due, 100, noticed=False)
    at = times.check
    assert at < times.due - 100
    assert times.at(at, at, 100, noticed=False) is None
    refit = times.at(at + 100, at + 100, 100, noticed=True)
    assert refit == Refit(settles=False, fresh=True, curves=False, counts=at + 150)


def test_curves_come_every_ten_seconds_and_with_the_last_fit() -> None:
    items, pipeline = run_pipeline([hello(), raw(range(1290))])
    drawn = [f.seq for f in of(Fit, items) if f.axes["gyro_x"].spectrum is not None]
    assert drawn == [99, 1099]
    last, stats = pipeline.finish()
    assert isinstance(last, Fit)
    assert isinstance(stats, Stats)
    assert (last.seq, last.samples) == (1289, 1290)
    assert last.axes["gyro_x"].spectrum is not None
    assert [type(item) for item in pipeline.finish()] == [Stats]


def test_a_last_fit_that_had_its_curves_is_not_said_twice() -> None:
    items, pipeline = run_pipeline([hello(), raw(range(100))])
    assert not of(Fit, items)  # the fit of these samples is yielded only 50 samples later
    assert [type(item) for item in pipeline.finish()] == [Fit, Stats]


def test_the_last_fit_of_a_recording_is_judged_as_one_look() -> None:
    """While a recording grows, each fit tests the noise again. So these fits use a stricter significance
    level, for repeated tests. The last fit uses the level for a single test. Therefore the last fit is
    published even if a fit of the same samples was just published at the stricter level.
    """
    items, pipeline = run_pipeline([hello(), raw(range(100))], prompt=False)
    before, last, _ = pipeline.finish()
    items.append(before)
    assert isinstance(last, Fit)
    assert last.axes["gyro_x"].text.endswith("at the end")
    assert [type(item) for item in pipeline.finish()] == [Stats]
    assert not any(fit.axes["gyro_x"].text.endswith("at the end") for fit in of(Fit, items))
    _, pipeline = run_pipeline([hello(), raw(range(150))])
    last, _ = pipeline.finish()
    assert isinstance(last, Fit)
    assert not last.axes["gyro_x"].text.endswith("at the end")


def test_without_a_sample_there_is_no_last_fit() -> None:
    _, pipeline = run_pipeline([hello()])
    assert [type(item) for item in pipeline.finish()] == [Stats]


def test_lost_samples_are_told_and_a_fit_that_was_due_among_them_comes_after_them() -> None:
    items, _ = run_pipeline([hello(), raw([*range(95), *range(105, 260)])])
    assert [(f.seq, f.samples, left_out(f)) for f in of(Fit, items)] == [(105, 96, 10), (199, 190, 10)]


def test_the_sums_go_on_over_a_long_gap_and_a_restart_of_the_same_sensor() -> None:
    again = replace(hello(), boot_id=9)
    items, _ = run_pipeline([hello(), raw(range(150)), raw(range(250, 400)), again, raw(range(400, 560))])
    epochs = of(Epoch, items)
    assert [e.reason for e in epochs] == ["start", "gap", "restart"]
    assert [(f.epoch, f.seq, f.samples, left_out(f)) for f in of(Fit, items)] == [
        (1, 99, 100, 0),
        (2, 349, 250, 100),
        (3, 499, 400, 100 + live.BREAK),
    ]


@pytest.mark.parametrize(
    "changes", [{"device_id": "ff"}, {"gyro_lsb_per_dps": 131.0}, {"gyro_dlpf_hz": 20.0}, {"who_am_i": 0x73}]
)
def test_another_sensor_begins_again(changes: dict[str, object]) -> None:
    other: Hello = replace(hello(), boot_id=9, **changes)
    items, _ = run_pipeline([hello(), raw(range(150)), LinkDown(1), other, raw(range(200, 360))])
    assert [(f.epoch, f.samples, left_out(f)) for f in of(Fit, items)] == [(1, 100, 0), (2, 100, 0)]


def test_a_break_in_a_recording_breaks_the_stretch() -> None:
    items, _ = run_pipeline([hello(), raw(range(150)), Break("discontinuity", 0), raw(range(150, 310))])
    assert [(f.samples, left_out(f)) for f in of(Fit, items)] == [(100, 0), (250, live.BREAK)]


# --- fields of estimates that come from the fit ---


@pytest.mark.parametrize("who", ["host", "device"])
def test_estimates_say_what_the_newest_fit_before_their_sample_says(who: str) -> None:
    items, _ = run_pipeline(events(Board().run(noise(460))), estimator__estimate_on=who)
    newest: Fit | None = None
    seen = set()
    for record in records_of(items):
        if isinstance(record, Fit):
            newest = record
        elif isinstance(record, Estimate):
            for axis, one in record.axes.items():
                if newest is None:
                    assert (one.null_p, one.whiteness) == (None, None)
                    continue
                p = newest.axes[axis].null_p
                assert p is not None
                assert one.null_p == float(f"{p:.3g}")
                assert one.whiteness == ("rejected" if p < ANYTIME_LEVEL else "not rejected")
                seen.add(newest.seq)
    assert seen == {99, 199, 299, 399}


def test_estimates_say_nothing_of_it_where_there_is_none() -> None:
    items, _ = run_pipeline([hello(), raw(range(350))], live__on=False)
    found = of(Estimate, records_of(items))
    assert len(found) == 330
    assert all(one.null_p is one.whiteness is None for r in found for one in r.axes.values())


# --- snapshots ---


def saved() -> DeviceState:
    _, pipeline = run_pipeline([hello(), raw(range(150))])
    state = pipeline.save()
    assert state is not None
    assert state.gyro_fit is not None
    assert state.accel_fit is None
    return state


def test_a_saved_fit_goes_on_with_a_break_for_the_time_between() -> None:
    items, _ = run_pipeline([hello(), raw(range(400, 550))], saved())
    assert [item.reason for item in of(Epoch, items)] == ["resumed"]
    (fit,) = of(Fit, items)
    assert (fit.samples, left_out(fit)) == (250, 250)


def test_a_saved_fit_that_is_not_sound_is_refused_with_all_the_rest() -> None:
    items, _ = run_pipeline([hello(), raw(range(400, 550))], replace(saved(), gyro_fit=b"nonsense"))
    (error,) = of(Error, items)
    assert error.kind == "state_unused"
    assert "no sums of a live fit" in error.message
    assert of(Fit, items)[0].samples == 100


def test_filters_that_are_refused_take_the_saved_fit_with_them() -> None:
    state = saved()
    assert state.gyro is not None
    items, _ = run_pipeline(
        [hello(), raw(range(400, 550))], replace(state, gyro=replace(state.gyro, engine=b"nonsense"))
    )
    assert [item.kind for item in of(Error, items)] == ["state_unused"]
    assert (of(Fit, items)[0].samples, left_out(of(Fit, items)[0])) == (100, 0)


def test_another_memory_begins_again() -> None:
    items, _ = run_pipeline([hello(), raw(range(400, 550))], saved(), live__memory="10min")
    (error,) = of(Error, items)
    assert "live.memory" in error.message
    assert of(Fit, items)[0].samples == 100


# --- real fits; the tests above use a stand-in ---


@given(cuts(400), st.sets(st.integers(1, 398), max_size=5))
@settings(max_examples=5)
def test_true_fits_are_the_same_in_any_cut(places: list[int], lost: set[int]) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(live, "LiveAxes", LiveAxes)
        block = raw(k for k in range(400) if k not in lost)

        def all_of(blocks: Iterable[Event]) -> list[bytes]:
            items, pipeline = run_pipeline([hello(), *blocks], channels=["gyro_x"], live__period_s=1.5)
            return ndjson([*of(Fit, items), *pipeline.finish()])

        whole = all_of([block])
        assert len(whole) == 4
        assert all_of(in_blocks(block, places)) == whole
