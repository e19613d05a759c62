"""Plain rows (lines of numbers only) are parsed in C++.

The numbers of plain rows equal those of Python's parser to the bit. Any other line is left to Python.
"""

import math
import struct

import numpy as np
import pytest
from fltea._native import plain_rows
from fltea.recording.text_numbers import RowParser
from fltea.recording.text_rows import TextReader
from fltea.settings.how import How
from hypothesis import example, given, settings
from hypothesis import strategies as st

from tests.rig.tiers import slow_but

THREE = How(columns=["2", "3", "1"], rate_hz=9.0, units="dps")
MARKS = {",": ",", ";": ";", "\t": "\t", "blanks": " "}

NUMBERS = st.one_of(
    st.floats(allow_nan=False).map(repr),
    st.integers(-(10**25), 10**25).map(str),
    st.decimals(allow_nan=False, allow_infinity=False, places=17, max_value=10**8).map(str),
    st.from_regex(r"[+-]?([0-9]{1,21}\.?[0-9]{0,21}|\.[0-9]{1,21})([eE][+-]?[0-9]{1,3})?", fullmatch=True),
    st.sampled_from(
        ["inf", "-Infinity", "+INF", "9007199254740993", "1e22", "1e23", "-0", "-0.0", "2.5e-324"]
    ),
)


def bits(value: float) -> bytes:
    return struct.pack("d", value)


@settings(max_examples=200)
@given(NUMBERS)
@example("0.1")
@example("123456789012345678")
def test_a_number_is_what_python_makes_of_it_to_the_bit(text: str) -> None:
    _, passed, _, rows, values = plain_rows(text.encode(), 0, ",", 1, 1, [0], "\0")
    if passed:  # numbers beyond the range of doubles are left to Python
        assert rows.tolist() == [0]
        assert bits(values[0, 0]) == bits(float(text))
    else:
        assert len(text) >= 64 or float(text) in (0.0, math.inf, -math.inf) or abs(float(text)) < 1e-300


@pytest.mark.parametrize("text", ["", '""', "NaN", "-nan", "n/a", "NULL", "None", "na"])
def test_words_for_what_is_missing_are_no_number(text: str) -> None:
    (values,) = plain_rows(f"{text},1".encode(), 0, ",", 2, 2, [0], "\0")[4]
    assert bits(values[0]) == bits(math.nan)


@pytest.mark.parametrize(
    "text",
    ["1_0", "0x10", "+-1", "1,5", "nan(1)", "- 1", "1e", "e1", ".", "+", "١", "infx", "1 2", 'a"', "no"],
)
def test_what_is_no_number_is_left_to_python(text: str) -> None:
    assert plain_rows(f"1;{text};2".encode(), 0, ";", 3, 3, [1], ".")[:2] == (0, 0)


def test_it_stops_where_a_line_is_not_plain_and_goes_on_behind_it() -> None:
    data = b"1,2\n\n# words\n3,4\r\ntorn\n5,6"
    after, passed, _, rows, values = plain_rows(data, 0, ",", 2, 2, [1, 0], "\0")
    assert (after, passed, rows.tolist(), values.tolist()) == (18, 4, [0, 3], [[2.0, 1.0], [4.0, 3.0]])
    after, passed, _, rows, values = plain_rows(data, 23, ",", 2, 2, [1, 0], "\0")
    assert (after, passed, rows.tolist(), values.tolist()) == (len(data) + 1, 1, [0], [[6.0, 5.0]])
    with pytest.raises(ValueError, match="begin is greater"):
        plain_rows(data, len(data) + 1, ",", 2, 2, [1], "\0")


def parser_of(separator: str) -> RowParser:
    reader = TextReader("x", THREE)
    assert reader.feed((separator.join("123") + "\n").encode())
    assert reader.layout is not None
    return RowParser(reader.layout._replace(least=3, most=4))


FIELDS = st.sampled_from(
    [
        "1",
        "-2.5",
        "3,5",
        "",
        " ",
        '""',
        '"4"',
        '"5',
        "nan",
        "NA",
        "x",
        "#",
        "//",
        "%",
        "1e3",
        "+7",
        "\x1c",
        "\u00a0",
    ]
)


@pytest.mark.parametrize("separator", slow_but([","], MARKS))
@settings(max_examples=300)
@given(
    fields=st.lists(FIELDS, max_size=6),
    before=st.sampled_from(["", "1.5", "1,5"]),
    end=st.sampled_from(["", "\r", " \r"]),
)
@example(fields=["1", "2", "3", '"'], before="", end="")
def test_a_line_that_is_plain_is_read_as_the_closer_look_reads_it(
    separator: str, fields: list[str], before: str, end: str
) -> None:
    fast, slow = parser_of(MARKS[separator]), parser_of(MARKS[separator])
    text = MARKS[separator].join(fields) + end
    if before and separator != ",":
        line = MARKS[separator].join([before] * 3)
        assert fast.plain(line.encode()).passed == 1
        assert isinstance(slow.one(line), list)
    found, expected = fast.plain(text.encode()), slow.one(text)
    if found.passed and len(found.rows):
        assert isinstance(expected, list)
        assert np.array_equal(found.values[0], expected, equal_nan=True)
    elif found.passed:
        assert expected is None
    if found.passed and isinstance(expected, list):
        assert isinstance(fast.one("1.5 1.5 1.5".replace(" ", MARKS[separator])), list) == isinstance(
            slow.one("1.5 1.5 1.5".replace(" ", MARKS[separator])), list
        )
