"""Reading takes linear time: twice as many rows take twice the work, whatever lines stand between the rows.

Work is counted, not timed: calls, and the bytes and lines that each call examines.
"""

import contextlib
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fltea.recording import (
    dialects,
    named_lines,
    plain_text,
    row_kinds,
    sensor_lines,
    text_fields,
    text_forms,
    text_headers,
    text_layout,
    text_numbers,
    text_rows,
)
from fltea.recording.csv_file import HEAD_LINES, open_csv
from fltea.recording.one_sensor import OneSensor
from fltea.recording.text_forms import YamlDocuments
from fltea.recording.text_headers import SAMPLE_LINES
from fltea.recording.text_layout import LayoutFinder
from fltea.recording.text_numbers import RowParser
from fltea.recording.text_rows import TextReader
from fltea.records.errors import UsageError
from fltea.settings.how import How
from fltea.sources.text_events import TextEvents

from tests.rig.tiers import slow_but

ROWS = 4000
"""Number of rows in the smaller of two texts. The first rows of a text, by which the meaning of the columns
is found, are examined repeatedly. There have to be many more rows than these.
"""

HEADER = "time_s,gyro_x_dps,gyro_y_dps,gyro_z_dps\n"
VALUES = np.round(np.random.default_rng(4).normal(size=(2 * ROWS, 3)), 3)


def row(k: int) -> str:
    x, y, z = VALUES[k]
    return f"{k / 100:.2f},{x},{y},{z}\n"


def every(rows: int, line: str, head: str = HEADER) -> Callable[[int], Iterator[str]]:
    """Return a function that makes a text in which a line is inserted before every group of a few rows."""

    def lines(n: int) -> Iterator[str]:
        yield head
        for k in range(n):
            if k % rows == 0:
                yield line
            yield row(k)

    return lines


def plain(n: int) -> Iterator[str]:
    yield HEADER
    yield from map(row, range(n))


def pages(n: int) -> Iterator[str]:
    """Yield rows, with a header before every ten rows (a page). The header's last column is not used, and has
    another name on each page.
    """
    for k in range(n):
        if k % 10 == 0:
            yield HEADER.strip() + f",page {k}\n"
        yield row(k)


def clocks(n: int) -> Iterator[str]:
    for k in range(n):
        yield f"12:{k // 6000:02}:{k / 100 % 60:05.2f} -> {row(k)}"


def yaml(n: int) -> Iterator[str]:
    for k in range(n):
        x, y, z = VALUES[k]
        yield f"header:\n  stamp:\n    sec: {k // 100}\n    nanosec: {k % 100 * 10_000_000}\n"
        yield f"angular_velocity:\n  x: {x}\n  y: {y}\n  z: {z}\n---\n"


def objects(n: int) -> Iterator[str]:
    for k in range(n):
        x, y, z = VALUES[k]
        yield f'{{"t_s": {k / 100}, "gx_dps": {x}, "gy_dps": {y}, "gz_dps": {z}}}\n'
        if k % 10 == 0:
            yield '{"status": "up"}\n'


def labels(n: int) -> Iterator[str]:
    for k in range(n):
        x, y, z = VALUES[k]
        yield f"Gyro X: {x} Y: {y} Z: {z} dps\n"


def kinds(n: int) -> Iterator[str]:
    for k in range(n):
        x, y, z = VALUES[k]
        yield f"ACC,{k},0.0,0.0,9.8\nGYR,{k / 100},{x},{y},{z}\n"


def sensors(n: int) -> Iterator[str]:
    yield "imu," + HEADER
    for k in range(n):
        yield f"0,{row(k)}1,{row(k)}"


def by_position(before: int) -> dict[str, Any]:
    """Return options that name the columns of the rates by their positions: the three columns after the first
    `before` ones. The first column of the table holds the times.
    """
    columns = [str(before + place) for place in (1, 2, 3)]
    return {"columns": columns, "units": "dps", "time_column": "1", "time_unit": "s"}


TEXTS: dict[str, tuple[Callable[[int], Iterator[str]], dict[str, Any]]] = {
    "plain": (plain, {}),
    "a header every ten rows": (every(10, HEADER), {}),
    "a header and units every ten rows": (
        every(10, "time,gx,gy,gz\ns,dps,dps,dps\n", ""),
        {},
    ),
    "another header every ten rows": (every(10, "time_s,gyro_y_dps,gyro_x_dps,gyro_z_dps\n"), {}),
    "a header that does not fit": (every(50, "time_s,gyro_x_dps\n" + HEADER), {}),
    "a header with a number": (pages, {}),
    "a label every ten rows": (every(10, "mode: 3, state=on\n"), {}),
    "words every ten rows": (every(10, "W (1234) wifi: connected\n"), {}),
    "comments every ten rows": (every(10, "# still here\n"), {}),
    "torn rows every ten rows": (every(10, "0.1,2.\n"), {}),
    "quotes every ten rows": (every(10, '"0.1,2\n'), {}),
    "rows in Python's bytes": (lambda n: (f"{line.encode()!r}\n" for line in plain(n)), {}),
    "clocks": (clocks, by_position(2)),
    "yaml": (yaml, {}),
    "objects": (objects, {}),
    "labels": (labels, {"rate_hz": 100.0}),
    "rows of several kinds": (
        kinds,
        {**by_position(2), "time_column": "2", "topic": "GYR"},
    ),
    "rows of several sensors": (sensors, {"topic": "1"}),
    "no names": (lambda n: map(row, range(n)), by_position(1)),
}


@pytest.fixture
def work(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """Count the calls of functions that read text, and how many bytes or lines these calls receive."""
    done: Counter[str] = Counter()

    def watch(owner: Any, name: str, size: Callable[..., int] = lambda *_: 0) -> None:
        plainly = getattr(owner, name)

        def watched(*arguments: Any, **named: Any) -> Any:
            found = plainly(*arguments, **named)
            done[name] += 1
            done[f"{name}, size"] += size(found, *arguments)
            return found

        monkeypatch.setattr(owner, name, watched)

    def lines(_: object, found: Any, *__: Any) -> int:
        return len(found)

    watch(RowParser, "one")
    watch(RowParser, "plain")
    watch(LayoutFinder, "take")
    watch(LayoutFinder, "header_of")
    watch(YamlDocuments, "_take")
    watch(OneSensor, "keep", lambda marks, *_: len(marks))
    watch(sensor_lines, "_value")
    watch(TextReader, "_add", lambda *given: len(given[3]))
    watch(text_numbers, "plain_rows", lambda _, data, *__: len(data))
    watch(plain_text, "plain_lines", lines)
    for module in (plain_text, text_headers, text_rows):
        watch(module, "decoded", lines)
    watch(text_rows, "end_of_line", lambda end, data, begin: end - begin)
    watch(text_layout, "choose")
    watch(text_layout, "split", lines)
    watch(named_lines, "labelled", lines)
    watch(text_fields, "split", lines)
    watch(text_fields, "values_in", lines)
    for module in (row_kinds, text_layout):
        watch(module, "dialect_of")
    watch(dialects, "_is_in")
    return done


def assert_linear(done: list[Counter[str]]) -> None:
    """Check that twice as many rows take at most twice the work. The beginning of a file may take additional
    work.
    """
    small, large = done
    for what, count in large.items():
        assert count <= 2.1 * small[what] + 200, f"{what}: {small[what]} and {count}"


@pytest.mark.parametrize("name", slow_but(sorted(TEXTS)[::4], TEXTS))
def test_twice_the_rows_is_twice_the_work(name: str, work: Counter[str], tmp_path: Path) -> None:
    lines, how = TEXTS[name]
    done = []
    for n in (ROWS, 2 * ROWS):
        work.clear()
        path = tmp_path / "rest.txt"
        path.write_text("".join(lines(n)))
        found = open_csv(path, How(**how))
        assert n - n // 9 <= found.samples <= n
        done.append(Counter(work))
    assert_linear(done)


@pytest.mark.parametrize("name", TEXTS)
def test_live_text_is_read_once_in_whatever_pieces_it_comes(name: str, work: Counter[str]) -> None:
    lines, how = TEXTS[name]
    done = []
    for n in (ROWS // 2, ROWS):
        work.clear()
        live = TextEvents("stdin:", How(**how), fatal=False)
        live.open(0, within_line=False)
        data = "".join(lines(n)).encode()
        for k in range(0, len(data), 1500):
            list(live.feed(data[k : k + 1500], 0))
        list(live.finish(0))
        done.append(Counter(work))
    assert_linear(done)


def test_what_is_plain_is_not_looked_at_line_by_line(work: Counter[str], tmp_path: Path) -> None:
    path = tmp_path / "rest.txt"
    for name in ("plain", "comments every ten rows", "rows in Python's bytes", "no names"):
        work.clear()
        lines, how = TEXTS[name]
        path.write_text("".join(lines(ROWS)))
        open_csv(path, How(**how))
        assert work["one"] < 20, name
        assert work["take"] < 20, name
        assert work["plain_rows, size"] < 1.1 * path.stat().st_size


@pytest.mark.parametrize("name", [name for name in TEXTS if name.endswith("every ten rows")])
def test_a_line_among_rows_costs_one_look_at_it(name: str, work: Counter[str], tmp_path: Path) -> None:
    lines, how = TEXTS[name]
    path = tmp_path / "rest.txt"
    path.write_text("".join(lines(ROWS)))
    open_csv(path, How(**how))
    assert work["one"] <= 4.1 * ROWS / 10, "it, a line of units behind it, and the rows behind that"
    assert work["plain_rows, size"] <= 10 * path.stat().st_size, (
        "room is made for the rows of some bytes more"
    )


JUNK: dict[str, Callable[[int], str]] = {
    "rows of several kinds": lambda k: f"{('ACC', 'GYR', 'MAG')[k % 3]},{k},0.5,2,3\n",
    "a new tag a line": lambda k: f"T{k},{k},1.5,2,3\n",
    "every other row": lambda k: row(k) if k % 2 else f"{k / 100},1,2x,{k}\n",
    "prose": lambda k: f"The fox {k} jumps over the lazy dog and so on and so forth.\n",
    "letters": lambda _: "x\n",
    "brackets": lambda _: "[[[{(1,2,3\n",
    "quotes": lambda k: f'"a{k},1,2\n',
    "wrong checksums": lambda k: f"$VNYMR,1,2,3,4,5,6,7,8,9,1,2,{k}*00\n",
}
"""Texts in which few or no lines are rows.

Python's own functions are called so often in reading them that counting these calls would take too long.
"""
JUNK_LINES = 500


@pytest.mark.parametrize("head", ["", "".join(plain(100))])
@pytest.mark.parametrize("name", JUNK)
def test_a_line_that_is_no_row_costs_a_few_calls(name: str, head: str, tmp_path: Path) -> None:
    path = tmp_path / "rest.csv"
    path.write_text(head + "".join(JUNK[name](k) for k in range(JUNK_LINES)))
    calls = 0

    def count(*_: object) -> None:
        nonlocal calls
        calls += 1

    sys.setprofile(count)
    try:
        with contextlib.suppress(UsageError):
            open_csv(path)
    finally:
        sys.setprofile(None)
    assert calls < 3000 * JUNK_LINES + 300_000


def test_the_columns_have_to_be_named_in_the_first_lines(tmp_path: Path) -> None:
    """The columns have to be named in the first HEAD_LINES lines. This limit is a number of lines, whatever
    their length in bytes.
    """
    path = tmp_path / "rest.csv"
    path.write_text("x\n" * (HEAD_LINES - 2) + "".join(plain(100)))
    assert open_csv(path).samples == 100
    path.write_text("x\n" * (HEAD_LINES + 1) + "".join(plain(100)))
    with pytest.raises(UsageError, match="is no recording"):
        open_csv(path)


@pytest.mark.parametrize("end", ["", "\n"])
def test_lines_that_are_none_of_a_recording_are_looked_at_once(end: str, work: Counter[str]) -> None:
    """Lines that name no columns are examined once each. They consist of words and of numbers with labels, or
    are one endless line.
    """
    done = []
    for n in (ROWS // 2, ROWS):
        work.clear()
        reader = TextReader("stdin", How())
        for k in range(n):
            reader.feed(f"W ({k}) wifi: connected, 12.5 {end}".encode())
        reader.finish()
        assert reader.chosen is None
        done.append(Counter(work))
    assert_linear(done)


def test_a_document_that_never_ends_is_not_joined_again_and_again() -> None:
    """An endless document arrives in pieces. If all earlier pieces were joined whenever a piece arrives, the
    test would take hours.
    """
    documents = text_forms.YamlDocuments()
    for _ in range(20_000):
        documents.feed(b"0123456789")
    assert len(documents._rest) <= text_forms.LONGEST_LINE


def test_the_sample_is_bounded(work: Counter[str]) -> None:
    reader = TextReader("stdin", How())
    reader.feed("".join(plain(2 * ROWS)).encode())
    assert len(reader._headers.sample) <= 2 * SAMPLE_LINES
