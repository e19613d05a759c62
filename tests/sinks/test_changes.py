"""Tests of steps of the bias and motions of the sensor.

The live page, the table and the log describe these events in the same words, and diagrams mark them.
"""

import re
import time
from collections.abc import Iterator

import pytest
from fltea.records.records import ACCEL_UNIT, Motion, Step
from fltea.sinks.changes import sentence, time_of
from fltea.sinks.log import BURST, LogSink
from fltea.sinks.page.happenings import Happenings
from fltea.sinks.page.marks import KEPT, MOST_SPANS, MOST_STEPS, Marks
from fltea.sinks.page.tiers import WINDOWS
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from tests.rig.dashboard_support import Reader, records, told
from tests.rig.example_records import MOVES, RESTS, STEP

S = 10**9
UNIX_NS = 1_817_035_387 * S
DOWN = replace(STEP, size=-0.0021, size_std=0.0004, unit=ACCEL_UNIT, axis="accel_x")


@pytest.mark.parametrize(
    ("record", "words", "with_time"),
    [
        (STEP, "gyro_x: step of +0.104 ± 0.022 deg/s", "gyro_x: step of +0.104 ± 0.022 deg/s at 12:03"),
        (DOWN, "accel_x: step of \u22120.00210 ± 0.00078 m/s²", None),
        (MOVES, "the sensor moves (shown by accel)", "the sensor moves since 12:03 (shown by accel)"),
        (replace(MOVES, by="caller"), "the sensor moves (as the caller says)", None),
        (
            RESTS,
            "the sensor is at rest again: it moved for 200 samples, at most by 12.3 deg/s",
            "the sensor is at rest again since 12:03: it moved for 200 samples, at most by 12.3 deg/s",
        ),
        (replace(RESTS, samples=None, largest=None), "the sensor is at rest again", None),
    ],
)
def test_a_sentence_for_each(record: Step | Motion, words: str, with_time: str | None) -> None:
    assert sentence(record) == words
    if with_time is not None:
        assert sentence(record, "12:03") == with_time


@pytest.fixture
def new_york(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setenv("TZ", "EST5")
    time.tzset()
    yield
    monkeypatch.undo()
    time.tzset()


@pytest.mark.usefixtures("new_york")
def test_the_time_is_that_of_the_place_or_since_the_beginning_of_a_recording() -> None:
    assert time_of(replace(STEP, host_ns=UNIX_NS)) == time.strftime(
        "%H:%M:%S", time.gmtime(UNIX_NS // S - 5 * 3600)
    )
    assert time_of(replace(STEP, host_ns=3787 * S + 999_999_999)) == "1:03:07"


def test_the_log_has_a_line_for_each_and_no_flood() -> None:
    lines: list[str] = []
    sink = LogSink(lines.append, several=True)
    sink.write(STEP)
    sink.write(replace(MOVES, by="\x1b[2J"))
    assert lines[0] == "fltea: due: gyro_x: step of +0.104 ± 0.022 deg/s at 0:00:07\n"
    assert lines[1] == "fltea: due: the sensor moves since 0:00:08 (shown by \\x1b[2J)\n"
    for _ in range(20):
        sink.write(STEP)
    assert len(lines) == 1 + BURST
    sink.close()
    assert lines[-1] == "fltea: due: step: further messages of this kind within a minute: 16.\n"


# --- the descriptions ---


def texts(*found: Motion) -> list[str]:
    happenings = Happenings()
    for record in found:
        happenings.motion(record)
    return [one.text for one in happenings]


def test_motions_without_anything_in_between_are_one_entry() -> None:
    assert texts(MOVES) == [sentence(MOVES)]
    assert texts(MOVES, RESTS) == [sentence(RESTS)]
    assert texts(MOVES, RESTS, MOVES) == [f"{sentence(MOVES)}; it moved once before"]
    twice = MOVES, RESTS, MOVES, replace(RESTS, samples=1_000, largest=3.0)
    assert texts(*twice) == ["the sensor moved 2 times: it moved for 1,200 samples, at most by 12.3 deg/s"]
    happenings = Happenings()
    happenings.motion(MOVES)
    happenings.gap(1, 2)
    happenings.motion(RESTS)
    assert [one.kind for one in happenings] == ["motion", "gap", "motion"]


# --- marks in the diagrams ---


def marks(*found: Step | Motion) -> Marks:
    made = Marks()
    for record in found:
        if isinstance(record, Step):
            made.step(record)
        else:
            made.motion(record, 100.0)
    return made


def test_a_figure_has_the_steps_of_its_axis_and_the_motions_of_the_sensor() -> None:
    made = marks(STEP, DOWN, MOVES, RESTS)
    assert made.within("gyro_x", 0, 30 * S) == {"steps": [(7_000, "+0.10")], "motion": [[8_000, 10_000]]}
    assert made.within("accel_x", 0, 30 * S)["steps"] == [(7_000, "\u22120.0021")]
    assert made.within("gyro_y", 0, 30 * S)["steps"] == []
    assert made.within("gyro_x", 9 * S, 39 * S) == {"steps": [], "motion": [[8_000, 10_000]]}
    assert made.within("gyro_x", 11 * S, 41 * S) == {"steps": [], "motion": []}


def test_a_motion_lasts_until_it_ends_or_its_end_cannot_be_known() -> None:
    assert marks(MOVES).within("gyro_x", 0, 30 * S)["motion"] == [[8_000, None]]
    assert marks(MOVES).within("gyro_x", 20 * S, 50 * S)["motion"] == [[8_000, None]]
    assert marks(RESTS).within("gyro_x", 0, 30 * S)["motion"] == [[8_000, 10_000]], "from its length"
    history = told(records("n=400"), [MOVES])
    assert history.marks.moving == MOVES
    history.missed(3)
    assert history.marks.moving is None


def test_an_epoch_ends_a_motion_and_forgets_what_is_later() -> None:
    made = marks(STEP, MOVES)
    made.begin(9 * S)
    assert made.within("gyro_x", 0, 30 * S) == {"steps": [(7_000, "+0.10")], "motion": [[8_000, 9_000]]}
    made.begin(1 * S)
    assert made.within("gyro_x", 0, 30 * S) == {"steps": [], "motion": []}
    history = told(records("n=400"), [MOVES])
    assert history.epoch.record is not None
    history.write(replace(history.epoch.record, epoch=2, host_ns=12 * S))
    assert history.marks.within("gyro_x", 0, 30 * S)["motion"] == [[8_000, 12_000]]


@given(st.lists(st.tuples(st.integers(1, 40 * S), st.integers(1, 5 * S)), max_size=2 * KEPT), st.booleans())
def test_never_more_than_a_figure_has_room_for(lengths: list[tuple[int, int]], lasts: bool) -> None:
    made, now_ns = Marks(), 0
    for still_ns, moving_ns in lengths:
        made.step(replace(STEP, host_ns=now_ns, size=still_ns * 1e-9))
        now_ns += still_ns
        made.motion(replace(MOVES, host_ns=now_ns), 100.0)
        now_ns += moving_ns
        made.motion(replace(RESTS, host_ns=now_ns), 100.0)
    if lasts:
        made.motion(replace(MOVES, host_ns=now_ns), 100.0)
    for window in WINDOWS:
        found = made.within("gyro_x", now_ns - int(window.length_s * S), now_ns)
        assert len(found["steps"]) <= MOST_STEPS
        assert len(found["motion"]) <= MOST_SPANS + 1
        assert found["steps"] == sorted(found["steps"])
        begins = [begin for begin, _ in found["motion"]]
        assert begins == sorted(begins)
        assert all(end is not None for _, end in found["motion"][:-1])
        assert bool(found["motion"] and found["motion"][-1][1] is None) == lasts


# --- the page ---


def test_the_page_says_what_the_bias_did_and_that_the_sensor_moves() -> None:
    found = records("n=400")
    history = told(found, [STEP, replace(STEP, host_ns=9 * S), DOWN, MOVES])
    reader = Reader(history)
    reader.read(axis="gyro_x", parts="axis now marks events axes")
    moves = ["the sensor moves since ", 8_000, " (shown by accel)"]
    steps = [["step of +0.104 ± 0.022 deg/s at ", time_ms, ""] for time_ms in (9_000, 7_000)]
    assert reader.parts["axis"]["changes"] == [moves, *steps]
    assert reader.parts["now"]["happened"] == sentence(MOVES)
    assert [one["kind"] for one in reader.parts["events"]][:4] == ["motion", "step", "step", "step"]
    rows = dict(map(tuple, reader.parts["axis"]["rows"]))
    assert rows["steps of the bias"] == "0"
    history.write(RESTS)
    reader.read(axis="gyro_x", parts="axis now")
    assert reader.parts["axis"]["changes"] == steps
    assert reader.parts["now"]["happened"] == sentence(RESTS)
    reader.read(axis="gyro_y", parts="axis")
    assert reader.parts["axis"]["changes"] == []


def test_marks_are_sent_when_there_are_new_ones_and_a_shaken_sensor_costs_little() -> None:
    """Marks of a sensor that is shaken all the time may cost the live page at most 3 kB/s. This is the size
    before compression, which reduces it to a third.
    """
    history = told(records("n=400"))
    reader = Reader(history)
    reader.read(axis="gyro_x", parts="marks", window=1)
    assert reader.parts["marks"] == {"steps": [], "motion": []}
    sample = history.sample
    assert sample is not None
    largest = 0
    for second in range(1, 200):
        now_ns = sample.host_ns + second * S
        history.write(replace(MOVES, host_ns=now_ns - S // 2))
        history.write(replace(RESTS, host_ns=now_ns))
        history.write(replace(STEP, host_ns=now_ns))
        history.write(replace(sample, host_ns=now_ns, seq=sample.seq + 100 * second))
        view = reader.state.view("due", "gyro_x", 1)
        reader.state._kept.clear()
        largest = max(largest, len(reader.state.read(view, {"marks": ""})))
        reader.read(axis="gyro_x", parts="marks", window=1)
        assert reader.read(axis="gyro_x", parts="marks", window=1)["parts"] == {}
    assert largest < 1_600
    assert re.fullmatch(r"[+\u2212][\d.]+", reader.parts["marks"]["steps"][0][1])
