"""A device that estimates by itself: its estimates published as they are, and beside the host's."""

import math
from collections.abc import Callable, Iterable
from typing import Any

import msgspec
import pytest
from blocks import of, records_of
from estimating_board import ESTIMATOR, Board, Sent, changed, events, exact, noise
from fltea.records.events import Event, LinkDown, RawBlock, host_ns_of
from fltea.records.records import (
    AnyRecord,
    DeviceAxisEstimate,
    DeviceEstimates,
    Epoch,
    Error,
    Estimate,
    EstimatorInfo,
    FlteaEstimate,
    Sample,
    Stats,
)
from fltea.settings.config import load_config
from fltea.sources.wire_events import WireEvents
from fltea.stream.pipeline import Pipeline
from fltea.wire import layout as wire
from host_support import WIRE_HELLO
from own_estimator import TRIPLE
from walk_support import Source

AXES = ("gyro_x", "gyro_y", "gyro_z")
STARTUP = ESTIMATOR.startup
PRINTED = TRIPLE._replace(startup=STARTUP, remaining=STARTUP, guard=wire.EstimatorGuard.FAITHFUL)


def pipeline(who: str, **settings: object) -> Pipeline:
    changes = {"estimator__estimate_on": who} | settings
    return Pipeline(Source(), load_config(None, {k.replace("__", "."): v for k, v in changes.items()}))


def feed(walk: Pipeline, found: Iterable[Event]) -> list[AnyRecord]:
    records = records_of(item for event in found for item in walk.feed(event))
    text = msgspec.json.encode(records)
    assert b"NaN" not in text
    assert msgspec.json.decode(text, type=list[AnyRecord]) == records
    return records


def estimates_of(who: str, records: Iterable[AnyRecord]) -> list[Any]:
    """What is published of the device: its estimates alone, or beside the host's."""
    return of(Estimate if who == "device" else DeviceEstimates, records)


def of_filters(e: Estimate | DeviceEstimates) -> list[FlteaEstimate]:
    """The board's own estimates of a sample, whichever record they are in."""
    return [a if isinstance(a, DeviceAxisEstimate) else a.fltea for a in e.axes.values()]


def reasons(compared: Iterable[DeviceEstimates], *axes: str) -> set[str | None]:
    """Why axes, by default all, are not compared."""
    return {a.why_not for e in compared for name, a in e.axes.items() if name in (axes or AXES)}


def test_the_device_alone_is_published_as_it_is() -> None:
    sent = list(Board().run(noise(200)))
    walk = pipeline("device")
    records = feed(walk, events(sent))
    estimates = of(Estimate, records)
    said = [one.message for one in sent if isinstance(one.message, wire.Estimate)]
    assert [e.seq for e in estimates] == list(range(STARTUP, 200))
    assert not of(DeviceEstimates, records)
    assert {e.variant for e in estimates} == {"joint"}
    places = {s.seq: (s.epoch, s.device_us, s.host_ns) for s in of(Sample, records)}
    assert all((e.epoch, e.device_us, e.host_ns) == places[e.seq] for e in estimates)
    got = [msgspec.structs.astuple(e.axes[axis].fltea)[:7] for e in estimates for axis in AXES]
    assert got == [(*rounded(one), True) for one in said]
    settings = EstimatorInfo("joint", "device", "compressed", "consistent", 0, STARTUP, "startup", "auto")
    assert of(Epoch, records)[0].estimator == settings


def rounded(one: wire.Estimate) -> tuple[float, ...]:
    back = wire.Estimate.unpack(one.pack())
    return back.alpha, back.alpha_std, back.f, back.f_std, back.state, back.innovation


def test_what_the_device_tracks_is_published_from_its_first_fit_on() -> None:
    numbers = {
        "tracker_bias": 0.5,
        "tracker_bias_std": 0.25,
        "tracker_state": -0.125,
        "tracker_state_std": 1.0,
    }
    sent = [*Board().run(noise(200))]
    flags = wire.EstimateFlags.VALID | wire.EstimateFlags.TRACKED
    which = {"which": lambda one: one.at >= 150 and one.message.axis == wire.Axis.GYRO_Y}
    fitted = changed(sent, wire.Estimate, **which, flags=flags, **numbers)
    records = feed(pipeline("both"), events(fitted))
    compared, biases = of(DeviceEstimates, records), {e.seq: e.axes for e in of(Estimate, records)}
    for e in compared:
        for axis, a in e.axes.items():
            known = e.seq >= 150 and axis == "gyro_y"
            assert [getattr(a, name) for name in numbers] == [x if known else None for x in numbers.values()]
            of_host = biases[e.seq][axis].bias
            expected = 0.5 - of_host if known and of_host is not None else None
            assert a.tracker_bias_difference == expected
    assert compared[-1].seq == 199
    beyond = changed(sent, wire.Estimate, flags=wire.EstimateFlags.TRACKED, tracker_state_std=math.nan)
    last = of(DeviceEstimates, feed(pipeline("both"), events(beyond)))[-1].axes["gyro_x"]
    assert (last.tracker_bias, last.tracker_state_std) == (0.0, None)


def test_the_device_says_bias_r_restarts_and_interventions() -> None:
    sent = [*Board().run(noise(201))]
    sent = list(changed(sent, wire.Estimate, order_gate=3))
    walk = pipeline("device")
    last = feed(walk, events(changed(sent, wire.Estimator, restarts_y=2)))
    stats = walk.stats()
    assert stats.startup_remaining == 0
    assert [axis.restarts for axis in stats.axes.values()] == [0, 2, 0]
    assert stats.axes["gyro_x"].interventions["order_gate"] == 3
    said = next(one.message for one in reversed(sent) if isinstance(one.message, wire.Estimator))
    of_axes = [(getattr(said, f"bias_{axis}"), getattr(said, f"r_{axis}")) for axis in "xyz"]
    assert [(a.bias, a.R) for a in stats.axes.values()] == of_axes
    own = stats.device_estimator
    assert own is not None
    assert (own.begun, own.every, own.longest_axis_us, own.estimates) == (1, 1, 2400, 3 * (201 - STARTUP))
    assert (own.lost, own.unplaced) == (0, 0)
    first = of(Stats, last)[0]
    assert first.startup_remaining == STARTUP
    assert first.axes["gyro_x"].bias is None


@pytest.mark.parametrize("stated", [ESTIMATOR, PRINTED], ids=["joint", "triple"])
def test_both_differ_by_nothing_in_double_precision(stated: wire.Estimator) -> None:
    """With samples that the device missed, and its settings, which are not the host's own."""
    counts = [None if k in (60, 61, 90) else row for k, row in enumerate(noise(400))]
    records = feed(pipeline("both"), exact(Board(stated).run(counts)))
    compared = of(DeviceEstimates, records)
    assert [e.seq for e in compared] == [e.seq for e in of(Estimate, records)]
    assert len(compared) == 400 - 3 - STARTUP
    assert all(e.comparable for e in compared)
    for e in compared:
        assert [a.age for a in e.axes.values()] == [e.seq - STARTUP + 1] * 3
        for a in e.axes.values():
            differences = (a.alpha_difference, a.f_difference, a.state_difference)
            assert differences == pytest.approx((0, 0, 0), abs=1e-12)  # the mean's last bit
    epoch = of(Epoch, records)[0].estimator
    assert (epoch.estimate_on, epoch.variant, epoch.window) == ("both", compared[0].variant, 0)
    assert epoch.startup_samples == STARTUP


def test_both_over_the_wire_differ_by_single_precision() -> None:
    records = feed(pipeline("both"), events(Board().run(noise(400))))
    compared = of(DeviceEstimates, records)
    hosts = {e.seq: e for e in of(Estimate, records)}
    differences = []
    for e in compared:
        for axis, a in e.axes.items():
            host = hosts[e.seq].axes[axis].fltea
            assert a.alpha_difference == a.alpha - host.alpha
            assert a.f_difference == a.f - host.f
            assert a.state_difference == a.state - host.state
            differences += [abs(a.alpha_difference), abs(a.f_difference) / 1e2, abs(a.state_difference)]
    assert 0 < max(differences) < 1e-6


@pytest.mark.parametrize("who", ["device", "both"])
def test_the_sequence_wraps_and_estimates_come_late(who: str) -> None:
    """Twenty samples behind, and the 16-bit numbers begin again in between."""
    sent = list(Board(late=20, first=65_500).run(noise(200)))
    walk = pipeline(who)
    records = feed(walk, events(sent))
    found = estimates_of(who, records)
    assert [e.seq for e in found] == list(range(65_500 + STARTUP, 65_500 + 180))
    if who == "both":
        assert all(e.comparable for e in found)
    places = {s.seq: s.device_us for s in of(Sample, records)}
    assert all(e.device_us == places[e.seq] for e in found)


def test_later_than_is_remembered_is_counted() -> None:
    walk = pipeline("both")
    records = feed(walk, events(Board(late=256).run(noise(400))))
    assert not of(DeviceEstimates, records)
    own = walk.stats().device_estimator
    assert own.unplaced == own.estimates == 3 * (400 - 256 - STARTUP)


@pytest.mark.parametrize("who", ["device", "both"])
def test_an_axis_that_is_lost_on_the_line_costs_only_itself(who: str) -> None:
    sent = list(Board().run(noise(100)))
    k = next(i for i, one in enumerate(sent) if getattr(one.message, "sample", 0) == 60)
    assert sent[k + 1].message.axis == wire.Axis.GYRO_Y
    del sent[k + 1]
    walk = pipeline(who)
    found = {e.seq: e for e in estimates_of(who, feed(walk, events(sent)))}
    assert sorted(found) == list(range(STARTUP, 100))
    assert list(found[60].axes) == ["gyro_x", "gyro_z"]
    assert all(len(e.axes) == 3 for seq, e in found.items() if seq != 60)
    assert walk.stats().device_estimator.lost == 1


def test_a_sample_that_only_the_line_lost_has_no_place_for_its_estimate() -> None:
    sent, walk = Board().run(noise(100)), pipeline("both")
    sent = (one for one in sent if one.at not in (50, 51) or not isinstance(one.message, wire.Sample))
    compared = of(DeviceEstimates, feed(walk, events(sent)))
    assert [e.seq for e in compared] == [k for k in range(STARTUP, 100) if k not in (50, 51)]
    assert walk.stats().device_estimator.unplaced == 6
    assert all(e.comparable for e in compared), "the ages agree all the same"
    assert compared[-1].axes["gyro_x"].state_difference != 0


@pytest.mark.parametrize("who", ["device", "both"])
def test_a_device_that_restarts_begins_anew(who: str) -> None:
    """Estimates of the boot before must not be taken for those of samples of the same number."""
    first = list(Board(late=5).run(noise(100)))
    second = list(Board(hello=WIRE_HELLO._replace(boot_id=6), late=5).run(noise(100, seed=2)))
    stray = [one for one in Board().run(noise(100)) if getattr(one.message, "sample", 0) in (95, 96)]
    assert len(stray) == 6
    link = WireEvents("board")
    walk = pipeline(who)
    records = feed(walk, events([*first, *second[:1]], link))
    records += feed(walk, events([one._replace(at=0) for one in stray] + second[1:], link, start=120))
    found = estimates_of(who, records)
    assert [(e.epoch, e.seq) for e in found] == [(n, k) for n in (1, 2) for k in range(STARTUP, 95)]
    if who == "both":
        assert all(e.comparable for e in found)
    assert [e.reason for e in of(Epoch, records)] == ["start", "restart"]
    own = walk.stats().device_estimator
    assert own.unplaced == len(stray)


@pytest.mark.parametrize("known", [True, False])
def test_after_another_start_of_the_sensor_both_begin_with_the_settings_of_the_device(known: bool) -> None:
    """The device need not state them again; without any, the host has its own, and compares nothing."""
    again = WIRE_HELLO._replace(sensor_starts=2)
    first = list(Board().run(noise(100)))
    second = [one for one in Board(hello=again, first=110).run(noise(100, 3)) if known or one.at]
    if not known:
        first = [one for one in first if not isinstance(one.message, wire.Estimator)]
        second.insert(0, Sent(0, again, 0))
    second = [one for one in second if not isinstance(one.message, wire.Estimator)]
    late = [Sent(99, ESTIMATOR, 7)]
    link = WireEvents("board")
    moved = [one._replace(at=one.at + 110) for one in second + late]
    records = feed(pipeline("both"), events([*first, *moved], link))
    epochs = of(Epoch, records)
    assert [e.reason for e in epochs] == ["start", "sensor_restart"]
    assert [e.estimator.window for e in epochs] == ([0, 0] if known else [3000, 3000])
    compared = [e for e in of(DeviceEstimates, records) if e.epoch == 2]
    if known:
        assert [e.seq for e in compared] == list(range(110 + STARTUP, 210))
        assert all(e.comparable for e in compared)


def told_late() -> list[Sent]:
    """The device states its settings only after the first sample; all but gate and window are the host's."""
    late = [one for one in Board().run(noise(250)) if one.at or not isinstance(one.message, wire.Estimator)]
    return [*late[:20], Sent(15, ESTIMATOR, 0), *late[20:]]


def heard_late() -> list[Sent]:
    """The device was already running; the host has a start-up window of its own by then."""
    return [one for one in Board().run(noise(400)) if one.at >= 150]


@pytest.mark.parametrize(
    ("sent", "settings", "numbers", "why"),
    [
        (told_late, {"estimator__startup": STARTUP}, range(STARTUP, 250), "other_settings"),
        (heard_late, {}, range(150, 400), "other_start"),
    ],
)
def test_what_began_otherwise_is_shown_and_not_compared(
    sent: Callable[[], list[Sent]], settings: dict[str, Any], numbers: range, why: str
) -> None:
    records = feed(pipeline("both", **settings), events(sent()))
    compared = of(DeviceEstimates, records)
    assert of(Estimate, records)
    assert set(numbers[50:]) <= {e.seq for e in compared} <= set(numbers)
    assert not any(e.comparable for e in compared)
    assert {a.alpha_difference for e in compared for a in e.axes.values()} == {None}
    assert reasons(compared) == {why}
    assert all(a.valid and a.alpha is not None for e in compared for a in e.axes.values())


def test_what_was_skipped_is_told_once_a_minute_and_not_compared() -> None:
    flags = wire.EstimateFlags.VALID | wire.EstimateFlags.SKIPPED
    sent = Board().run(noise(200))
    skipped = list(changed(sent, wire.Estimate, lambda one: one.at >= 100, flags=flags))
    skipped += [Sent(200 + 100 * k, ESTIMATOR._replace(skipped=k), 0) for k in range(130)]
    walk = pipeline("both")
    records = feed(walk, events(skipped))
    compared = of(DeviceEstimates, records)
    assert {e.seq for e in compared if e.comparable} == set(range(STARTUP, 100))
    assert {a.why_not for e in compared if e.seq >= 100 for a in e.axes.values()} == {"device_skipped"}
    assert all(e.axes["gyro_x"].valid for e in compared)
    told = [e.message for e in of(Error, records) if e.kind == "device_skipped"]
    assert [text.split("samples")[0].split("skipped")[1].strip() for text in told] == ["1", "60", "60"]
    assert walk.stats().device_estimator.skipped == 129


def test_a_constant_axis_is_null_and_told_once() -> None:
    counts = [(x, -7, z) for x, _, z in noise(150)]
    for who in ("device", "both"):
        records = feed(pipeline(who), events(Board().run(counts)))
        told = [e for e in of(Error, records) if e.kind == "constant_axis"]
        assert len(told) == 1, who
        assert "gyro_y" in told[0].message
        for e in estimates_of(who, records):
            assert [a.valid for a in of_filters(e)] == [True, False, True]
            assert of_filters(e)[1].alpha is None
        assert of(Stats, records)[-1].axes["gyro_y"].R is None
    compared = of(DeviceEstimates, records)
    assert all(e.comparable and e.axes["gyro_y"].alpha_difference is None for e in compared)
    assert reasons(compared, "gyro_y") == {"device_not_valid"}
    assert reasons(compared, "gyro_x") == {None}


def test_a_device_that_says_that_an_axis_is_lost_is_believed() -> None:
    which = {"which": lambda one: one.message.axis == 2 and one.at % 20 == 10}
    lost = changed(Board().run(noise(100)), wire.Estimate, **which, flags=0, alpha=0.0)
    records = feed(pipeline("device"), events(lost))
    assert [e.kind for e in of(Error, records)] == ["axis_bound"], "once a minute"
    invalid = {e.seq for e in of(Estimate, records) if not e.axes["gyro_z"].fltea.valid}
    assert invalid == {30, 50, 70, 90}


@pytest.mark.parametrize("who", ["device", "both"])
def test_a_step_without_a_measurement_has_no_innovation(who: str) -> None:
    flags = wire.EstimateFlags.VALID | wire.EstimateFlags.MISSING
    records = feed(pipeline(who), events(changed(Board().run(noise(50)), wire.Estimate, flags=flags)))
    assert {(a.valid, a.innovation) for e in estimates_of(who, records) for a in of_filters(e)} == {
        (True, None)
    }


@pytest.mark.parametrize("field", ["alpha", "alpha_std", "f", "f_std", "state", "innovation"])
@pytest.mark.parametrize("who", ["device", "both"])
def test_what_is_not_finite_is_published_as_null(who: str, field: str) -> None:
    sent = list(Board().run(noise(60)))
    for bad in (math.nan, math.inf):
        records = feed(pipeline(who), events(changed(sent, wire.Estimate, **{field: bad})))
        found = estimates_of(who, records)
        assert len(found) == 60 - STARTUP
        for e in found:
            for a in of_filters(e):
                assert a.valid == (field == "innovation")
                assert a.innovation is None
                assert (a.alpha is None) == (field != "innovation")


def test_settings_that_are_not_finite_are_told_and_nothing_is_compared() -> None:
    bad = changed(Board().run(noise(250)), wire.Estimator, state_q=math.nan)
    records = feed(pipeline("both"), events(bad))
    assert [e.kind for e in of(Error, records)] == ["device_settings"]
    assert not any(e.comparable for e in of(DeviceEstimates, records))


@pytest.mark.parametrize("who", ["device", "both"])
def test_a_device_that_never_estimates_is_told_of_once(who: str) -> None:
    walk = pipeline(who)
    records = feed(walk, events(Board(None).run(noise(1200))))
    told = of(Error, records)
    assert [e.kind for e in told] == ["no_device_estimates"]
    assert told[0].host_ns == of(Sample, records)[500].host_ns
    assert "--estimate-on host" in told[0].message
    assert walk.stats().device_estimator is None
    assert len(of(Estimate, records)) == (0 if who == "device" else 1200 - 500)


def test_a_host_that_estimates_alone_does_not_listen_to_the_device() -> None:
    walk = pipeline("host", estimator__startup=20, estimator__window=50)
    sent = list(Board().run(noise(100)))
    heard = feed(walk, events(sent))
    alone = [one for one in sent if not isinstance(one.message, wire.Estimate | wire.Estimator)]
    assert heard == feed(pipeline("host", estimator__startup=20, estimator__window=50), events(alone))
    assert walk.stats().device_estimator is None


@pytest.mark.parametrize("who", ["device", "both"])
def test_only_the_axes_that_were_asked_for(who: str) -> None:
    walk = pipeline(who, channels=["gyro_z", "accel_x"], accel__startup=40, accel__window=50)
    records = feed(walk, events(Board().run(noise(100))))
    found = [e for e in estimates_of(who, records) if "gyro_z" in e.axes]
    assert {tuple(e.axes) for e in found} == {("gyro_z",)}
    assert [e.seq for e in found] == list(range(STARTUP, 100))
    assert walk.stats().device_estimator.unplaced == 0
    assert [e.seq for e in of(Estimate, records) if "accel_x" in e.axes] == list(range(40, 100))
    assert of(Epoch, records)[0].accel_estimator.startup_samples == 40


def test_settings_that_nobody_uses_are_told_once() -> None:
    for who in ("device", "both"):
        walk = pipeline(who, estimator__window=50, estimator__state__Q=1.0)
        restarted = [*Board().run(noise(40)), *Board(hello=WIRE_HELLO._replace(boot_id=9)).run(noise(40))]
        told = [e.message for e in of(Error, feed(walk, events(restarted))) if e.kind == "settings_unused"]
        assert len(told) == 1
        assert told[0].startswith("estimator.window, estimator.state: ")
    assert not of(Error, feed(pipeline("device"), events(Board().run(noise(40)))))


def test_after_the_link_was_down_nothing_is_believed_before_it_has_introduced_itself() -> None:
    sent = list(Board().run(noise(300)))
    found = list(events(sent))
    cut = next(i for i, e in enumerate(found) if isinstance(e, RawBlock) and e.sequence[0] == 150)
    walk = pipeline("both")
    records = feed(walk, [*found[:cut], LinkDown(host_ns_of(found[cut])), *found[cut:]])
    seqs = [e.seq for e in of(DeviceEstimates, records)]
    assert seqs == [*range(STARTUP, 150), *range(200, 300)]
    assert walk.stats().device_estimator.unplaced == 3 * 50
    assert len(of(Epoch, records)) == 1
    assert all(e.comparable for e in of(DeviceEstimates, records))


def test_another_device_on_the_same_port_has_said_nothing_yet() -> None:
    link, walk = WireEvents("board"), pipeline("device")
    feed(walk, events(Board().run(noise(100)), link))
    other = Board(None, hello=WIRE_HELLO._replace(boot_id=6, firmware_version="older"))
    records = feed(walk, [LinkDown(0), *events(other.run(noise(600)), link, start=200)])
    assert [(e.reason, e.estimator) for e in of(Epoch, records)] == [("restart", None)]
    assert [e.kind for e in of(Error, records)] == ["no_device_estimates"]
    assert walk.stats().device_estimator is None
