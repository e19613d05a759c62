"""Tests that control characters in text from a board or a file never reach a terminal."""

import unicodedata

import pytest
from fltea.records.visible import visible, visible_lines
from hypothesis import example, given
from hypothesis import strategies as st

HARMFUL = ("\x1b[31m", "\a", "\r\n", "\x7f", "\x9b2J", "\u202etxt.exe", "\u2066", "\u2028", "\ud800", "\0")


@given(st.text(st.characters()))
@example("".join(HARMFUL))
def test_nothing_steers_and_nothing_is_lost(text: str) -> None:
    shown = visible(text)
    assert shown.isprintable()
    assert not {"Cc", "Cf", "Cs", "Zl", "Zp"} & {unicodedata.category(c) for c in shown}
    assert [c for c in text if c.isprintable()] == [c for c in text if visible(c) == c]
    assert "".join(map(visible, text)) == shown


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("gyro α, ±2000 °/s, 中", "gyro α, ±2000 °/s, 中"),
        ("\x1b]0;x\a", r"\x1b]0;x\x07"),
        ("one\ntwo\t", r"one\ntwo\t"),
        ("a\u202eb", r"a\u202eb"),
        ("\x9b", r"\x9b"),
    ],
)
def test_what_is_shown(text: str, shown: str) -> None:
    assert visible(text) == shown


def test_lines_of_ours_stay_lines() -> None:
    assert visible_lines("one\ntwo\x1b\n") == "one\ntwo\\x1b\n"
