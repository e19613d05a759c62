"""Pieces of text: whole lines each, behind the lines that name the columns."""

import math

from fltea.cluster.cut import Cut, Ranges
from fltea.recording.csv_file import HEAD_BYTES
from fltea.recording.lines import LONGEST_LINE
from fltea.recording.text_rows import UTF_16, TextReader
from fltea.records.errors import UsageError
from fltea.settings.how import How

NEAR_BYTES = 1 << 12
"""In which the end of a line is looked for first."""


def cuts(source: Ranges, block_bytes: int, how: How) -> list[Cut]:
    """Return where it may be cut; nowhere if its columns are unknown: reading it whole reports why."""
    begin = source.read(0, HEAD_BYTES)
    reader = TextReader(source.file.url, how)
    try:
        reader.feed(begin)
    except UsageError:
        return []
    if begin.startswith(UTF_16) or reader.layout is None:
        return []
    head = b"".join(line + b"\n" for line in begin.split(b"\n")[: reader.layout.begin - 1])
    first, size = len(head), source.size
    pieces = max(1, math.ceil((size - first) / block_bytes))
    places = [first]
    for k in range(1, pieces):
        place = _line_from(source, first + (size - first) * k // pieces)
        if place is not None and places[-1] < place < size:
            places.append(place)
    return [Cut(b, e, head) for b, e in zip(places, [*places[1:], size], strict=True)]


def _line_from(source: Ranges, place: int) -> int | None:
    """Where the next line begins; None if there is no line."""
    for length in (NEAR_BYTES, LONGEST_LINE):
        found = source.read(place, place + length).find(b"\n")
        if found >= 0:
            return place + found + 1
    return None
