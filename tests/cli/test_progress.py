"""Tests of the progress bar: it appears only on a terminal, and only if a command takes long."""

import io
import sys
import threading
import time

import pytest
from fltea.cli import output

from tests.rig.host_support import wait_until


class Screen(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_nothing_is_drawn_of_what_is_soon_done(monkeypatch: pytest.MonkeyPatch) -> None:
    screen = Screen()
    monkeypatch.setattr(sys, "stderr", screen)
    with output.progress_bar(3) as show:
        show("first", advance=1)
        show("second", completed=2, total=4)
    assert screen.getvalue() == ""
    assert not any(
        isinstance(one, threading.Timer) and not one.finished.is_set() for one in threading.enumerate()
    )


def test_nothing_is_drawn_where_nobody_looks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(output, "BAR_AFTER_S", 0.0)
    screen = io.StringIO()
    monkeypatch.setattr(sys, "stderr", screen)
    with output.progress_bar(3) as show:
        show("first", advance=1)
    assert screen.getvalue() == ""


def test_a_bar_that_shows_itself_late_knows_how_far_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(output, "BAR_AFTER_S", 0.01)
    screen = Screen()
    monkeypatch.setattr(sys, "stderr", screen)
    with output.progress_bar(7) as show:
        show("one", advance=1)
        show("two\x1b[31m", advance=2)
        wait_until(lambda: "3/7" in screen.getvalue(), "the bar")
        show("three", completed=5, total=9)
        wait_until(lambda: "5/9" in screen.getvalue(), "the bar to go on")
    assert "\x1b[31m" not in screen.getvalue().replace("\x1b[31m━", "")
    assert "three" in screen.getvalue()


def test_a_bar_counts_from_the_beginning(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(output, "BAR_AFTER_S", 0.01)
    screen, begun_s = Screen(), time.monotonic()
    monkeypatch.setattr(sys, "stderr", screen)
    monkeypatch.setattr(output.time, "monotonic", lambda: begun_s - 3600)
    with output.progress_bar(2) as show:
        monkeypatch.undo()
        monkeypatch.setattr(sys, "stderr", screen)
        show("one", advance=1)
        wait_until(lambda: "1:00:0" in screen.getvalue(), "the time")
