"""Compares the reading of rows from any bytes, cut anywhere, with a plain decoder of single lines."""

import json
import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from fltea.recording.csv_file import open_csv
from fltea.recording.raw_lines import LONGEST_LINE
from fltea.recording.table import Rows
from fltea.recording.text_numbers import RowParser
from fltea.recording.text_rows import TextReader, is_cut_number
from fltea.records.errors import UsageError
from fltea.settings.how import How
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.rig.text_files import stored

NAMES = ["gx", "gy"]
TIMED = How(columns=NAMES, time_column="t", time_unit="s", units="dps")
RATE = How(columns=NAMES, rate_hz=9.0, units="dps")

Row = tuple[int, list[float]]


def rows_of(parser: TextReader, *parts: bytes) -> list[Row]:
    """Return the number of each row and its values: axes, then time, with None for missing numbers."""
    found: list[Rows] = [rows for part in parts for rows in parser.feed(part)] + parser.finish()
    return [
        (number, [None if math.isnan(value) else value for value in row])  # type: ignore[misc]
        for rows in found
        for number, row in zip(rows.ordinal.tolist(), rows.values.tolist(), strict=True)
    ]


def plain(lines: list[bytes]) -> list[Row]:
    """Decode lines with the fields t, gx and gy one by one, by the simplest means."""
    number = 0
    found: list[Row] = []
    for line in lines:
        text = line.decode("utf-8", "replace")
        if not text.strip(" \r\n") or text.isspace() or text.lstrip().startswith(("#", "%", "//")):
            continue
        fields = [field.strip() for field in text.split(",")]
        while len(fields) > 3 and not fields[-1]:
            fields.pop()
        meant = (
            len(fields) >= 3 or text.lstrip()[0] in '0123456789+-.,;"{' or text.lstrip()[:3].lower() == "nan"
        )
        values = []
        for field in fields:
            bare = field.strip('"').strip()
            try:
                if "_" in bare or not bare.isascii():
                    raise ValueError(bare)
                values.append(None if bare.lower() in ("", "nan", "na") else float(bare))
            except ValueError:
                values.append("bad")  # type: ignore[arg-type]
        surplus = any(isinstance(value, float) for value in values[3:]) or "nan" in map(str.lower, fields[3:])
        if len(values) >= 3 and "bad" not in values[:3] and not surplus:
            found.append((number, [values[1], values[2], values[0]]))  # type: ignore[list-item]
        number += meant
    return found


FIELD = st.one_of(
    st.floats(width=32, allow_infinity=False).map(lambda x: repr(x).encode()),
    st.integers(-(10**7), 10**7).map(lambda n: b"%d" % n),
    st.sampled_from([b"", b" ", b"nan", b"x", b"1_0", b" 3 ", b"-0", b'"4"', b"\xff", b"\0", b"NA"]),
)
GOOD = st.tuples(*[st.integers(-999, 999).map(lambda n: b"%d" % n)] * 3).map(b",".join)
LINE = st.one_of(GOOD, st.lists(FIELD, min_size=1, max_size=5).map(b",".join), st.just(b"# a remark"))


@given(
    st.lists(LINE, max_size=12), st.lists(st.integers(0, 200), max_size=6), st.booleans(), st.integers(0, 40)
)
def test_any_lines_cut_anywhere_are_what_a_plain_decoder_reads(
    lines: list[bytes], cuts: list[int], windows: bool, before: int
) -> None:
    lines = [b"0,1,2", *[b"%d,5,-6" % k for k in range(before)], *lines]
    text = b"t,gx,gy\n" + b"".join(line + (b"\r\n" if windows else b"\n") for line in lines)
    places = [0, *sorted(min(cut, len(text)) for cut in cuts), len(text)]
    parts = [text[a:b] for a, b in pairwise(places)]
    assert rows_of(TextReader("x", TIMED), *parts) == plain(lines)


@given(st.lists(st.binary(max_size=40) | LINE, max_size=20))
def test_nothing_that_a_sender_writes_ends_the_reading(parts: list[bytes]) -> None:
    for names in (NAMES, ["1", "2"], None):
        parser = TextReader("x", How(columns=names, units="rad/s", rate_hz=9.0))
        rows_of(parser, *parts)
        if parser.bad.newest is not None:
            assert parser.bad.newest.why.isprintable()


@pytest.mark.parametrize("separator", [",", ";", "\t", " ", ", "])
@pytest.mark.parametrize("header", ["t{}gx{}gy", "# t{}gx{}gy", '"t"{}"gx"{}"gy"', "\ufefft{}gx{}gy"])
def test_the_header_may_come_after_messages(separator: str, header: str) -> None:
    first = "" if header.startswith("\ufeff") else "IMU ready\n\n"
    text = first + header.replace("{}", separator) + "\n" + separator.join(("0.5", "1", "2")) + "\n"
    parser = TextReader("x", TIMED)
    assert rows_of(parser, text.encode()) == [(0, [1.0, 2.0, 0.5])]
    assert parser.bad.counts == ({"before_header": 1} if first else {})


def test_without_a_header_positions_or_as_many_fields_as_names() -> None:
    def found(how: How, text: bytes) -> list[list[float]]:
        return [values for _, values in rows_of(TextReader("x", how), text)]

    assert found(How(columns=["3", "1"], rate_hz=9.0, units="dps"), b"1 2 3\n") == [[3.0, 1.0]]
    assert found(How(columns=["2"], time_column="1", units="dps"), b"7;8\n") == [[8.0, 7.0]]
    assert found(RATE, b"1,2\n3,4\n") == [[1.0, 2.0], [3.0, 4.0]]
    assert found(RATE, b"1,2,3\n") == found(How(rate_hz=9.0), b"1,2,3\n") == []


def test_blanks_may_stand_in_place_of_some_tabs() -> None:
    text = b"t\tgx\tgy\n0.5\t1\t2\n1.5\t3 4\n2.5 5 6\n3.5\t\t7\n4.5\t8\n"
    parser = TextReader("x", TIMED)
    assert rows_of(parser, text) == [
        (0, [1.0, 2.0, 0.5]),
        (1, [3.0, 4.0, 1.5]),
        (2, [5.0, 6.0, 2.5]),
        (3, [None, 7.0, 3.5]),
    ]
    assert parser.bad.counts == {"fields": 1}


def test_a_line_that_looks_like_a_sample_takes_a_number_and_a_message_takes_none() -> None:
    text = b"gx,gy\n1,2\n1,\nhello\n3\n1,2x\nnan,1\n# remark\n5,6\n"
    parser = TextReader("x", RATE)
    assert rows_of(parser, text) == [(0, [1.0, 2.0]), (1, [1.0, None]), (4, [None, 1.0]), (5, [5.0, 6.0])]
    assert parser.bad.counts == {"text": 1, "fields": 1, "number": 1}


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
    parser = TextReader("x", TIMED)
    assert rows_of(parser, text.encode()) == [
        (0, [2.0, 3.5, 1.0]),
        (1, [None, 1.0, 2.0]),
        (5, [7.0, 8.0, 6.0]),
    ]
    assert parser.bad.counts == {"before_header": 1, "columns": 1, "number": 4, "text": 2}


def test_a_line_without_end_is_left_out_and_the_next_one_is_read() -> None:
    parser = TextReader("x", How(columns=["gx"], rate_hz=9.0, units="dps"))
    parts = [b"gx\n1\n", b"2" * (LONGEST_LINE // 2), b"2" * LONGEST_LINE, b"2\n3\n"]
    assert [values for _, values in rows_of(parser, *parts)] == [[1.0], [3.0]]
    assert parser.bad.counts == {"too_long": 1}


def test_a_sender_that_begins_again_may_order_its_columns_in_another_way_and_name_other_units() -> None:
    parser = TextReader("x", How(rate_hz=9.0))
    found = [
        rows
        for text in (b"gx [dps],gy [dps]\n1,2\n", b"gy [rad/s],gx [rad/s]\n1,2\n", b"gx [dps]\n7\n")
        for rows in parser.feed(text)
    ]
    assert [rows.values.round(3).tolist() for rows in found] == [[[1.0, 2.0]], [[114.592, 57.296]]]
    assert [rows.begins for rows in found] == [True, True]
    assert parser.bad.counts == {"header": 1}


def test_words_as_whole_seconds_leave_the_fractions_out_too() -> None:
    parser = TextReader("x", How(rate_hz=9.0, units="dps"))
    assert rows_of(parser, b"sec,nanosec,gx,gy\nnoon,5,1,2\nnoon,7,3,4\n") == [
        (0, [1.0, 2.0]),
        (1, [3.0, 4.0]),
    ]
    assert [note.kind for note in parser.notes] == ["row_times"]


def test_after_an_opening_the_rest_of_a_line_is_left_out() -> None:
    parser = TextReader("x", RATE)
    parser.resume(within_line=True)
    assert rows_of(parser, b"5,", b"7\n1,2\n") == [(0, [1.0, 2.0])]


@pytest.mark.parametrize("lines", [1, 30])
def test_once_a_number_has_a_decimal_comma_or_a_point_the_others_have_it_too(lines: int) -> None:
    for mark, other in ((",", "."), (".", ",")):
        text = "gx;gy\n" + "3;4\n" * lines + f"1{mark}5;2\n" * lines + f"7{other}5;2\n" * lines
        parser = TextReader("x", How(columns=NAMES, rate_hz=9.0, units="dps"))
        found = [row for part in text.splitlines(keepends=True) for row in rows_of(parser, part.encode())]
        assert [values for _, values in found] == [[3.0, 4.0]] * lines + [[1.5, 2.0]] * lines
        parser = TextReader("x", How(columns=NAMES, rate_hz=9.0, units="dps"))
        assert [values for _, values in rows_of(parser, text.encode())] == [values for _, values in found]
        assert parser.bad.counts == {"number": lines}


def test_plain_rows_are_not_looked_at_one_by_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(RowParser, "one", None)
    (rows,) = TextReader("x", TIMED).feed(
        b"t,gx,gy\n" + b"".join(b"%d,%d,%d\n" % (k, k, -k) for k in range(999))
    )
    assert np.array_equal(rows.values[:, 2], np.arange(999))


# --- whole files ---


def test_rows_behind_a_torn_header_are_told(tmp_path: Path) -> None:
    rows = [f"{k / 100},{k % 7},{k % 5}\n" for k in range(40)]
    header = "time_s,gyro_x_dps,gyro_y_dps\n"
    text = header + "".join(rows[:20]) + "time_s,gyro_x_dps\n" + "".join(rows[20:])
    found = stored(tmp_path, text)
    assert found.samples == 20
    assert (
        "the first of 20 lines that hold no sample and are left out: does not fit the header"
        in found.notes[0].text
    )


@given(
    rows=st.lists(
        st.lists(st.floats(-2000, 2000) | st.just(np.nan), min_size=3, max_size=3), min_size=1, max_size=30
    ),
    separator=st.sampled_from([",", ";", "\t", " "]),
    comma=st.booleans(),
    empty=st.sampled_from(["", "NA", "nan"]),
)
@settings(max_examples=100)
def test_every_bit_and_every_gap_comes_back(
    tmp_path_factory: pytest.TempPathFactory, rows: list[list[float]], separator: str, comma: bool, empty: str
) -> None:
    empty = empty if separator != " " else "nan"
    comma = comma and separator in ";\t"

    def written(value: float) -> str:
        return empty if np.isnan(value) else repr(value).replace(".", "," if comma else ".")

    lines = [separator.join(map(written, row)) for row in [[0.5, -0.25, 1e-7], *rows]]
    text = "gx gy gz\n".replace(" ", separator) + "\n".join(lines) + "\n"
    found = stored(tmp_path_factory.getbasetemp(), text, rate_hz=10.0, units="dps").whole()
    kept = {k: row for k, row in enumerate(rows, 1) if not np.isnan(row).any()}
    assert found.seq.tolist() == [0, *kept]
    assert found.gyro.tolist()[1:] == list(kept.values())


@pytest.mark.parametrize(
    "beside",
    [
        {"unit": "deg/s"},
        {"gyro_unit": "deg/s"},
        {"units": {"gyro": "deg/s", "time": "s"}},
        {"unit": "dps", "ax": 1},
    ],
)
def test_a_unit_in_objects_of_json_is_stated(tmp_path: Path, beside: dict[str, object]) -> None:
    rows = ({"t": k / 50, "gyro_x": 0.1 * (k % 7), "gyro_y": 0.2 * (k % 5), **beside} for k in range(99))
    lines = "".join(json.dumps(row) + "\n" for row in rows)
    found = stored(tmp_path, lines)
    assert found.whole().gyro[:, 1].tolist() == pytest.approx([0.2 * (k % 5) for k in range(99)])
    assert [one.evidence for one in found.reading if one.question == "unit"] == ["stated"]
    with pytest.raises(UsageError, match=r"--units rad/s says otherwise"):
        stored(tmp_path, lines, units="rad/s")


TAIL = [b"0.%02d,0.12%d" % (k, k) for k in range(10)]


@pytest.mark.parametrize(
    ("last", "is_cut"),
    [
        (b"0.10,0.1234", False),
        (b"0.10,0.123", False),
        (b"0.10,0.12", True),
        (b"0.10,-0.", True),
        (b"0.10,0", True),
        (b"0.10,-", True),
        (b"0.10,1e-05", False),
        (b"0.10,", False),
        (b"end", False),
        (b"", False),
    ],
)
def test_a_number_at_the_end_of_a_cut_file_is_not_read_without_its_last_digits(
    last: bytes, is_cut: bool
) -> None:
    assert is_cut_number(last, TAIL) == is_cut
    assert not is_cut_number(last, TAIL[:2])
    assert not is_cut_number(last, [*TAIL, b"0.1,0.4"]), "decimals vary"


POWERS = [b"0.%02d,%d.725112e-0%d" % (k, k - 5, k % 4) for k in range(10)]
SHORTEST = [b"0.%02d,%d.%se-05" % (k, k - 5, b"1234"[: 1 + k % 4]) for k in range(10)]
COUNTS = [b"%d,-%d" % (k, 990 + 3 * k) for k in range(30)]
BY_CHANCE = [b"%d,%d" % (k, 1026 * k - 9000) for k in range(30)]


@pytest.mark.parametrize(
    ("before", "whole", "cut"),
    [
        (POWERS, ["-3.317807e-03", "3.317807E+12", "3.317807e-105"], ["3.725112e-0", "3.725112e-", "3.7"]),
        (SHORTEST, ["2e-06", "0.000123", "0.0"], ["1.23e-0", "1.23e"]),
        (COUNTS, ["-1026", "997", "1.5", ""], ["-10", "10", "-"]),
        (BY_CHANCE, ["-1026", "100"], []),
        (TAIL, ["1.234e-05"], []),
    ],
)
def test_an_exponent_or_a_count_at_the_end_of_a_cut_file_is_not_read_without_its_last_digits(
    before: list[bytes], whole: list[str], cut: list[str]
) -> None:
    for numbers, is_cut in ((whole, False), (cut, True)):
        for number in numbers:
            assert is_cut_number(b"0.10," + number.encode(), before) == is_cut, number


@pytest.mark.parametrize("form", ["{:.6e}", "{:.0f}"])
def test_a_row_whose_last_number_lacks_its_exponent_or_half_its_digits_is_left_out(
    form: str, tmp_path: Path
) -> None:
    text = "time_s,gyro_x_dps\n" + "".join(
        f"{k / 100:.2f},{form.format(1026 + k * 7 % 11)}\n" for k in range(50)
    )
    path = tmp_path / "rest.csv"
    for lacking, rows, notes in ((1, 50, 0), (2, 49, 1), (3, 49, 1)):
        path.write_text(text[:-lacking])
        found = open_csv(path)
        assert (found.samples, len(found.notes)) == (rows, notes)


def test_a_file_that_is_cut_within_its_last_number_leaves_the_row_out(tmp_path: Path) -> None:
    text = "time_s,gyro_x_dps\n" + "".join(f"{k / 100:.2f},{k * 7 % 11 / 7:.4f}\n" for k in range(50))
    path = tmp_path / "rest.csv"
    for lacking, rows, notes in ((1, 50, 0), (2, 49, 1), (5, 49, 1)):
        path.write_text(text[:-lacking])
        found = open_csv(path)
        assert (found.samples, len(found.notes)) == (rows, notes)
