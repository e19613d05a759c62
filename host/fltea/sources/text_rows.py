"""Lines of text that come live, as rows of numbers: CSV or NDJSON, whatever the sender says (pure).

A line that holds no sample is counted by its reason and left out; nothing that a sender writes ends the
reading. What looks like a sample and cannot be read stands for a lost one, so it takes a number.
"""

import math
from collections import Counter
from collections.abc import Sequence
from typing import Any, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from fltea.recording.files import LARGEST_DPS, LARGEST_NUMBER, parse_units
from fltea.recording.lines import shown
from fltea.records.errors import UsageError
from fltea.records.records import AXES
from fltea.sources.numbering import Rows

LONGEST_LINE = 1 << 16
"""Bytes; a line of samples has a hundred."""

COMMENTS = (b"#", b"%", b"//")
SEPARATORS = (b",", b";", b"\t", None)
"""The last: white space."""

SAMPLE_BEGINS = b'0123456789+-.,;"{'
"""With what a line begins that was meant as a sample (or with `nan`); all else is a message of the sender."""

REASONS = {
    "text": "is no line of numbers",
    "fields": "has another number of fields than the others",
    "number": "holds what is no number",
    "not_finite": "has an empty field, NaN or infinity: a missing sample",
    "too_large": f"is beyond {LARGEST_DPS:g} deg/s; are the units right?",
    "time": "has a time that cannot be",
    "columns": "is an object without the columns",
    "too_long": f"has no end within {LONGEST_LINE} bytes",
    "before_header": "came before the columns were known",
}
"""Why a line holds no sample: key of its count in `link.bad_frames`, and what a person is told."""

_decode = msgspec.json.Decoder(dict[str, Any]).decode


class Wanted(NamedTuple):
    """What the user asks for.

    columns: names, or positions from 1, of the axes; None for gyro_x_dps …. time: name of the column of
    times, or None. factor, lsb: as of `parse_units`.
    """

    columns: tuple[str, ...] | None
    time: str | None
    factor: float
    lsb: float | None


class _Layout(NamedTuple):
    """Where the numbers stand: keys of an object, or places among `fields` fields."""

    keys: tuple[str, ...]
    places: tuple[int, ...] = ()
    fields: int = 0
    separator: bytes | None = None

    @property
    def is_json(self) -> bool:
        return not self.fields


def wanted(columns: Sequence[str] | None, units: str | None, time: str | None) -> Wanted:
    """Check what the user says of the columns.

    Raises:
        UsageError: an unknown unit, too many columns, or one of them twice.
    """
    factor, lsb = parse_units(units or "deg/s")
    if columns is not None and not 1 <= len(columns) <= len(AXES):
        raise UsageError(f"--columns names {len(columns)} columns; a gyroscope has up to {len(AXES)} axes.")
    names = [*(columns or ()), *([time] if time else [])]
    if len(set(names)) < len(names):
        raise UsageError(f"--columns {','.join(columns or ())}: each column is to be named once.")
    return Wanted(None if columns is None else tuple(columns), time, factor, lsb)


class LineRows:
    """Turns bytes, cut anywhere, into rows.

    counts: lines without a sample, by their reason. newest: the newest such line with its reason. headers:
    how often the sender named the columns; each time it began again.
    """

    def __init__(self, wanted: Wanted) -> None:
        self.wanted = wanted
        self.counts: Counter[str] = Counter()
        self.newest: tuple[str, str] | None = None
        self.next_ordinal = self.headers = 0
        self._layout: _Layout | None = None
        self._rest = b""
        self._skipping = False

    @property
    def knows_columns(self) -> bool:
        """Whether a line has said where the numbers stand."""
        return self._layout is not None

    def resume(self, *, within_line: bool) -> None:
        """The sender was lost and is back; within_line: what comes first may be the end of a line."""
        self._rest, self._skipping = b"", within_line

    def feed(self, data: bytes) -> Rows | None:
        """Take bytes; what the lines that end in them hold, None if that is nothing."""
        if self._skipping:
            _, end, data = data.partition(b"\n")
            if not end:
                return None
            self._skipping = False
        data = self._rest + data
        end_at = data.rfind(b"\n") + 1
        self._rest = data[end_at:]
        if len(self._rest) > LONGEST_LINE:
            self._bad("too_long", self._rest)
            self._rest, self._skipping = b"", True
        return self._rows(data[:end_at].split(b"\n")[:-1]) if end_at else None

    def finish(self) -> Rows | None:
        """The sender has ended: its last line may lack its end."""
        rest, self._rest = self._rest, b""
        return self._rows([rest]) if rest else None

    def _rows(self, lines: list[bytes]) -> Rows | None:
        while self._layout is None and lines:
            if not self._learn(lines[0]):
                lines = lines[1:]
        if not lines:
            return None
        values = self._fast(lines)
        if values is not None:
            ordinal = self.next_ordinal + np.arange(len(values))
            self.next_ordinal += len(values)
        else:
            found = [self._one(line) for line in lines]
            kept = [entry for entry in found if entry is not None]
            if not kept:
                return None
            axes = len(kept[-1][1])
            kept = [entry for entry in kept if len(entry[1]) == axes]  # of the newest header
            ordinal = np.array([entry[0] for entry in kept], dtype=np.int64)
            values = np.array([entry[1] for entry in kept])
        if self.wanted.time is None:
            return Rows(values, None, ordinal)
        return Rows(values[:, :-1], values[:, -1], ordinal)

    def _learn(self, line: bytes) -> bool:
        """Find the columns in a line; True if it also holds a sample."""
        text = line.strip().removeprefix(b"\xef\xbb\xbf")
        layout = _of_object(text, self.wanted) if text.startswith(b"{") else _of_header(text, self.wanted)
        if layout is None and not text.startswith(b"{"):
            layout = _of_numbers(text, self.wanted)
        elif layout is not None and not layout.is_json:
            self._layout = layout
            self.headers += 1
            return False
        self._layout = layout
        if layout is None and text and not text.startswith(COMMENTS):
            self._bad("before_header", text)
        return layout is not None

    def _fast(self, lines: list[bytes]) -> NDArray[np.float64] | None:
        """All lines at once; None if one of them needs a closer look."""
        layout = self._layout
        assert layout is not None
        try:
            if layout.is_json:
                objects = [_decode(line) for line in lines]
                columns = [[entry[key] for entry in objects] for key in layout.keys]
                if not {type(value) for column in columns for value in column} <= {int, float}:
                    return None
            else:
                rows = [line.split(layout.separator) for line in lines]
                if {len(row) for row in rows} != {layout.fields}:
                    return None
                columns = [[row[place] for row in rows] for place in layout.places]
                if any(b"_" in b"".join(column) for column in columns):  # 1_0 is a number in Python only
                    return None
            values = np.array([list(map(float, column)) for column in columns]).T
        except (ValueError, KeyError, OverflowError, RecursionError):  # msgspec's errors are ValueErrors
            return None
        values = self._scaled(values)
        return values if self._why_not(values) is None else None

    def _scaled(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        with np.errstate(over="ignore"):
            values[:, : len(values.T) - (self.wanted.time is not None)] *= self.wanted.factor
        return values

    def _why_not(self, values: NDArray[np.float64]) -> str | None:
        """Why numbers are no samples: the first reason that applies to any of them."""
        gyro = values if self.wanted.time is None else values[:, :-1]
        if not np.isfinite(values).all():
            return "not_finite"
        if (np.abs(gyro) > LARGEST_DPS * (self.wanted.lsb or 1.0)).any():
            return "too_large"
        if self.wanted.time is not None and (np.abs(values[:, -1]) > LARGEST_NUMBER * 1e3).any():
            return "time"
        return None

    def _one(self, line: bytes) -> tuple[int, list[float]] | None:
        """One line by itself: its number and its values; None if it holds no sample."""
        text = line.strip()
        if not text or text.startswith(COMMENTS):
            return None
        assert self._layout is not None
        found = _object(text, self._layout) if self._layout.is_json else _fields(line, text, self._layout)
        if isinstance(found, list):
            values = self._scaled(np.array([found]))
            reason = self._why_not(values)
            if reason is None:
                self.next_ordinal += 1
                return self.next_ordinal - 1, values[0].tolist()
            found = reason
        elif not self._layout.is_json:
            header = _of_header(text, self.wanted)  # the sender has begun again
            if header is not None:
                self._layout = header
                self.headers += 1
                return None
        self.next_ordinal += found not in ("columns", "text")
        self._bad(found, text)
        return None

    def _bad(self, reason: str, line: bytes) -> None:
        self.counts[reason] += 1
        self.newest = reason, shown(line[:200].decode("utf-8", "replace"))


def _of_object(text: bytes, wanted: Wanted) -> _Layout | None:
    try:
        keys = _decode(text)
    except (ValueError, RecursionError):
        return None
    names = wanted.columns or tuple(f"{axis}_dps" for axis in AXES if f"{axis}_dps" in keys)
    names += (wanted.time,) if names and wanted.time is not None else ()
    return _Layout(names) if names and all(name in keys for name in names) else None


def _of_header(text: bytes, wanted: Wanted) -> _Layout | None:
    text = text.lstrip(b"#%/ ")
    separator = next((s for s in SEPARATORS if s is None or s in text), None)
    fields = text.split(separator)
    header = [field.strip().strip(b'"').strip().decode("utf-8", "replace") for field in fields]
    names = wanted.columns or tuple(f"{axis}_dps" for axis in AXES if f"{axis}_dps" in header)
    names += (wanted.time,) if names and wanted.time is not None else ()
    if not names or any(header.count(name) != 1 for name in names) or all(name.isdigit() for name in names):
        return None
    return _Layout(names, tuple(header.index(name) for name in names), len(header), separator)


def _of_numbers(text: bytes, wanted: Wanted) -> _Layout | None:
    """Without a header columns go by their positions, or there are no others than those that were named."""
    separator = next((s for s in SEPARATORS if s is None or s in text), None)
    fields = text.split(separator)
    names = (wanted.columns or ()) + ((wanted.time,) if wanted.time is not None else ())
    if wanted.columns is None:
        return None
    if all(name.isdecimal() and name.isascii() and 1 <= int(name) <= len(fields) for name in names):
        places = tuple(int(name) - 1 for name in names)  # other fields may be words, as of `ros2 topic echo`
    elif wanted.time is None and len(names) == len(fields):
        places = tuple(range(len(fields)))
    else:
        return None
    try:
        for place in places:
            float(fields[place])
    except ValueError:
        return None
    return _Layout(names, places, len(fields), separator)


def _object(text: bytes, layout: _Layout) -> list[float] | str:
    if not text.startswith(b"{"):
        return "text"
    try:
        found = _decode(text)
    except (ValueError, RecursionError):
        return "number"
    if not all(key in found for key in layout.keys):
        return "columns"
    values = [found[key] for key in layout.keys]
    if any(value is None for value in values):
        return "not_finite"
    if not {type(value) for value in values} <= {int, float}:
        return "number"
    try:
        return list(map(float, values))
    except OverflowError:
        return "too_large"


def _fields(line: bytes, text: bytes, layout: _Layout) -> list[float] | str:
    if text[0] not in SAMPLE_BEGINS and text[:3].lower() != b"nan":
        return "text"
    fields = line.split(layout.separator)
    if len(fields) == layout.fields + 1 and not fields[-1].strip():
        del fields[-1]
    if len(fields) != layout.fields:
        return "fields"
    chosen = [fields[place].strip() for place in layout.places]
    if any(b"_" in field for field in chosen):  # 1_0 is a number in Python only
        return "number"
    try:
        return [float(field) if field else math.nan for field in chosen]
    except ValueError:
        return "number"
