"""The estimates of a device are published unchanged, and compared with the host's estimates."""

import math
from collections.abc import Callable
from typing import Any

import msgspec
import pytest
from fltea.records.records import DeviceEstimates, Epoch, Estimate, EstimatorInfo, Sample, Stats
from fltea.sources.wire_events import WireEvents
from fltea.wire import layout as wire

from tests.rig.blocks import of
from tests.rig.estimating_board import (
    AXES,
    ESTIMATOR,
    STARTUP,
    Board,
    Sent,
    changed,
    estimates_of,
    events,
    exact,
    feed,
    noise,
    pipeline,
    reasons,
    said,
)
from tests.rig.host_support import WIRE_HELLO
from tools.own_estimator import TRIPLE

PRINTED = TRIPLE._replace(startup=STARTUP, remaining=STARTUP, guard=wire.EstimatorGuard.FAITHFUL)


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
    settings = EstimatorInfo("joint", "device", "compressed", "consistent", 0, STARTUP, (), ())
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
    which = {"which": lambda one: one.instant >= 150 and one.message.axis == wire.Axis.GYRO_Y}
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
    assert [(a.bias, a.R_in_use) for a in stats.axes.values()] == of_axes
    own = stats.device_estimator
    assert own is not None
    assert (own.begun, own.every, own.longest_axis_us, own.estimates) == (1, 1, 2400, 3 * (201 - STARTUP))
    assert (own.lost, own.unplaced) == (0, 0)
    first = of(Stats, last)[0]
    assert first.startup_remaining == STARTUP
    assert first.axes["gyro_x"].bias is None


@pytest.mark.parametrize("stated", [ESTIMATOR, PRINTED], ids=["joint", "triple"])
def test_both_differ_by_nothing_in_double_precision(stated: wire.Estimator) -> None:
    """In double precision, the device's estimates equal the host's, although some samples are lost and the
    device's settings differ from the host's.
    """
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
            # the device's and the host's mean of the start-up window may differ in the last bit
            assert differences == pytest.approx((0, 0, 0), abs=1e-12)
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
            assert a.alpha_difference == a.fltea.alpha - host.alpha
            assert a.f_difference == a.fltea.f - host.f
            assert a.state_difference == a.fltea.state - host.state
            differences += [abs(a.alpha_difference), abs(a.f_difference) / 1e2, abs(a.state_difference)]
    assert 0 < max(differences) < 1e-6


@pytest.mark.parametrize("who", ["device", "both"])
def test_the_sequence_wraps_and_estimates_come_late(who: str) -> None:
    """Estimates are twenty samples late, and the 16-bit sequence numbers wrap in between."""
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
    sent = (one for one in sent if one.instant not in (50, 51) or not isinstance(one.message, wire.Sample))
    compared = of(DeviceEstimates, feed(walk, events(sent)))
    assert [e.seq for e in compared] == [k for k in range(STARTUP, 100) if k not in (50, 51)]
    assert walk.stats().device_estimator.unplaced == 6
    assert all(e.comparable for e in compared), "the ages agree all the same"
    assert compared[-1].axes["gyro_x"].state_difference != 0


@pytest.mark.parametrize("who", ["device", "both"])
def test_a_device_that_restarts_begins_anew(who: str) -> None:
    """Estimates from before a reset must not be assigned to samples after the reset that have the same
    numbers.
    """
    first = list(Board(late=5).run(noise(100)))
    second = list(Board(hello=WIRE_HELLO._replace(boot_id=6), late=5).run(noise(100, seed=2)))
    stray = [one for one in Board().run(noise(100)) if getattr(one.message, "sample", 0) in (95, 96)]
    assert len(stray) == 6
    link = WireEvents("board")
    walk = pipeline(who)
    records = feed(walk, events([*first, *second[:1]], link))
    records += feed(
        walk, events([said(0, one.message, one.sequence) for one in stray] + second[1:], link, start=120)
    )
    found = estimates_of(who, records)
    assert [(e.epoch, e.seq) for e in found] == [(n, k) for n in (1, 2) for k in range(STARTUP, 95)]
    if who == "both":
        assert all(e.comparable for e in found)
    assert [e.reason for e in of(Epoch, records)] == ["start", "restart"]
    own = walk.stats().device_estimator
    assert own.unplaced == len(stray)


@pytest.mark.parametrize("known", [True, False])
def test_after_another_start_of_the_sensor_both_begin_with_the_settings_of_the_device(known: bool) -> None:
    """The device states its settings once, and does not have to repeat them when its sensor is started again.

    If the device has not stated any settings, the host uses its own settings and compares nothing.
    """
    again = WIRE_HELLO._replace(sensor_starts=2)
    first = list(Board().run(noise(100)))
    second = [one for one in Board(hello=again, first=110).run(noise(100, 3)) if known or one.instant]
    if not known:
        first = [one for one in first if not isinstance(one.message, wire.Estimator)]
        second.insert(0, said(0, again, 0))
    second = [one for one in second if not isinstance(one.message, wire.Estimator)]
    late = [said(99, ESTIMATOR, 7)]
    link = WireEvents("board")
    moved = [said(one.instant + 110, one.message, one.sequence) for one in second + late]
    records = feed(pipeline("both"), events([*first, *moved], link))
    epochs = of(Epoch, records)
    assert [e.reason for e in epochs] == ["start", "sensor_restart"]
    assert [e.estimator.window for e in epochs] == ([0, 0] if known else [3000, 3000])
    compared = [e for e in of(DeviceEstimates, records) if e.epoch == 2]
    if known:
        assert [e.seq for e in compared] == list(range(110 + STARTUP, 210))
        assert all(e.comparable for e in compared)


def told_late() -> list[Sent]:
    """The device states its settings only after the first sample.

    All settings equal the host's, except the limit of innovations (the gate) and the start-up window.
    """
    late = [
        one for one in Board().run(noise(250)) if one.instant or not isinstance(one.message, wire.Estimator)
    ]
    return [*late[:20], said(15, ESTIMATOR, 0), *late[20:]]


def heard_late() -> list[Sent]:
    """The device was already running when the host connected. Device and host compute the first bias from
    their start-up windows, and these contain different samples.
    """
    return [one for one in Board().run(noise(400)) if one.instant >= 150]


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
    assert all(a.fltea.valid and a.fltea.alpha is not None for e in compared for a in e.axes.values())
