"""Each error of a device that estimates is reported once, and its wrong estimates are not compared."""

import math

import pytest
from fltea.records.events import LinkDown, RawBlock, host_ns_of
from fltea.records.records import DeviceEstimates, Epoch, Error, Estimate, Sample, Stats
from fltea.sources.wire_events import WireEvents
from fltea.wire import layout as wire

from tests.rig.blocks import of
from tests.rig.estimating_board import (
    ESTIMATOR,
    STARTUP,
    Board,
    changed,
    estimates_of,
    events,
    feed,
    noise,
    of_filters,
    pipeline,
    reasons,
    said,
)
from tests.rig.host_support import WIRE_HELLO


def test_what_was_skipped_is_told_once_a_minute_and_not_compared() -> None:
    flags = wire.EstimateFlags.VALID | wire.EstimateFlags.SKIPPED
    sent = Board().run(noise(200))
    skipped = list(changed(sent, wire.Estimate, lambda one: one.instant >= 100, flags=flags))
    skipped += [said(200 + 100 * k, ESTIMATOR._replace(skipped=k), 0) for k in range(130)]
    walk = pipeline("both")
    records = feed(walk, events(skipped))
    compared = of(DeviceEstimates, records)
    assert {e.seq for e in compared if e.comparable} == set(range(STARTUP, 100))
    assert {a.why_not for e in compared if e.seq >= 100 for a in e.axes.values()} == {"device_skipped"}
    assert all(e.axes["gyro_x"].fltea.valid for e in compared)
    details = [e.message for e in of(Error, records) if e.kind == "device_skipped"]
    assert [text.split("samples")[0].split("skipped")[1].strip() for text in details] == ["1", "60", "60"]
    assert walk.stats().device_estimator.skipped == 129


def test_a_constant_axis_is_null_and_told_once() -> None:
    counts = [(x, -7, z) for x, _, z in noise(150)]
    for who in ("device", "both"):
        records = feed(pipeline(who), events(Board().run(counts)))
        details = [e for e in of(Error, records) if e.kind == "constant_axis"]
        assert len(details) == 1, who
        assert "gyro_y" in details[0].message
        for e in estimates_of(who, records):
            assert [a.valid for a in of_filters(e)] == [True, False, True]
            assert of_filters(e)[1].alpha is None
        assert of(Stats, records)[-1].axes["gyro_y"].R_in_use is None
    compared = of(DeviceEstimates, records)
    assert all(e.comparable and e.axes["gyro_y"].alpha_difference is None for e in compared)
    assert reasons(compared, "gyro_y") == {"device_not_valid"}
    assert reasons(compared, "gyro_x") == {None}


def test_a_device_that_says_that_an_axis_is_lost_is_believed() -> None:
    which = {"which": lambda one: one.message.axis == 2 and one.instant % 20 == 10}
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
    details = of(Error, records)
    assert [e.kind for e in details] == ["no_device_estimates"]
    assert details[0].host_ns == of(Sample, records)[500].host_ns
    assert "--estimate-on host" in details[0].message
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
        details = [e.message for e in of(Error, feed(walk, events(restarted))) if e.kind == "settings_unused"]
        assert len(details) == 1
        assert details[0].startswith("estimator.window, estimator.state: ")
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
