"""Reads text recordings: CSV with any separator, and JSON objects."""

from collections.abc import Iterator, Sequence
from itertools import chain
from pathlib import Path
from typing import BinaryIO

from fltea.recording.files import Note, Stored
from fltea.recording.table import Rows, gather
from fltea.recording.text_rows import TextReader
from fltea.recording.units import parse_units
from fltea.records.errors import Implausible, UsageError
from fltea.settings.how import AS_IT_SAYS, How
from fltea.settings.limits import DEFAULT_LIMITS, Limits

BLOCK_BYTES = 1 << 18
HEAD_BYTES = 1 << 18
HEAD_LINES = 10_000
"""A text is refused if its first HEAD_LINES lines neither name the columns nor hold a row of numbers."""


def open_csv(
    path: Path,
    how: How = AS_IT_SAYS,
    limits: Limits = DEFAULT_LIMITS,
    file: BinaryIO | None = None,
    head: Sequence[str] = (),
) -> Stored:
    """Read a gyroscope's columns from a text file in one pass, as `TextReader` does with live text.

    `file`: the open file, if the caller has opened it. `head`: lines from elsewhere in the file that describe
    these columns.

    Raises:
        UsageError: the columns are ambiguous, or no line holds a sample; the message names file, line and
            reason.
    """
    if how.units is not None:
        parse_units(how.units)
    reader = TextReader(str(path), how, head)
    reader.most_before = HEAD_LINES
    try:
        with file or path.open("rb") as stream:
            rows: Iterator[Rows] = _rows(path, reader, stream)
            first = next(rows, None)
            if first is None or reader.chosen is None:
                raise reader.refusal(is_file=True)
            rows = chain([first], rows)
            found = gather(path, reader.chosen, rows, limits, lambda line: f"{path}:{line}")
    except OSError as error:
        raise UsageError(f"{path}: cannot be read as CSV ({error}).") from error
    except UsageError as error:
        if isinstance(error, Implausible):
            error = reader.with_columns(error)
        bad = reader.bad.first
        if reader.chosen is not None and bad is not None and bad.why not in str(error):
            lines = f"{reader.left_out} of {reader.lines} lines hold no sample"
            error.args = (f"{error}\n{lines}; the first is {bad.line}: {bad.why}",)
        raise error from None
    return found._replace(notes=(*_notes(path, reader), *found.notes))


def _rows(path: Path, reader: TextReader, stream: BinaryIO) -> Iterator[Rows]:
    """Yield all rows of the text; raise UsageError if the columns are unknown after HEAD_BYTES."""
    size = 0
    while data := stream.read1(BLOCK_BYTES) if hasattr(stream, "read1") else stream.read(BLOCK_BYTES):
        size += len(data)
        yield from reader.feed(data)
        if reader.chosen is None and size - reader.pending_bytes >= HEAD_BYTES:
            raise reader.refusal(is_file=True)
    yield from reader.finish()


def _notes(path: Path, reader: TextReader) -> list[Note]:
    """Return warnings about the lines that hold no sample."""
    notes, first = list(reader.notes), reader.bad.first
    if reader.left_out and first is not None:
        text = f"the first of {reader.left_out} lines that hold no sample and are left out: {first.why}"
        notes.append(Note("bad_lines", f"{path}:{first.line}: {text}"))
    return notes if reader.cut is None else [*notes, reader.cut]
