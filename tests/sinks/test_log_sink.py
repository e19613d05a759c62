"""Tests of the log. It has one line per error, at a limited rate, and says how many errors were left out."""

import pytest
from fltea.records.records import Error, Gap
from fltea.sinks import log
from fltea.sinks.log import BURST, PERIOD_NS, LogSink


@pytest.fixture
def now(monkeypatch) -> list[int]:
    now_ns = [0]
    monkeypatch.setattr(log, "host_ns", lambda: now_ns[0])
    return now_ns


def test_one_line_each_with_the_device_where_there_are_several(now: list[int]) -> None:
    for several, prefix in ((False, "fltea: "), (True, "fltea: left: ")):
        lines: list[str] = []
        sink = LogSink(lines.append, several=several)
        sink.write(Error("silent", "two\nlines", 1, device="left"))
        sink.write(Gap(1, 2, 3, 4))
        sink.write(Error("state_failed", "of no device", 1))
        assert lines == [f"{prefix}silent: two lines\n", "fltea: state_failed: of no device\n"]


def test_a_flood_is_cut_by_kind_and_device_and_told(now: list[int]) -> None:
    lines: list[str] = []
    sink = LogSink(lines.append, several=True)
    for _ in range(BURST + 7):
        for device in ("left", "right"):
            sink.write(Error("device_fault", "again", 1, device=device))
    sink.write(Error("silent", "another kind", 1, device="left"))
    assert len(lines) == 2 * BURST + 1
    now[0] = PERIOD_NS - 1
    sink.flush()
    assert len(lines) == 2 * BURST + 1
    now[0] = PERIOD_NS
    sink.flush()
    told = [line for line in lines if "messages of this kind within a minute: 7." in line]
    assert len(told) == 2
    sink.write(Error("device_fault", "again", 1, device="left"))
    assert lines[-1] == "fltea: left: device_fault: again\n"


def test_what_was_left_out_is_told_at_the_end_and_before_the_next(now: list[int]) -> None:
    lines: list[str] = []
    sink = LogSink(lines.append, several=False)
    for _ in range(BURST + 1):
        sink.write(Error("silent", "text", 1))
    now[0] = PERIOD_NS + 5
    sink.write(Error("silent", "text", 1))
    assert "within a minute: 1." in lines[-2]
    for _ in range(BURST + 1):
        sink.write(Error("silent", "text", 1))
    sink.close()
    assert "within a minute: 2." in lines[-1]
