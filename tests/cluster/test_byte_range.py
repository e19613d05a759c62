"""Tests of parsing the header by which an HTTP request asks for a range of a file's bytes."""

import pytest
from fltea.cluster.byte_range import requested_range


@pytest.mark.parametrize(
    ("header", "expected"),
    [
        ("bytes=0-99", (0, 99)),
        ("bytes=7-", (7, None)),
        ("", None),
        ("bytes=-5", None),
        ("bytes=0-1,5-6", None),
        ("rows=0-9", None),
    ],
)
def test_a_range_is_understood_and_anything_else_is_a_whole_file(
    header: str, expected: tuple[int, int | None] | None
) -> None:
    assert requested_range({"Range": header} if header else {}) == expected
