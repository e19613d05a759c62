"""Tests that an impossible date of the machine is not used but reported, and damages no recording."""

import os
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
from fltea._native import PortReader, shift_unix_clock
from fltea.archive.info import summarise
from fltea.archive.record import record
from fltea.process.date_watch import DateWatch
from fltea.records import clock
from fltea.settings.config import load_configs
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.rig.mcap_support import files

NOW_NS = time.time_ns()
YEAR_NS = 31_556_952 * 10**9
WRONG_NS = {"2150": 124 * YEAR_NS, "2232, the last that Linux takes": 206 * YEAR_NS, "1960": -67 * YEAR_NS}


@pytest.fixture(params=[*WRONG_NS.values()], ids=[*WRONG_NS])
def wrong_clock(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(time, "time_ns", lambda: NOW_NS + request.param)
    shift_unix_clock(request.param)
    yield
    shift_unix_clock(0)


def native_offset_ns() -> int:
    """Return the offset from the host clock to Unix time [ns] that the native reading thread uses."""
    reader, (out, into) = PortReader(1000), os.pipe()
    with closing(reader):
        os.set_blocking(out, False)
        reader.add(0, out, True, 0)
        os.write(into, b"x")
        while not (found := reader.take(10)[1]):
            pass
        ((_, _, (_, _, offset_ns), _, _),) = found
    os.close(out)
    os.close(into)
    return int(offset_ns[0])


def test_a_date_that_can_be_is_believed() -> None:
    assert abs(clock.unix_ns() - time.time_ns()) < YEAR_NS // 1000
    assert clock.wrong_date() == ""
    assert abs(native_offset_ns() + clock.host_ns() - time.time_ns()) < YEAR_NS // 1000


@pytest.mark.usefixtures("wrong_clock")
def test_times_count_from_the_start_of_the_machine_where_its_date_cannot_be() -> None:
    assert (clock.unix_offset_ns(), native_offset_ns()) == (0, 0)
    assert "which cannot be right" in clock.wrong_date()


@pytest.mark.usefixtures("wrong_clock")
def test_what_is_recorded_then_is_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config = load_configs(None, {"record.folder": str(tmp_path), "pace": "fast"}, ["synthetic:?n=60"])[0]
    record(config, None)
    assert capsys.readouterr().err.count("clock_wrong: the machine's clock shows the year") == 1
    found = summarise(files(tmp_path), 100)
    assert (found.counts.delivered, found.whole, found.start_unix_ns) == (60, True, None)


def test_each_time_that_the_date_goes_wrong_is_reported_once(monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[str] = []
    watch, ahead_ns = DateWatch(lambda kind, text: told.append(kind)), 0
    monkeypatch.setattr(time, "time_ns", lambda: NOW_NS + ahead_ns)
    for years, expected in ((0, 0), (150, 1), (150, 1), (0, 1), (150, 2)):
        ahead_ns = years * YEAR_NS
        watch.check()
        assert told == ["clock_wrong"] * expected


@given(st.integers(-(2**63), 2**63 - 1))
@settings(max_examples=50)
def test_whatever_the_date_a_recording_can_hold_it(date_ns: int) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(time, "time_ns", lambda: date_ns)
        assert -clock.SECOND_NS < clock.unix_ns() < clock.END_OF_DATES_NS + YEAR_NS
        assert bool(clock.wrong_date()) == (clock.unix_offset_ns() == 0)
