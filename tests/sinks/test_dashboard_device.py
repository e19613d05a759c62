"""Tests of the live page of a device that makes estimates itself. The host makes estimates as well, or leaves
them to the device.
"""

from collections.abc import Callable

import msgspec
import numpy as np
import pytest
from fltea.records.estimate import DeviceAxisEstimate, FlteaEstimate, WhyNot
from fltea.records.records import ACCEL_AXES, AXES, AnyRecord, DeviceEstimates, Epoch, Estimate
from fltea.settings.estimator import EstimateOn
from fltea.sinks.page import facts, facts_of_device
from fltea.sinks.page.history import DeviceHistory
from fltea.sinks.words import apart

from tests.rig.dashboard_support import alone, both, columns, records, told, with_breaks

NOISE = "alpha=0.5&f=-1&n=600&offset_dps=1.5&seed=3"
SLOW = "n=700&rate_hz=20"


def status(history: DeviceHistory) -> tuple[str, str]:
    return facts.status(history, history.heard_ns or 0)


# --- only the device estimates ---


@pytest.mark.parametrize("late", [0, 3])
def test_device_alone_is_drawn_as_published_at_a_pace_of_its_own(late: int) -> None:
    found = alone(records(NOISE), late=late)
    history = told(found, who="device")
    assert history.estimator("gyro_y") == "device"
    shown = columns(history, "gyro_y")
    published = [e.axes["gyro_y"].fltea.alpha or 0.0 for e in found if isinstance(e, Estimate)]
    # the first row is skipped: at that time the page does not know the axes of the estimates yet
    drawn = shown["alpha"][1:]
    assert np.isfinite(drawn).all(), "each until the next comes"
    assert min(published) <= drawn.min() < drawn.max() <= max(published)
    assert np.isfinite(shown["y"]).all(), "every sample is drawn"


def test_what_a_device_estimated_is_not_drawn_for_ever() -> None:
    found = alone(records("n=1500"))
    silent = [r for r in found if not (isinstance(r, Estimate) and r.seq > 700)]
    shown = columns(told(silent, who="device"), "gyro_y")
    drawn = shown["time"][np.isfinite(shown["alpha"])]
    assert drawn[-1] - drawn[0] == pytest.approx(7_000 - 1_000 + 5_000, abs=300)


def test_axes_of_the_accelerometer_are_the_hosts_and_leave_the_devices_alone() -> None:
    """The device estimates the gyroscope's axes. The estimates of the accelerometer's axes come from the
    host, in separate records.
    """
    found: list[AnyRecord] = []
    for record in with_breaks([700], accel=True):
        if isinstance(record, Estimate):
            own = {axis: e for axis, e in record.axes.items() if axis in AXES}
            accel = {axis: e for axis, e in record.axes.items() if axis in ACCEL_AXES}
            if own and record.seq % 10 == 0:
                found.append(msgspec.structs.replace(record, axes=own))
            if accel:
                found.append(msgspec.structs.replace(record, axes=accel))
        else:
            found.append(record)
    history = told(found, who="device")
    assert [history.estimator(axis) for axis in history.axes] == ["device", "host", "host"]
    assert history.epoch.newest.keys() == {"gyro_x", "accel_x", "accel_y"}
    for axis in ("accel_y", "gyro_x"):
        assert np.isfinite(columns(history, axis)["alpha"][-2])


def test_status_counts_the_devices_window_down_and_waits_for_its_estimates() -> None:
    found = alone(records("n=130"), startup_remaining=40)
    history = told([r for r in found if not isinstance(r, Estimate)], who="device")
    assert status(history) == (
        "wait",
        "start-up: 40 samples to go; keep the sensor at rest (epoch 1: the first since the program started)",
    )
    full = [r for r in alone(records("n=130")) if not isinstance(r, Estimate)]
    assert status(told(full, who="device"))[1].startswith("no estimate of the device yet")
    assert status(told(found, who="device"))[0] == "good"


def test_epoch_of_a_device_that_has_not_said_with_what_it_estimates() -> None:
    found = [
        msgspec.structs.replace(r, estimator=None) if isinstance(r, Epoch) else r
        for r in alone(records(NOISE))
    ]
    history = told(found, who="device")
    assert facts.settings(history) == ""
    assert status(history)[0] == "good"


@pytest.mark.parametrize(
    ("found", "who", "words"),
    [
        (alone, "device", "estimates on device (the device's own estimates as published, 10 a second), "),
        (both, "both", "estimates on both (the host's estimates, and the device's own, 10 a second), "),
        (list, "host", "guard consistent, "),
    ],
)
def test_engine_is_named_with_whose_the_estimates_are(
    found: Callable[[list[AnyRecord]], list[AnyRecord]], who: EstimateOn, words: str
) -> None:
    memory = "memory compressed, L = " + ("200" if who == "host" else "unlimited")
    assert facts.settings(told(found(records(NOISE)), who=who)).endswith(words + memory)


# --- device and this computer estimate ---


def test_the_devices_estimates_stand_beside_and_the_hosts_stay_as_they_are() -> None:
    found = both(records(NOISE), lambda seq: seq * 1e-9 if seq % 20 else None)
    history, plain = told(found, who="both"), told(records(NOISE))
    assert history.estimator("gyro_z") == "both"
    ours, theirs = columns(history, "gyro_z"), columns(plain, "gyro_z")
    for name in ("y", "alpha", "f", "state"):
        np.testing.assert_array_equal(ours[name], theirs[name])
    assert np.isnan(theirs["device_alpha"]).all()
    apart = ours["apart"][np.isfinite(ours["apart"])]
    assert len(apart) >= 20
    assert 0 < apart.min() < apart.max() < 600e-9
    assert (ours["apart_low"] <= ours["apart_high"])[np.isfinite(ours["apart"])].all()


@pytest.mark.parametrize("sign", [1, -1])
def test_largest_difference_is_that_of_what_is_shown_and_no_bucket_hides_it(sign: int) -> None:
    peaks = {60: 5e-6, 600: 3e-6}
    found = both(records(SLOW), lambda seq: sign * peaks.get(seq, 1e-8), every=1)
    history = told(found, who="both")
    at_most = {window: history.course.farthest(window, "gyro_x") for window in (0, 1, 2)}
    assert at_most[0] == pytest.approx((3e-6, 9e-6)), "the first was more than 30 s ago"
    assert at_most[1] == pytest.approx((5e-6, 15e-6))
    assert at_most[2] == pytest.approx((5e-6, 15e-6))
    axis = facts_of_device.compared(history, "gyro_x", 0)
    assert (axis["alpha_apart"], axis["f_apart"]) == (
        f"{'-+'[sign > 0]}1.0e-8 now, at most 3.0e-6",
        f"{'+-'[sign > 0]}3.0e-8 now, at most 9.0e-6",
    )
    assert axis["why_not"] == ""


def test_rows_that_are_kept_longer_than_they_are_shown_do_not_count() -> None:
    """The page states the largest difference between device and host in a diagram's time window. Older rows
    do not count, although they are kept. With one estimate in 2 s, the rows for the window of two minutes
    reach further back than two minutes.
    """
    found = both(records("n=700&rate_hz=5"), lambda seq: 5e-6 if seq == 60 else 1e-8)
    history = told(found, who="both")
    at_most = [history.course.farthest(window, "gyro_x")[0] for window in (1, 2)]
    assert at_most == pytest.approx([1e-8, 5e-6])


def test_newest_difference_counts_before_its_bucket_is_full() -> None:
    found = both(records(SLOW), lambda seq: 4e-6 if seq == 699 else 1e-8, every=1)
    axis = facts_of_device.compared(told(found, who="both"), "gyro_x", 2)
    assert axis["alpha_apart"] == "+4.0e-6 now, at most 4.0e-6"


@pytest.mark.parametrize(
    ("why", "words"),
    [
        ("other_start", "not comparable: the device began at another sample"),
        ("device_skipped", "not comparable: the device skipped samples"),
        ("other_settings", "not comparable: the host has other settings than the device"),
    ],
)
def test_what_cannot_be_compared_says_why_and_draws_no_difference(why: WhyNot, words: str) -> None:
    found = both(records(NOISE), lambda seq: None, why_not=why)
    history = told(found, who="both")
    axis = facts_of_device.compared(history, "gyro_y", 0)
    assert axis["why_not"] == words
    assert (axis["alpha_apart"], axis["f_apart"], axis["apart"]) == ("", "", None)
    assert axis["alpha_text"] != "–", "the estimate itself is shown"
    assert np.isfinite(columns(history, "gyro_y")["device_alpha"][-10:]).all()


def test_what_is_not_valid_cannot_be_compared() -> None:
    found = both(records(NOISE))
    last = next(r for r in reversed(found) if isinstance(r, DeviceEstimates))
    gone = DeviceAxisEstimate(fltea=FlteaEstimate(), age=550, why_not="device_not_valid")
    bias = {"tracker_bias": 0.2345, "tracker_bias_std": 0.012, "tracker_bias_difference": 0.018}
    tracked = msgspec.structs.replace(gone, **bias)
    history = told(
        found,
        [msgspec.structs.replace(last, axes={**last.axes, "gyro_x": gone, "gyro_z": tracked})],
        who="both",
    )
    x, y, of_z = (facts_of_device.compared(history, f"gyro_{axis}", 0) for axis in "xyz")
    assert x is not None
    assert y is not None
    assert of_z is not None
    z = dict(of_z["rows"])
    assert (z["bias, device"], z["bias, device − host"]) == ("0.234 ± 0.024 deg/s", "+1.8e-2 deg/s = +1.5 σ")
    assert x["why_not"] == "not comparable: the device's estimate is not valid"
    assert x["alpha_text"] == "–"
    assert y["why_not"] == ""
    assert "bias, device" not in dict(x["rows"]), "before its first fit"
    assert status(history)[0] == "good", "the host's are valid"


def test_new_epoch_forgets_the_devices_estimates_and_cuts_their_lines() -> None:
    history = told(both(with_breaks([400, 60])), who="both")
    shown = columns(history, "gyro_x")
    assert np.isfinite(shown["device_alpha"]).any()
    assert np.isnan(shown["device_alpha"][-4:]).all()
    begun = both(with_breaks([400, 20]))
    axis = facts_of_device.compared(told(begun, who="both"), "gyro_x", 0)
    assert axis["why_not"] == "no estimate of the device yet"


# --- texts and the page ---


def test_facts_of_the_devices_estimator() -> None:
    history = told(both(records(NOISE), skipped=1200, startup_remaining=7), who="both")
    rows = {label: (value, level) for label, value, level in facts_of_device.own(history)}
    assert rows["CPU share"] == ("16.8 %", "plain")
    assert rows["longest turn of its loop"] == ("8.21 ms", "plain")
    assert rows["longest step of an axis"] == ("2.41 ms", "plain")
    assert rows["start-up remaining"] == ("7 samples", "wait")
    assert rows["skipped samples"] == ("1,200 (it had fallen behind)", "bad")
    assert rows["estimates"] == ("every 10 samples, 10 a second", "plain")
    good = {label: level for label, _, level in facts_of_device.own(told(both(records(NOISE)), who="both"))}
    assert set(good.values()) == {"plain"}
    assert facts_of_device.own(told(records(NOISE))) == []


@pytest.mark.parametrize(
    ("value", "text"),
    [(1.23e-7, "+1.2e-7"), (-3.4e-12, "-3.4e-12"), (0.02, "+2.0e-2"), (0.0, "0"), (2e10, "+2.0e10")],
)
def test_difference_in_powers_of_ten(value: float, text: str) -> None:
    assert apart(value) == text
