"""Tests of what the live page says about a device, in plain words with units.

What the page says about the noise is tested in test_dashboard_answer.
"""

import json
from collections.abc import Callable

import msgspec
import pytest
from fltea.records import clock
from fltea.records.estimate import FlteaEstimate
from fltea.records.plus_minus import plus_minus
from fltea.records.records import AnyRecord, Error, Estimate, Gap, Stats
from fltea.records.stats import LinkStats, OutputStats
from fltea.sinks.page import facts
from fltea.sinks.page.history import DeviceHistory
from fltea.sinks.words import duration, figure

from tests.rig.dashboard_support import records, told, with_breaks
from tests.rig.example_records import STATS
from tests.rig.host_support import hello


def later(history: DeviceHistory, seconds: float) -> tuple[str, str]:
    return facts.status(history, (history.heard_ns or clock.host_ns()) + int(seconds * 1e9))


NO_PORT = Error("no_port", "there is no /dev/x", 1)
GONE = Error("unplugged", "the port is gone", 1)
START = "(epoch 1: the first since the program started)"


def reconnected() -> list[AnyRecord]:
    *found, last = with_breaks([200, 100])
    assert isinstance(last, Stats)
    return [*found, msgspec.structs.replace(last, link=LinkStats(reconnects=1))]


@pytest.mark.parametrize(
    ("heard", "seconds", "level", "text"),
    [
        (list, 0, "wait", "waiting for the device"),
        (lambda: [hello()], 0, "wait", "connected, waiting for the first sample"),
        (lambda: [NO_PORT], 0, "bad", "waiting for the device: there is no /dev/x"),
        (lambda: records("n=49"), 0, "wait", f"start-up: 1 samples to go; keep the sensor at rest {START}"),
        (lambda: records("n=50"), 0, "good", f"running for 0 s {START}"),
        (lambda: with_breaks([200]), 1, "good", f"running for 1 s {START}"),
        (lambda: with_breaks([200]), 4, "bad", "stalled for 4 s: no sample arrives"),
        (lambda: [*with_breaks([200]), GONE], 400, "bad", "stalled for 6 min: the port is gone"),
        # The port was missing earlier, which must not appear as the cause of a later stall.
        (lambda: [NO_PORT, *with_breaks([200])], 4, "bad", "stalled for 4 s: no sample arrives"),
        (lambda: records("n=200"), 5, "wait", "at its end: no sample for 5 s"),
        (reconnected, 0, "good", "running for 0 s (reconnected, epoch 2: the device restarted)"),
    ],
)
def test_status_in_a_line(
    heard: Callable[[], list[AnyRecord]], seconds: float, level: str, text: str
) -> None:
    assert later(told(heard()), seconds) == (level, text)


def test_status_names_the_axis_that_is_not_valid() -> None:
    history = told(records("n=200"))
    assert history.epoch.estimate is not None
    x = history.epoch.estimate.axes["gyro_x"]
    gone = msgspec.structs.replace(x, fltea=FlteaEstimate())
    estimate = msgspec.structs.replace(
        history.epoch.estimate, axes={**history.epoch.estimate.axes, "gyro_x": gone}
    )
    history.write(estimate)
    assert later(history, 0)[0] == "bad"
    assert "gyro_x not valid" in later(history, 0)[1]
    assert dict(facts.axis(history, "gyro_x", 0)["rows"])["α, 95 %"] == "–"


def test_axis_is_what_its_records_say() -> None:
    found = records("n=600&offset_dps=1.5")
    history = told(found)
    whole = next(r for r in reversed(found) if isinstance(r, Estimate)).axes["gyro_y"]
    last = whole.fltea
    rows = dict(facts.axis(history, "gyro_y", 0)["rows"])
    assert rows["α, 95 %"] == plus_minus(last.alpha, last.alpha_std)
    assert rows["offset removed"].startswith("1.5")
    assert rows["state x̂ (paper)"].endswith("deg/s")
    assert rows["bias"] == f"{plus_minus(whole.bias, whole.bias_std)} deg/s"
    assert facts.axes(history)[1]["rest"] == f": bias {rows['bias']}."
    assert rows["bias"].startswith("1.5")
    assert rows["FLTEA (paper)"] in ("settled", "settling")
    assert rows["R"].endswith("(deg/s)²")


def test_the_heading_is_said_by_the_time_after_a_rest() -> None:
    history = told(records("n=600"))
    assert facts.axis(history, "gyro_x", 0)["headings"] == facts.curves(history, "gyro_x") == []
    history.write(STATS)
    assert facts.axis(history, "gyro_x", 0)["headings"] == [
        ["rest so far", "6 s"],
        ["after 1 s", "± 0.027°"],
        ["after 60 s", "± 0.51°"],
    ]
    assert "Heading after the rest so far, 95 %" in facts.curves(history, "gyro_x")[0]
    assert facts.axes(history)[0]["rest"].startswith(": heading ± 0.51° after 60 s; bias ")
    assert facts.curves(history, "accel_z") == []


def test_beyond_half_a_turn_no_heading_is_left() -> None:
    history = told(records("n=600"))
    axis = STATS.axes["gyro_x"]
    assert axis.tracker is not None
    replace = msgspec.structs.replace
    tracker = replace(axis.tracker, heading_std={1: 0.26, 600: 181.0, 3600: 5900.0})
    history.write(replace(STATS, axes={"gyro_x": replace(axis, tracker=tracker)}))
    words = [words for _, words in facts.axis(history, "gyro_x", 0)["headings"]]
    assert words == ["6 s", "± 0.51°", "no heading left", "no heading left"]
    assert "5900" not in facts.curves(history, "gyro_x")[0]


def test_a_clock_that_is_no_clock_is_said() -> None:
    stats = told(with_breaks([200])).stats
    assert stats is not None
    assert facts.slow(msgspec.structs.replace(stats, clock_ppm=-250.0)) == facts.slow(None) == ""
    words = facts.slow(msgspec.structs.replace(stats, clock_ppm=-380_000.0))
    assert words.startswith("The device's clock runs at 0.62 times this computer's")


def test_now_sums_up_what_is_opened_on_demand() -> None:
    history = told(with_breaks([200]), [Gap(7, 2, 1, 10)])
    assert history.stats is not None
    history.write(msgspec.structs.replace(history.stats, link=LinkStats(reconnects=1, bad_frames={"crc": 2})))
    found = facts.now(history, history.heard_ns or 0)
    assert found["link"] == {"level": "bad", "text": "reconnects: 1, CRC errors: 2"}
    assert found["happened"] == "a gap: 2 samples lost"
    assert facts.now(told(records("n=60")), 0)["link"]["text"] == "nothing is lost"


def test_link_shows_every_loss() -> None:
    stats = told(with_breaks([200])).stats
    assert stats is not None
    bad = LinkStats(bad_frames={"crc": 2, "cobs": 3, "partial": 9}, reconnects=1, overflow_bytes=4, refused=5)
    worse = msgspec.structs.replace(stats, link=bad, outputs={"mqtt": OutputStats(10, 7, 0)})
    rows = {label: (value, level) for label, value, level in facts.link(worse)}
    assert rows["CRC errors"] == ("2", "bad")
    assert rows["other bad frames"] == ("3 (cobs 3)", "bad")
    assert rows["reconnects"] == ("1", "bad")
    assert rows["bytes thrown away"] == ("4", "bad")
    assert rows["frames of another version"] == ("5", "bad")
    assert rows["dropped by output mqtt"] == ("7", "bad")
    assert rows["lost samples"] == ("0", "plain")
    assert facts.link(None) == []


def test_device_is_what_hello_says() -> None:
    rows = dict(facts.device(hello(sensor="MPU-9250", gyro_range_dps=2000.0), 31.256))
    assert rows["sensor"] == "MPU-9250 (WHO_AM_I 0x71)"
    assert rows["gyroscope range"] == "±2000 deg/s"
    assert rows["temperature"] == "31.26 °C"
    assert "protocol" not in rows, "what is not known is left out"


def test_everything_is_json_without_nan() -> None:
    history = told(with_breaks([60, 400]))
    told_all = [
        facts.axes(history),
        facts.axis(history, "gyro_x", 0),
        facts.link(history.stats),
        facts.events(history),
        facts.settings(history),
    ]
    json.dumps(told_all, allow_nan=False)
    assert facts.events(history)[0]["text"].startswith("epoch 2")


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.12345, "0.123"),
        (-2.5, "-2.500"),
        (999999.0, "999999.000"),
        (-1.25e6, "-1.250e+06"),
        (1.5e139, "1.500e+139"),
        (-0.0004, "-0.000"),
    ],
)
def test_figure(value: float, text: str) -> None:
    assert figure(value, 3) == text
    assert plus_minus(value, None) == text
    assert plus_minus(None, 1.0) == "–"


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0, "0 s"), (119, "119 s"), (120, "2 min"), (7199, "119 min"), (7200, "2 h"), (200_000, "2 days")],
)
def test_duration(seconds: int, text: str) -> None:
    assert duration(seconds) == text
