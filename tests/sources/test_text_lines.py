"""Tests events of live text in simulated time: sample numbers, times, gaps, restarts, reported errors."""

import os
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
import pytest
from fltea.records.errors import UsageError
from fltea.records.events import TIME_WRAP_US, Event, Failed, LinkDown, RawBlock, Tick, Trouble
from fltea.records.records import Hello
from fltea.settings.how import How
from fltea.sources.text_events import TextEvents
from fltea.sources.text_lines import PipeText, SerialText, parse_serial

from tests.rig.blocks import of, track_events

S = 10**9
RATE = How(columns=["gx"], rate_hz=100.0, units="dps")
TIMES = How(columns=["gx"], time_column="t_ms", units="dps")


def opened(how: How) -> TextEvents:
    text = TextEvents("stdin:", how, fatal=False)
    text.open(0, within_line=False)
    return text


def troubles(events: list[Event]) -> list[str]:
    return [event.kind for event in of(Trouble, events)]


def the_trouble(events: Iterable[Event]) -> Trouble:
    (found,) = of(Trouble, events)
    return found


def steady(
    text: TextEvents, first: int, last: int, late_s: float = 0.0, rate_hz: float = 100.0
) -> list[Event]:
    """Feed the lines of samples `first` to `last` - 1 to `text`, each at its time, and return the events."""
    return [
        event
        for k in range(first, last)
        for event in text.feed(b"%d\n" % (k % 7), round((k / rate_hz + late_s) * S))
    ]


def test_order_numbers_the_samples_and_a_bad_line_is_a_lost_one() -> None:
    text = opened(RATE)
    events = list(text.feed(b"gx\n1\n2\nx\n3x\n5\n", 7))
    (hello,), (block,), trouble = of(Hello, events), of(RawBlock, events), the_trouble(events)
    assert (hello.source, hello.rate_hz, hello.gyro_lsb_per_dps) == ("stdin:", 100.0, None)
    assert block.sequence.tolist() == [0, 1, 3]
    assert block.device_us.tolist() == [0, 10_000, 30_000]
    assert block.host_ns.tolist() == [7, 7, 7]
    assert (trouble.kind, trouble.fatal) == ("bad_lines", False)
    assert "2 lines hold no sample" in trouble.message
    assert "'3x'" in trouble.message
    place = track_events(events)[0]
    assert (place.delivered, place.lost) == (3, 1)
    stats = text.link_stats()
    assert (stats.frames, stats.bad_frames) == (3, {"text": 1, "number": 1})


def test_a_comment_whose_unit_is_not_understood_is_reported_once() -> None:
    """Its rows are read as before."""
    text = opened(TIMES)
    data = [b"t_ms,gx\n", *(b"%d,%d\n" % (10 * k, k % 3) for k in range(100))]
    events = list(text.feed(b"".join(data), 0))
    assert troubles(events) == []
    later = list(text.feed(b"# now the other values in g\n1000,1\n1010,2\n", S))
    assert "the rows below this comment are read as before" in the_trouble(later).message
    assert troubles(list(text.feed(b"1020,1\n1030,2\n", S))) == []


def test_what_a_stranger_sends_cannot_steer_a_terminal() -> None:
    assert the_trouble(opened(RATE).feed(b"gx\n1\n1\x1b[2J\xe2\x80\xae\n", 0)).message.isprintable()


def test_times_number_the_samples_and_find_the_rate() -> None:
    lines = [b"%d,%d\n" % (5000 + k * 4, k % 7) for k in range(600) if k not in (150, 151)]
    events = list(opened(TIMES).feed(b"t_ms,gx\n" + b"".join(lines), 0))
    assert of(Hello, events)[0].rate_hz == pytest.approx(250.0)
    place = track_events(events)[0]
    assert (place.delivered, place.lost, place.gaps) == (598, 2, 1)


@pytest.mark.parametrize("rate_hz", [10.0, 104.0, 800.0, 8000.0])
def test_the_rate_is_found_whatever_the_grain_of_the_times(rate_hz: float) -> None:
    unit, scale = ("ms", 1e3) if rate_hz < 1000 else ("us", 1e6)
    text = opened(How(columns=["gx"], time_column="t", time_unit=unit, units="dps"))  # type: ignore[arg-type]
    lines = [b"%d %d\n" % (k / rate_hz * scale, k % 7) for k in range(1000)]
    events = [*text.feed(b"t gx\n" + b"".join(lines[:120]), 0), *text.feed(b"".join(lines[120:]), S)]
    events += text.finish(S)
    assert of(Hello, events)[0].rate_hz == pytest.approx(rate_hz, rel=0.01)
    assert track_events(events)[0].delivered == 1000
    assert track_events(events)[0].lost == 0
    assert troubles(events) == []


def test_one_time_twice_is_one_sample() -> None:
    text = opened(TIMES)
    events = list(text.feed(b"t_ms,gx\n" + b"".join(b"%d,1\n" % (k // 2 * 10) for k in range(600)), 0))
    assert track_events(events)[0].delivered == 300
    assert text.link_stats().bad_frames == {"duplicate_time": 300}


def test_times_of_arrival_are_told_from_a_devices() -> None:
    rng = np.random.default_rng(1)
    times = np.cumsum(rng.exponential(10.0, 200))
    lines = b"".join(b"%.3f,1\n" % time for time in times)
    text = opened(TIMES)
    assert troubles(list(text.feed(b"t_ms,gx\n" + lines, 0))) == ["no_rate"]
    with pytest.raises(UsageError, match="too uneven for a sensor's clock"):
        list(text.finish(0))
    with_rate = opened(How(columns=["gx"], time_column="t_ms", rate_hz=100.0, units="dps"))
    events = [*with_rate.feed(b"t_ms,gx\n" + lines, 0), *with_rate.finish(0)]
    assert troubles(events) == ["row_times"]
    assert (track_events(events)[0].delivered, track_events(events)[0].lost) == (200, 0)


def test_times_in_another_unit_than_the_given_one_are_told_and_counted() -> None:
    text = opened(How(columns=["gx"], time_column="t", time_unit="ns", units="dps"))
    events = list(text.feed(b"t,gx\n", 0))
    for k in range(1200):  # the times are in seconds, but are wrongly read as nanoseconds
        events += text.feed(b"%.3f,1\n" % (k / 100), k * S // 100)
    trouble = the_trouble(events)
    assert trouble.kind == "no_rate"
    assert "--time-unit" in trouble.message
    assert text.link_stats().bad_frames["no_rate"] > 900


def test_samples_lost_on_the_way_are_told_and_not_guessed() -> None:
    text = opened(RATE)
    events = [*text.feed(b"gx\n", 0), *steady(text, 0, 1000), *steady(text, 1000, 1500, late_s=0.8)]
    trouble = the_trouble(events)
    assert trouble.kind == "arrival_jump"
    assert "about 80 were lost" in trouble.message
    assert track_events(events)[0].lost == 0


def test_a_buffer_explains_samples_that_come_late_and_then_all_at_once() -> None:
    text = opened(RATE)
    events = list(text.feed(b"gx\n", 0)) + steady(text, 0, 1000)
    # the sender was stalled for 2 s
    events += text.feed(b"".join(b"%d\n" % (k % 7) for k in range(1000, 1200)), 12 * S)
    events += steady(text, 1200, 2000)
    for begin in range(2000, 6000, 250):  # the sender now writes a full buffer of 250 lines at a time
        lines = b"".join(b"%d\n" % (k % 7) for k in range(begin, begin + 250))
        events += text.feed(lines, (begin + 250) * S // 100)
    assert troubles(events) == []


def test_another_rate_than_the_given_one_is_told_once() -> None:
    text = opened(RATE)
    events = [*text.feed(b"gx\n", 0), *steady(text, 0, 5000, rate_hz=104.0)]
    trouble = the_trouble(events)
    assert trouble.kind == "rate_differs"
    assert "at 104 Hz" in trouble.message


def test_after_a_long_pause_the_numbers_begin_again() -> None:
    text = opened(RATE)
    events = [*text.feed(b"gx\n1\n2\n", 0), *text.feed(b"3\n4\n", 400 * S)]
    place = track_events(events)[0]
    assert (place.delivered, place.before_hello) == (4, 0)


def test_silence_is_told_once_a_minute() -> None:
    text = opened(RATE)
    events = [event for k in range(1, 40) for event in text.tick(k * S // 2)]
    assert troubles(events) == ["silent"]
    assert sum(isinstance(event, Tick) for event in events) == 39


def test_the_reason_is_only_looked_for_when_it_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """The search for the reason examines all lines so far, and reading rubbish must not wait for it."""
    looked: list[int] = []
    why_none = TextEvents._why_none
    monkeypatch.setattr(TextEvents, "_why_none", lambda text: looked.append(1) or why_none(text))
    text = opened(RATE)
    for k in range(100):
        list(text.feed(b"time;roll;pitch\n" * 25, k * S))
    assert len(looked) == 2  # once a minute


def test_a_stall_of_the_program_is_no_silence_of_the_sender() -> None:
    text = opened(RATE)
    events = [*text.tick(S // 2), *text.tick(8 * S)]  # the program was stopped, or the computer slept
    assert troubles(events) == []
    events = [event for k in range(17, 27) for event in text.tick(k * S // 2)]
    assert troubles(events) == ["silent"]


def test_lines_without_the_columns_are_told() -> None:
    events = list(opened(RATE).feed(b"time;roll;pitch\n" * 25, 0))
    trouble = the_trouble(events)
    assert trouble.kind == "no_columns"
    assert "no column gx (it has: time, roll, pitch)" in trouble.message


@pytest.mark.parametrize(
    ("how", "data", "words"),
    [
        (RATE, b"", "It was empty"),
        (RATE, b"a,b\n1,2\n", "no column gx (it has: a, b)"),
        (RATE, b"gx\n", "has a header but no rows"),
        (RATE, b"gx\nx\n", "column 'gx': 'x' is not a number"),
        (RATE, b"gx\n,\n", "an empty field"),
        (TIMES, b"t_ms,gx\n1,2\n", "does not show it"),
        (How(), b"gyro_x_dps\n1\n", "there is no column of times"),
    ],
)
def test_an_input_without_samples_is_an_error(how: How, data: bytes, words: str) -> None:
    text = opened(how)
    with pytest.raises(UsageError) as caught:
        list(text.feed(data, 0)) + list(text.finish(0))
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("how", "words"),
    [
        (How(rate_hz=1e9), "no gyroscope"),
        (How(columns=["a", "a"]), "named twice"),
        (How(columns=["a"], time_column="a"), "named twice"),
        (How(columns=["a", "b", "c", "d"]), "up to 3"),
        (How(columns=["a"], units="furlong"), "not a unit"),
    ],
)
def test_settings_that_do_not_do(how: How, words: str) -> None:
    with pytest.raises(UsageError, match=words):
        TextEvents("stdin:", how, fatal=False)


def test_urls_of_ports() -> None:
    assert parse_serial("/dev/ttyUSB0") == ("/dev/ttyUSB0", 115_200)
    assert parse_serial("/dev/ttyUSB0?baud=9600") == ("/dev/ttyUSB0", 9600)
    assert parse_serial("hwgrep://x?y") == ("hwgrep://x?y", 115_200)
    for wrong in ("/dev/ttyUSB0?speed=9600", "/dev/ttyUSB0?baud=fast", "/dev/ttyUSB0?baud="):
        with pytest.raises(UsageError, match="baud=115200"):
            parse_serial(wrong)


def test_a_fifo_gives_samples_as_they_come_and_ends_with_its_sender(fifo: Path) -> None:
    source = PipeText(str(fifo), RATE)
    events = source.events()
    with fifo.open("wb", buffering=0) as sender:
        sender.write(b"gx\n1\n2\n")
        assert isinstance(next(events), Hello)
        first = next(events)
        sender.write(b"3\n4")
        second = next(events)
    last = list(events)
    assert [block.gyro.ravel().tolist() for block in of(RawBlock, [first, second, *last])] == [
        [1, 2],
        [3],
        [4],
    ]
    assert source.link_stats().frames == 4


def test_no_such_fifo() -> None:
    with pytest.raises(UsageError, match="cannot be read"):
        PipeText("/none/pipe", RATE)


def until(events: Iterator[Event], kind: type[Event]) -> list[Event]:
    found = []
    for event in events:
        found.append(event)
        if isinstance(event, kind):
            break
    return found


def test_a_port_is_read_from_its_first_whole_line_and_told_when_it_vanishes() -> None:
    controller, port = os.openpty()
    source = SerialText(f"{os.ttyname(port)}?baud=115200", RATE)
    events = source.events()
    assert isinstance(next(events), Tick)  # `Tick` (nothing has arrived) shows that the port is open
    os.write(controller, b"9\n1\n2\n")  # "9" may be the end of a longer number, so it is left out
    found = until(events, RawBlock)
    assert of(RawBlock, found)[-1].gyro.ravel().tolist() == [1, 2]
    os.close(port)
    os.close(controller)
    found = until(events, Trouble)
    assert any(isinstance(event, LinkDown) for event in found)
    assert troubles(found) == ["unplugged"]
    source.close()


def test_a_port_that_is_back_begins_a_new_run() -> None:
    text = TextEvents("serial-text:/dev/x", RATE, fatal=True)
    text.open(0, within_line=True)
    events = list(text.feed(b"x\ngx\n1\n2\n", 1))
    events += text.lost(Failed("unplugged", "gone", 2))
    text.open(3, within_line=True)
    events += text.feed(b"77\n3\n4\n", 4)
    place = track_events(events)[0]
    assert (place.delivered, place.before_hello) == (4, 0)
    assert len({hello.boot_id for hello in of(Hello, events)}) == 2
    assert text.link_stats().reconnects == 1
    assert text.link_stats().bad_frames == {"partial": 2}


def test_parts_of_lines_at_the_ends_of_a_connection_are_counted() -> None:
    text = TextEvents("serial-text:/dev/x", RATE, fatal=True)
    text.open(0, within_line=True)
    for data in (b"0.", b"75", b"\ngx\n1\n2\n-0."):  # the first line has lost its beginning, the last its end
        list(text.feed(data, 1))
    assert text.link_stats().bad_frames == {"partial": 1}
    text.open(2, within_line=True)
    list(text.feed(b"\r\n3\n", 3))  # of this line only the end is missing, which holds nothing
    assert text.link_stats().bad_frames == {"partial": 2}
    assert text.link_stats().damaged == {}


def test_hours_that_come_at_once_are_taken_one_by_one() -> None:
    """Device time wraps after 71 minutes. Here one read has lines of eight hours, ten seconds apart. They are
    divided into blocks that are shorter than half of the 71 minutes.
    """
    text = opened(
        How(columns=["gx"], rate_hz=None, time_column="t", time_unit="s", units="dps", overrule=True)
    )
    lines = "".join(f"{10 * k},{k % 7}\n" for k in range(3000))
    events = list(text.feed(b"t,gx\n" + lines.encode(), 7)) + list(text.finish(8))
    assert (track_events(events)[0].delivered, track_events(events)[0].lost) == (3000, 0)
    longest_us = max(int((np.diff(block.device_us) % TIME_WRAP_US).sum()) for block in of(RawBlock, events))
    assert longest_us < TIME_WRAP_US // 2
