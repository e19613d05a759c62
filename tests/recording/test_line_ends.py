"""Tests texts whose lines end in carriage returns, line feeds, or both."""

from pathlib import Path

import pytest
from fltea.recording.text_decoding import TextDecoder
from fltea.recording.text_rows import TextReader
from fltea.settings.how import How
from hypothesis import given
from hypothesis import strategies as st

from tests.rig.text_files import stored

LINES = ["time_s,gx [dps],gy [dps]", *(f"{k / 100:.2f},{k % 3},{k % 5}" for k in range(300))]


@pytest.mark.parametrize(
    "ends", [["\n"], ["\r"], ["\r\n"], ["\r\r\n"], ["\n\r"], ["\r"] * 99 + ["\n"], ["\n"] * 99 + ["\r"]]
)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_lines_may_end_in_any_way(ends: list[str], encoding: str, tmp_path: Path) -> None:
    text = "".join(line + ends[k % len(ends)] for k, line in enumerate(LINES))
    found = stored(tmp_path, text.encode(encoding))
    assert found.whole().gyro.tolist() == [[k % 3, k % 5] for k in range(300)]
    assert not found.notes


def plain_lines(text: bytes) -> list[bytes]:
    """Return the lines that are not empty."""
    return [line for line in text.replace(b"\r", b"\n").split(b"\n") if line]


@given(st.lists(st.sampled_from([b"a", b"b,1", b"\r", b"\n", b"\r\n"])), st.integers(1, 5))
def test_pieces_of_any_length_give_the_same_lines(parts: list[bytes], size: int) -> None:
    text = b"".join(parts)
    decoder = TextDecoder()
    pieces = [decoder.feed(text[k : k + size]) for k in range(0, len(text), size)]
    found = b"".join([*pieces, decoder.release(), decoder.finish()])
    assert [line.strip(b"\r") for line in found.split(b"\n") if line.strip(b"\r")] == plain_lines(text)
    assert TextDecoder().feed(text, hold=False).rstrip(b"\r\n") == found.rstrip(b"\r\n")


@pytest.mark.parametrize("end", ["\r", "\r\n", "\n"])
def test_a_live_text_has_a_row_at_each_line_end(end: str) -> None:
    """A carriage return waits for the next byte, since a line feed may follow."""
    reader = TextReader("x", How())
    counts = [sum(len(rows.values) for rows in reader.feed(f"{line}{end}".encode())) for line in LINES[:100]]
    assert sum(counts) == 98 + (end != "\r")
    assert sum(len(rows.values) for rows in reader.finish()) == (end == "\r")


def test_the_number_of_a_line_counts_carriage_returns(tmp_path: Path) -> None:
    lines = [*LINES[:100], "oops", *LINES[100:]]
    (note,) = stored(tmp_path, "\r".join(lines)).notes
    assert "rest.csv:101: " in note.text
