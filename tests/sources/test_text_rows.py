"""Lines of text as rows: any bytes, cut anywhere, against a plain decoder of one line after the other."""

import json
import math
from itertools import pairwise

import numpy as np
import pytest
from fltea.records.errors import UsageError
from fltea.sources.text_rows import LONGEST_LINE, LineRows, Rows, wanted
from hypothesis import given
from hypothesis import strategies as st

NAMES = ["gx", "gy"]


def rows_of(parser: LineRows, *parts: bytes) -> list[tuple[int, list[float], float | None]]:
    found: list[tuple[int, list[float], float | None]] = []
    last: list[Rows | None] = [parser.feed(part) for part in parts]
    for rows in [*last, parser.finish()]:
        if rows is not None:
            times = [None] * len(rows.values) if rows.time is None else rows.time.tolist()
            found += zip(rows.ordinal.tolist(), rows.values.tolist(), times, strict=True)
    return found


def plain(lines: list[bytes]) -> list[tuple[int, list[float], float | None]]:
    """What the fields t,gx,gy hold, one line after the other, by the simplest means."""
    number = 0
    found: list[tuple[int, list[float], float | None]] = []
    for line in lines:
        text = line.strip()
        if not text or text.startswith((b"#", b"%", b"//")):
            continue
        if text[:1] not in b'0123456789+-.,;"{' and text[:3].lower() != b"nan":
            continue
        fields = line.split(b",")
        if len(fields) == 4 and not fields[3].strip():
            fields.pop()
        try:
            values = [float(field) for field in fields]
        except ValueError:
            values = []
        good = len(values) == 3 and b"_" not in line and all(map(math.isfinite, values))
        if good and abs(values[0]) <= 2.0**53 * 1e3 and max(abs(values[1]), abs(values[2])) <= 1e6:
            found.append((number, values[1:], values[0]))
        number += 1
    return found


FIELD = st.one_of(
    st.floats(width=32).map(lambda x: repr(x).encode()),
    st.integers(-(10**7), 10**7).map(lambda n: b"%d" % n),
    st.sampled_from(
        [b"", b" ", b"nan", b"x", b"1_0", b" 3 ", b"inf", b"1e999", b"-0", b'"4"', b"\xff", b"\0"]
    ),
)
GOOD = st.tuples(*[st.integers(-999, 999).map(lambda n: b"%d" % n)] * 3).map(b",".join)
LINE = st.one_of(
    GOOD,
    st.lists(FIELD, min_size=1, max_size=5).map(b",".join),
    st.binary(max_size=12),
    st.just(b"# a remark"),
)


@given(st.lists(LINE, max_size=12), st.lists(st.integers(0, 200), max_size=6), st.booleans())
def test_any_lines_cut_anywhere_are_what_a_plain_decoder_reads(
    lines: list[bytes], cuts: list[int], windows: bool
) -> None:
    lines = [part for line in lines for part in line.split(b"\n")]
    text = b"t,gx,gy\n" + b"".join(line + (b"\r\n" if windows else b"\n") for line in lines)
    places = [0, *sorted(min(cut, len(text)) for cut in cuts), len(text)]
    parts = [text[a:b] for a, b in pairwise(places)]
    assert rows_of(LineRows(wanted(NAMES, None, "t")), *parts) == plain(lines)


@given(st.lists(st.binary(max_size=40) | LINE, max_size=20))
def test_nothing_that_a_stranger_sends_ends_the_reading(parts: list[bytes]) -> None:
    for names in (NAMES, ["1", "2"], None):
        parser = LineRows(wanted(names, "rad/s", None))
        for _, values, _ in rows_of(parser, *parts):
            assert all(map(math.isfinite, values))
        if parser.newest is not None:
            assert parser.newest[1].isprintable()


@pytest.mark.parametrize("separator", [",", ";", "\t", " ", ", "])
@pytest.mark.parametrize("header", ["t{}gx{}gy", "# t{}gx{}gy", '"t"{}"gx"{}"gy"', "\ufefft{}gx{}gy"])
def test_the_header_tells_the_separator_and_may_come_after_messages(separator: str, header: str) -> None:
    text = "IMU ready\n\n" + header.replace("{}", separator) + "\n" + separator.join(("0.5", "1", "2")) + "\n"
    parser = LineRows(wanted(NAMES, None, "t"))
    assert rows_of(parser, text.encode()) == [(0, [1.0, 2.0], 0.5)]
    assert parser.counts == {"before_header": 1}


def test_without_a_header_positions_or_as_many_fields_as_names() -> None:
    assert rows_of(LineRows(wanted(["3", "1"], None, None)), b"1 2 3\n") == [(0, [3.0, 1.0], None)]
    assert rows_of(LineRows(wanted(["2"], None, "1")), b"7;8\n") == [(0, [8.0], 7.0)]
    assert rows_of(LineRows(wanted(NAMES, None, None)), b"1,2\n3,4\n") == [
        (0, [1.0, 2.0], None),
        (1, [3.0, 4.0], None),
    ]
    assert rows_of(LineRows(wanted(NAMES, None, None)), b"1,2,3\n") == []
    assert rows_of(LineRows(wanted(None, None, None)), b"1,2,3\n") == []


def test_a_line_that_looks_like_a_sample_takes_a_number_and_a_message_takes_none() -> None:
    text = b"gx,gy\n1,2\n1,\nhello\n3\n1,2x\nnan,1\n9e9,1\n# remark\n5,6\n"
    parser = LineRows(wanted(NAMES, None, None))
    assert rows_of(parser, text) == [(0, [1.0, 2.0], None), (6, [5.0, 6.0], None)]
    assert parser.counts == {"not_finite": 2, "text": 1, "fields": 1, "number": 1, "too_large": 1}


def test_objects() -> None:
    lines = [
        {"status": "up"},
        {"t": 1, "gx": 2, "gy": 3.5, "more": "x"},
        {"gx": 1},
        {"t": 2, "gx": None, "gy": 1},
        {"t": 3, "gx": "4", "gy": 1},
        {"t": 4, "gx": True, "gy": 1},
        {"t": 5, "gx": 10**400, "gy": 1},
        {"t": 6, "gx": 7, "gy": 8},
    ]
    text = "".join(json.dumps(line) + "\n" for line in lines) + '{"t": 7\nwords\n[1]\n'
    parser = LineRows(wanted(NAMES, None, "t"))
    assert rows_of(parser, text.encode()) == [(0, [2.0, 3.5], 1.0), (5, [7.0, 8.0], 6.0)]
    assert parser.counts == {
        "before_header": 1,
        "columns": 1,
        "not_finite": 1,
        "number": 3,
        "too_large": 1,
        "text": 2,
    }


def test_units_scale_and_counts_stay() -> None:
    radians = rows_of(LineRows(wanted(["gx"], "rad/s", None)), b"gx\n1\n")
    assert radians[0][1] == [pytest.approx(180 / math.pi)]
    assert rows_of(LineRows(wanted(["gx"], "lsb:16.4", None)), b"gx\n2000000\n")[0][1] == [2e6]


def test_a_line_without_end_is_left_out_and_the_next_one_is_read() -> None:
    parser = LineRows(wanted(["gx"], None, None))
    parts = [b"gx\n1\n", b"2" * (LONGEST_LINE // 2), b"2" * LONGEST_LINE, b"2\n3\n"]
    assert [values for _, values, _ in rows_of(parser, *parts)] == [[1.0], [3.0]]
    assert parser.counts == {"too_long": 1}


def test_a_sender_that_begins_again_may_order_its_columns_in_another_way() -> None:
    parser = LineRows(wanted(NAMES, None, None))
    assert rows_of(parser, b"gx,gy\n1,2\ngy,gx\n1,2\n") == [(0, [1.0, 2.0], None), (1, [2.0, 1.0], None)]
    assert parser.headers == 2


def test_after_an_opening_the_rest_of_a_line_is_left_out() -> None:
    parser = LineRows(wanted(NAMES, None, None))
    parser.resume(within_line=True)
    assert rows_of(parser, b"5,", b"7\n1,2\n") == [(0, [1.0, 2.0], None)]


@pytest.mark.parametrize(
    ("columns", "units", "time", "words"),
    [
        (["a", "a"], None, None, "named once"),
        (["a"], None, "a", "named once"),
        (["a", "b", "c", "d"], None, None, "up to 3"),
        (["a"], "furlong", None, "not a unit"),
    ],
)
def test_settings_that_mean_nothing(
    columns: list[str], units: str | None, time: str | None, words: str
) -> None:
    with pytest.raises(UsageError, match=words):
        wanted(columns, units, time)


def test_the_fast_way_is_the_one_taken() -> None:
    lines = [b"%d,%d,%d" % (k, k, -k) for k in range(1000)]
    parser = LineRows(wanted(NAMES, None, "t"))
    parser._one = None  # type: ignore[method-assign,assignment]
    rows = parser.feed(b"t,gx,gy\n" + b"\n".join(lines) + b"\n")
    assert rows is not None
    assert rows.time is not None
    assert np.array_equal(rows.time, np.arange(1000))
