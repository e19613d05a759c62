"""If the header of a text file is repeated before each row, its columns are chosen only once, and no row is
taken for the beginning of a new run of the logger.
"""

import pytest
from fltea.recording import text_layout
from fltea.recording.columns import choose
from fltea.recording.header_choices import MOST, Choices
from fltea.recording.text_rows import TextReader
from fltea.records.errors import UsageError
from fltea.settings.how import How

ROWS = 300
HOW = How(rate_hz=100.0, units="deg/s", accel_units="g")
OTHERS = {
    "the same": ["gx,gy,gz"],
    "two by turns": ["gx,gy,gz", "gy,gx,gz"],
    "with another unit than the user gives": ["gx [rad/s],gy [rad/s],gz [rad/s]"],
    "with fewer names than the rows have fields": ["gyro_x,gyro_y"],
    "with an accelerometer": ["gx,gy,gz,ax,ay,az"],
}


@pytest.fixture
def chosen(monkeypatch: pytest.MonkeyPatch) -> list[object]:
    """Collect the column names of each header that makes the reader choose columns."""
    found: list[object] = []

    def counted(where: str, names: object, *rest: object) -> object:
        found.append(names)
        return choose(where, names, *rest)  # type: ignore[arg-type]

    monkeypatch.setattr(text_layout, "choose", counted)
    return found


@pytest.mark.parametrize("line_by_line", [False, True], ids=["at once", "line by line"])
@pytest.mark.parametrize("headers", OTHERS.values(), ids=OTHERS)
def test_each_header_is_looked_at_once(headers: list[str], line_by_line: bool, chosen: list[object]) -> None:
    text = "gx,gy,gz\n1,2,3\n" + "".join(f"{headers[k % len(headers)]}\n{k},2,3\n" for k in range(ROWS))
    reader = TextReader("x", HOW)
    pieces = text.encode().splitlines(keepends=True) if line_by_line else [text.encode()]
    runs = sum(rows.begins for piece in pieces for rows in reader.feed(piece))
    assert len(chosen) == len({"gx,gy,gz", *headers})
    assert runs <= 5


def test_of_headers_that_all_differ_some_are_looked_at(chosen: list[object]) -> None:
    text = "gx,gy,gz\n1,2,3\n" + "".join(f"gx [rad/s],gy [rad/s],n{k}\n1,2,3\n" for k in range(ROWS))
    TextReader("x", HOW).feed(text.encode())
    assert len(chosen) == MOST


def test_a_refusal_is_repeated_as_it_was() -> None:
    choices, asked = Choices(), []

    def refuse() -> None:
        asked.append(1)
        raise UsageError("no unit")

    for _ in range(3):
        with pytest.raises(UsageError, match="no unit"):
            choices.of("gx,gy", refuse)  # type: ignore[arg-type]
    assert asked == [1]
