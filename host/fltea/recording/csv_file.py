"""Recordings as text: CSV and its relatives, whatever separates their columns."""

import csv
import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from fltea.recording.columns import Chosen, choose, wanted_of
from fltea.recording.files import Note, Recording, Stored, parse_units
from fltea.recording.lines import shown
from fltea.recording.table import gather
from fltea.recording.text_layout import HEAD_LINES, MISSING, Layout, find_layout, is_number
from fltea.recording.text_rows import Lines, RowReader, blocks_of_lines, decoded_head
from fltea.records.errors import UsageError
from fltea.settings.how import AS_IT_SAYS, How
from fltea.settings.limits import DEFAULT_LIMITS, Limits

HEAD_BYTES = 1 << 20
"""Of lines in which a header is looked for."""

BOM, UTF_16 = b"\xef\xbb\xbf", (b"\xff\xfe", b"\xfe\xff")


def read_csv(
    path: Path,
    columns: list[str] | None = None,
    units: str | None = None,
    rate_hz: float | None = None,
    *,
    limits: Limits = DEFAULT_LIMITS,
) -> Recording:
    """`open_csv`, all of it in memory."""
    return open_csv(path, How(columns=columns, units=units, rate_hz=rate_hz), limits).whole()


def open_csv(
    path: Path, how: How = AS_IT_SAYS, limits: Limits = DEFAULT_LIMITS, file: BinaryIO | None = None
) -> Stored:
    """Read the columns of a gyroscope out of a text file, once.

    The separator, the header and decimal commas are found (`text_layout`); columns are those that `how` names
    or that are known by their names (`columns`); a row without a number is a lost sample. file: what is
    behind the path, if it has been opened already.

    Raises:
        UsageError: names file, line and reason.
    """
    wanted = wanted_of(how)
    if how.units is not None:
        parse_units(how.units)
    try:
        with file or path.open("rb") as stream:
            blocks = blocks_of_lines(path, stream)
            head = _head(path, blocks)
            ends = itertools.accumulate(map(len, head.lines[: HEAD_LINES + 1]))
            most = 1 + sum(end < HEAD_BYTES for end in ends)  # lines may be long, but not all of them
            texts = decoded_head(head.lines[:most])
            layout = find_layout(path, texts, wanted)
            where = f"{path}:{layout.header + 1}"
            chosen = choose(where, layout.names, layout.units, len(layout.first), how)
            chosen, notes = _without_dates(path, chosen, layout, how)
            reader = RowReader(path, layout, chosen)
            rows = map(reader.read, itertools.chain([_behind(head, layout)], blocks))
            found = gather(path, chosen, rows, how, limits, lambda line: f"{path}:{line}")
            return found._replace(notes=(*notes, *found.notes))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise UsageError(f"{path}: cannot be read as CSV ({error}).") from error


def _head(path: Path, blocks: Iterator[Lines]) -> Lines:
    """The first lines, so many that the header is among them."""
    head = Lines(1, [])
    for block in blocks:
        head = Lines(1, head.lines + block.lines, block.cut)
        if len(head.lines) > HEAD_LINES:
            break
    if head.lines:
        if head.lines[0].startswith(UTF_16):
            raise UsageError(f"{path}: cannot be read as CSV (it is UTF-16; save it as UTF-8).")
        head.lines[0] = head.lines[0].removeprefix(BOM)
    return head


def _without_dates(path: Path, chosen: Chosen, layout: Layout, how: How) -> tuple[Chosen, list[Note]]:
    """Leave aside a column of times that nobody asked for, and that holds dates instead of numbers."""
    if chosen.time is None or how.time_column is not None or chosen.time >= len(layout.first):
        return chosen, []
    name, first = chosen.names[chosen.time], layout.first[chosen.time]
    if is_number(first) or first.lower() in MISSING:
        return chosen, []
    told = f"{path}:{layout.begin + 1}: column {shown(name)}: {shown(first)} is no number"
    if how.rate_hz is None:
        raise UsageError(f"{told}; times as text are not read, so give the rate: --rate 100.")
    text = f"{told}, so it cannot tell which samples are missing."
    return chosen._replace(time=None), [Note("row_times", text)]


def _behind(head: Lines, layout: Layout) -> Lines:
    return Lines(head.first + layout.begin, head.lines[layout.begin :], head.cut)
