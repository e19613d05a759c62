"""Tests of the fleet's list of all sensors: which messages it accepts, how its size is limited, and what it
reports.
"""

import json

import msgspec
import pytest
from fltea.fleet import roll as rolls
from fltea.fleet.alerts import CHECKS, Alerts
from fltea.fleet.clock import Clock
from fltea.fleet.messages import KINDS
from fltea.fleet.roll import Roll
from fltea.fleet.summary import COLUMNS, Comparison, compare, counts, rows, table
from fltea.records.fit import AxisFit, FitAllan, Interval
from fltea.records.records import Fit
from hypothesis import given
from hypothesis import strategies as st

from tests.rig.example_records import STATS

HELLO = b'{"class":"hello","rate_hz":100.0,"sensor":"MPU-9250","boot_id":7}'
NOBODY = Comparison([], {})


def fit(seq: int = 1000, **axis: object) -> bytes:
    usual = AxisFit("white", "White noise.", "deg/s", R=Interval(0.01, 0.009, 0.011))
    one = msgspec.structs.replace(usual, **axis)
    return msgspec.json.encode(
        Fit(seq=seq, epoch=1, device_us=0, host_ns=0, samples=seq, axes={"gyro_x": one}, device="d")
    )


def status(text: str, reason: str | None = None) -> bytes:
    return json.dumps({"status": text, "source": "s", "device": "d", "reason": reason}).encode()


def test_what_a_sensor_says_is_kept() -> None:
    roll = Roll()
    curve = FitAllan([0.01, 1.0, 100.0], [0.5, 0.05, 0.0664], [0.4, 0.04, 0.05], [0.6, 0.06, 0.08], [1, 1, 1])
    curve = msgspec.structs.replace(curve, N=0.05, B=0.1)
    roll.take("fltea/a/hello", HELLO, 1.0)
    roll.take("fltea/a/fit", fit(allan=curve, verdict="drift"), 2.0)
    roll.take("fltea/a/fit", fit(1100, alpha=Interval(0.4, 0.3, 0.5)), 3.0)
    axis = roll.sensors["a"].axes["gyro_x"]
    assert axis.figures["N"] == pytest.approx([one / 2**0.5 for one in axis.figures["density"]])
    assert axis.figures["B"] == pytest.approx((0.1, 0.1 * 0.05 / 0.0664, 0.1 * 0.08 / 0.0664))
    assert axis.figures["density"][0] == pytest.approx((2 * 0.01 / 100) ** 0.5)
    assert "alpha" not in axis.figures  # the verdict is white, so there is no order, even if the fit has an α
    roll.take("fltea/a/fit", fit(1200, verdict="fractional", alpha=Interval(0.4, 0.36, 0.44)), 4.0)
    assert roll.sensors["a"].axes["gyro_x"].figures["alpha"] == (0.4, 0.36, 0.44)
    roll.take("fltea/a/fit", fit(1300, verdict="fractional", alpha=Interval(0.4, 0.3, 0.5)), 5.0)
    axis = roll.sensors["a"].axes["gyro_x"]
    assert ("alpha" in axis.figures, axis.figure("alpha")) == (False, (0.4, 0.3, 0.5)), "shown, not compared"
    assert rows(roll, NOBODY, 5.0)[0]["alpha"] == 0.4
    assert roll.sensors["a"].kind == "MPU-9250, 100 Hz"


def stats(bias: object, std: object = 0.003) -> bytes:
    axes = {name: {"tracker": {"bias": bias, "bias_std": std}} for name in ("gyro_x", "elsewhere")}
    return json.dumps({"samples": {"delivered": 7}, "axes": axes}).encode()


def test_what_a_daemon_says_of_steps_and_motion_is_no_hindrance() -> None:
    roll = Roll()
    roll.take("fltea/a/hello", HELLO, 1.0)
    roll.take("fltea/a/fit", fit(), 2.0)
    roll.take("fltea/a/stats", msgspec.json.encode(STATS), 3.0)
    tracker = STATS.axes["gyro_x"].tracker
    assert tracker is not None
    assert (tracker.steps, tracker.moving) == (3, True)
    assert roll.sensors["a"].axes["gyro_x"].shown["bias"][0] == tracker.bias
    assert not roll.bad
    assert not {"step", "motion"} & set(KINDS), "nobody asks the broker for them"


def test_the_bias_is_shown_beside_the_newest_fit_and_nobody_is_judged_by_it() -> None:
    roll = Roll()
    for number in range(20):
        name = f"fltea/{number}"
        roll.take(f"{name}/hello", HELLO, 1.0)
        roll.take(f"{name}/fit", fit(), 2.0)
        roll.take(f"{name}/stats", stats(50.0 if number == 7 else 0.25), 3.0)
        roll.take(f"{name}/fit", fit(1100), 4.0)
    seen = compare(roll, 4.0)
    assert seen.odd == []
    assert {group[2] for group in seen.usual} == {"density"}
    row = rows(roll, seen, 4.0)[7]
    assert COLUMNS[COLUMNS.index("verdict") + 1] == "bias"
    assert (row["bias"], row["bias_std"]) == (50.0, pytest.approx(0.003))
    assert set(roll.sensors["7"].axes) == {"gyro_x"}, "an axis without a fit is none"
    for nothing in (
        stats(None),
        stats(1, None),
        stats(1, -1),
        b'{"axes":{"gyro_x":{"tracker":null}}}',
        b"{}",
    ):
        roll.take("fltea/7/stats", stats(50.0), 5.0)
        roll.take("fltea/7/stats", nothing, 5.0)
        assert rows(roll, seen, 5.0)[7]["bias"] is None


@pytest.mark.slow
@given(st.text(max_size=80), st.one_of(st.binary(max_size=300), st.sampled_from([HELLO, fit(), b"{}"])))
def test_any_message_at_all(topic: str, payload: bytes) -> None:
    roll = Roll()
    for name in (topic, f"fltea/{topic}/fit", f"fltea/x/{topic}", *(f"fltea/x/{kind}" for kind in KINDS)):
        roll.take(name, payload, 0.0)
    assert len(roll.sensors) <= 2
    assert all(len(name) <= 64 for name in roll.sensors)
    msgspec.json.encode(counts(roll, 0.0))


@pytest.mark.parametrize(
    ("topic", "payload", "reason"),
    [
        ("fltea/a", b"{}", "topic"),
        ("fltea/a/b/fit", b"{}", "topic"),
        ("fltea/" + "a" * 65 + "/fit", b"{}", "topic"),
        ("fltea/a\x1bb/fit", fit(), "topic"),
        ("fltea/a/estimate", b"{}", "topic"),
        ("fltea/a/fit", b"{" + b" " * (1 << 20) + b"}", "too_long"),
        ("fltea/a/fit", b"[" * 10_000, "content"),
        ("fltea/a/fit", fit(verdict="white")[:-1], "content"),
        ("fltea/a/fit", fit().replace(b"gyro_x", b"<script>"), "content"),
        ("fltea/a/fit", fit().replace(b'"deg/s"', b'"<b>"'), "content"),
        ("fltea/a/hello", b'{"rate_hz":"fast"}', "content"),
        ("fltea/a/fit", b'{"seq":0,"epoch":1,"samples":1' + b"0" * 30 + b',"axes":{}}', "content"),
        ("fltea/a/fit", b'{"seq":0,"epoch":1,"samples":-1,"axes":{}}', "content"),
    ],
)
def test_bad_messages_are_counted_by_their_reason(topic: str, payload: bytes, reason: str) -> None:
    roll = Roll()
    assert roll.take(topic, payload, 0.0) is None
    assert (roll.bad, roll.sensors) == ({reason: 1}, {})


def known(roll: Roll, name: str, text: str = "online", reason: str | None = None, now: float = 0.0) -> None:
    """Let a sensor of the list say which device it is, and state its status."""
    roll.take(f"fltea/{name}/hello", HELLO, now)
    roll.take(f"fltea/{name}/status", status(text, reason), now)


def test_a_verdict_of_another_version_is_one_of_a_few() -> None:
    roll = Roll()
    known(roll, "a")
    for number in range(100):
        roll.take("fltea/a/fit", fit(1000 + number, verdict=f"made up {number}"), 1.0)
    assert counts(roll, 1.0)["axes"] == {"other": 1}


def test_texts_are_one_printable_line_and_bounded() -> None:
    roll = Roll()
    known(roll, "a", "offline", "\x1b[2J" + "x" * 10_000)
    roll.take(
        "fltea/a/error", json.dumps({"kind": "k" * 999, "message": "a\0b\n" + "c" * 9999}).encode(), 0.0
    )
    roll.take("fltea/a/fit", fit(text="t\n" + "u" * 9999), 0.0)
    sensor = roll.sensors["a"]
    assert sensor.status is not None
    texts = [sensor.status.reason or "", *sensor.errors[0][1:], sensor.axes["gyro_x"].text]
    assert all(text.isprintable() for text in texts)
    assert [len(text) for text in texts] == [100, 100, 2000, 2000]


def test_a_flood_of_names_takes_nobodys_place_and_is_named() -> None:
    roll = Roll(most=10)
    known(roll, "real")
    for number in range(10_000):
        roll.take(f"fltea/n{number}/status", status("online"), number * 1e-4)
    assert (list(roll.sensors), len(roll.candidates), roll.refused) == (["real"], 10, 9_990)
    assert list(roll.refused_names) == [f"n{number}" for number in range(9_985, 9_990)]
    assert roll.take("fltea/real/status", status("stalled"), 2.0) is not None
    known(roll, "n9999")
    assert list(roll.sensors) == ["real", "n9999"]
    assert len(roll.forget(200.0, 1e6)) == 9
    assert (roll.refused, len(roll.candidates)) == (9_999, 0)


def test_one_thing_said_again_and_again_makes_no_sensor() -> None:
    """A name counts as a sensor only when two kinds of messages, or two different fits, have come under it.

    A repeated message proves nothing, since the broker sends its retained messages at every request.
    """
    roll = Roll()
    for _ in range(10):
        roll.take("fltea/a/hello", HELLO, 0.0)
        roll.take("fltea/b/status", status("online"), 0.0)
        roll.take("fltea/b/stats", b"{}", 0.0)
        roll.take("fltea/c/fit", fit(), 0.0)
    assert roll.sensors == {}
    roll.take("fltea/c/fit", fit(1001), 0.0)
    assert list(roll.sensors) == ["c"]


def test_a_full_roll_makes_room_by_those_who_are_silent_longest() -> None:
    roll = Roll(most=3)
    for number in range(3):
        known(roll, f"n{number}", now=float(number))
        roll.take(f"fltea/n{number}/fit", fit(), float(number))
    known(roll, "late", now=10.0)
    assert (roll.refused, "late" in roll.sensors) == (2, False)
    assert roll.forget(1000.0, 1e6) == []  # no sensor has been silent for long, so none is forgotten
    assert roll.forget(4000.0, 1e6) == ["n0"]
    known(roll, "late", now=4000.0)
    assert list(roll.sensors) == ["n1", "n2", "late"]
    assert roll.forget(8000.0, 1e6) == ["late"]  # this sensor is forgotten first, because it never had a fit


def test_a_sensor_that_floods_is_named_until_it_stops() -> None:
    roll = Roll()
    known(roll, "a")
    for number in range(1000):
        roll.take("fltea/a/status", status("online"), number * 1e-3)
        roll.take("fltea/b/status", status("online"), float(number))
    assert counts(roll, 1000.0)["flooding"] == ["a"]
    roll.take("fltea/a/status", status("online"), 20.0)
    roll.take("fltea/a/status", status("online"), 40.0)
    assert counts(roll, 1000.0)["flooding"] == []
    for number in range(1000):
        roll.take("fltea/stranger/status", status("online"), 50 + number * 1e-3)
    assert counts(roll, 1000.0)["flooding"] == ["stranger"]
    alerts = Alerts()
    told = [alerts.update(roll, NOBODY, 51.0, 0.0) for _ in range(CHECKS)][-1]
    assert [(alert.kind, alert.device_id) for alert in told] == [("flood", "stranger")]


def test_two_programs_under_one_name() -> None:
    """If two programs use one name, their fits alternate, so the numbers of samples decrease repeatedly. A
    restart of one program decreases the number once.
    """
    roll = Roll()
    for turn in range(4):
        roll.take("fltea/a/fit", fit(1000 + turn), turn * 10.0)
        roll.take("fltea/a/fit", fit(90_000 + turn), turn * 10.0 + 5)
    roll.take("fltea/b/fit", fit(1000), 1.0)
    roll.take("fltea/b/fit", fit(10), 2.0)
    assert counts(roll, 40.0)["twins"] == ["a"]
    assert counts(roll, 4000.0)["twins"] == []


def test_states() -> None:
    roll = Roll()
    roll.take("fltea/a/hello", HELLO, 0.0)
    roll.take("fltea/a/fit", fit(), 0.0)
    assert roll.sensors["a"].state(1.0) == "unknown"
    roll.take("fltea/a/status", status("online"), 0.0)
    assert [roll.sensors["a"].state(now) for now in (1.0, 89.0, 91.0)] == ["online", "online", "silent"]
    roll.take("fltea/a/status", status("offline", "ended"), 0.0)
    assert roll.sensors["a"].state(1000.0) == "offline"
    assert roll.forget(99.0, 100.0) == []
    assert roll.forget(101.0, 100.0) == ["a"]
    # an empty message, as it comes when a retained message is deleted
    assert roll.take("fltea/a/status", b"", 2.0) is None


def test_silence_and_a_loss_are_alerts_and_an_orderly_end_is_none() -> None:
    roll, alerts = Roll(), Alerts()
    for name, text, reason in (
        ("a", "online", None),
        ("b", "offline", "ended"),
        ("c", "offline", "connection_lost"),
    ):
        known(roll, name, text, reason)
    for _ in range(CHECKS):
        told = alerts.update(roll, NOBODY, 100.0, 0.0)
    assert [(alert.kind, alert.device_id) for alert in told] == [("silent", "a"), ("offline", "c")]


def test_alerts_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fltea.fleet.alerts.MOST", 5)
    monkeypatch.setattr("fltea.fleet.alerts.LISTED", 2)
    roll, alerts = Roll(), Alerts()
    for number in range(8):
        known(roll, str(number))
    for _ in range(CHECKS):
        told = alerts.update(roll, NOBODY, rolls.SILENT_S + 1, 0.0)
    assert (len(told), alerts.dropped) == (5, 3)
    listed = alerts.listed()
    assert (listed.count, listed.dropped, [one["device_id"] for one in listed.alerts]) == (5, 3, ["4", "3"])


@pytest.mark.parametrize(
    ("words", "count"),
    [
        ("line", 4),  # all four devices, since the words "online" and "offline" contain "line"
        ("state:online", 3),
        ("state:line", 0),
        ('verdict:"line or resonance"', 1),
        ("verdict:line", 1),
        ("verdict:line state:online", 1),
        ("state:offline d", 1),
        ('axis:"gyro_x" b', 1),
    ],
)
def test_words_that_name_a_column_compare_the_whole_entry(words: str, count: int) -> None:
    roll = Roll()
    for name, verdict in (("a", "line"), ("b", "line or resonance"), ("c", "white"), ("d", "drift")):
        known(roll, name, "offline" if name == "d" else "online")
        roll.take(f"fltea/{name}/fit", fit(verdict=verdict), 0.0)
    assert table(rows(roll, NOBODY, 1.0), "device", "up", words, 0, 50)[0] == count


def test_nobody_is_silent_whom_nobody_could_hear() -> None:
    times = {"steady": 0.0}
    clock, roll = Clock(lambda: 0.0, lambda: times["steady"]), Roll()
    times["steady"] = 50.0
    # this clock stands still, because the fleet is not connected to the broker yet
    assert clock.hearing() == 0.0
    clock.hear(True)
    known(roll, "a", now=clock.hearing())
    times["steady"] = 60.0
    clock.hear(False)
    times["steady"] = 1000.0
    clock.hear(False)
    assert (clock.hearing(), roll.sensors["a"].state(clock.hearing())) == (10.0, "online")
    clock.hear(True)
    times["steady"] = 1079.0
    assert roll.sensors["a"].state(clock.hearing()) == "online"
    times["steady"] = 1081.0
    assert roll.sensors["a"].state(clock.hearing()) == "silent"
