"""Reads Arrow tables: Parquet and Feather files, in the forms that pandas and polars write."""

import contextlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np

from fltea.recording.column_names import is_time, named_axis, states_units, tells_sensors
from fltea.recording.files import AT_ONCE
from fltea.recording.one_sensor import MOST_SENSORS
from fltea.recording.readers import file_facts
from fltea.recording.readers.arrays import MOST_WIDE
from fltea.recording.sample_times import DAY_S, SECONDS, Floats
from fltea.recording.sheet import SAMPLE_ROWS, Sheet
from fltea.recording.text_labels import flat
from fltea.recording.text_times import points_of_time

FEATHER = b"ARROW1"

Batches = Callable[[list[str]], Iterator[Any]]
"""Function that takes names of columns, and yields a table in batches of rows with at least these columns."""


def read(path: Path, _: str) -> Sheet:
    """Read a Parquet or Feather file. A structure's field becomes a column, such as `angular_velocity.x`."""
    import pyarrow as pa
    from pyarrow import parquet

    with path.open("rb") as begin:
        is_feather = begin.read(len(FEATHER)) == FEATHER
    if is_feather:
        stored = pa.ipc.open_file(pa.memory_map(str(path)))
        batches = range(stored.num_record_batches)
        rows = sum(stored.get_batch(k).num_rows for k in batches)
        return _arrow(stored.schema, rows, lambda _: (stored.get_batch(k) for k in batches))
    file = parquet.ParquetFile(path, pre_buffer=False)
    return _arrow(
        file.schema_arrow,
        file.metadata.num_rows,
        lambda names: file.iter_batches(AT_ONCE, columns=names, use_threads=False),
    )


class _Column(NamedTuple):
    """A column of the table.

    `source`: the file's column from which the values come. The values in it may be lists: then this column
    is one element of each list.
    `place`: index of this element; None if the values are no lists. `of`: number of elements of a list.
    `kind`: Arrow type of the values, or of the elements. `is_date`: whether they are texts of dates or times
    of day. `words`: the different texts, if they are so few that they may distinguish sensors.
    """

    label: str
    source: str
    kind: Any
    place: int | None = None
    of: int = 1
    is_date: bool = False
    words: Sequence[str] = ()

    @property
    def is_stamp(self) -> bool:
        """Whether the values are dates or times of day."""
        return self.is_date or _is_stamp(self.kind)

    @property
    def is_bad(self) -> bool:
        """Whether the values are neither numbers, nor times, nor words that distinguish sensors."""
        return not (self.is_stamp or self.words or _is_number(self.kind))


def _arrow(schema: Any, rows: int, batches: Batches) -> Sheet:
    columns = list(_columns(schema, batches))
    facts = _facts(schema)
    said, units = file_facts.units_of(facts), []
    doubts = {one.label: f"holds {one.kind}, no numbers." for one in columns if one.is_bad}
    changed: dict[str, str] = {}
    for one in columns:
        units.append(file_facts.unit_of(said, one.label, one.source, one.place or 0, one.of))
        is_whole = "int" in str(one.kind)
        scale = file_facts.scale_of(facts, one.source, [one.label], units[-1], is_whole=is_whole)
        if scale and is_time(one.label):
            doubts.setdefault(one.label, f"{scale} may change its numbers, and the file does not say how.")
        elif scale:
            changed[one.label] = scale

    def blocks(places: Sequence[int]) -> Iterator[Floats]:
        readers = [_Reader(columns[place]) for place in places]
        for batch in batches([columns[place].source for place in places]):
            values = np.stack([one.read(_flat(batch)) for one in readers], axis=1)
            for first in range(0, len(values), AT_ONCE):
                yield values[first : first + AT_ONCE]

    return Sheet(
        [one.label for one in columns],
        units,
        rows,
        stamps=tuple(one.label for one in columns if one.is_stamp),
        rates=file_facts.rates_of(facts),
        doubts=doubts,
        changed=changed,
        words={one.label: list(one.words) for one in columns if one.words},
        blocks=blocks,
    )


class _Reader:
    """Reads the numbers of one column from a table's batches, in order."""

    def __init__(self, column: _Column) -> None:
        self._column = column
        self._begin: int | None = None
        self._last_s = self._passed_s = 0.0

    def read(self, table: Any) -> Floats:
        """Return the column's numbers in a batch: seconds for times, and for a word its index in `words`."""
        import pyarrow as pa
        from pyarrow import compute

        one = self._column
        values, scale = table.column(one.source), 1.0
        if one.place is not None:
            lengths = compute.list_value_length(values)
            values = compute.if_else(compute.equal(lengths, one.of), values, pa.scalar(None, values.type))
            values = pa.chunked_array([compute.list_element(values.combine_chunks(), one.place)])
        if one.words:
            values = compute.index_in(values.cast(pa.string()), pa.array(one.words))
        elif one.is_date:
            return self._seconds_of(values.cast(pa.string()).to_pylist())
        elif one.is_bad:
            return np.full(len(values), np.nan)
        elif one.is_stamp:
            scale = SECONDS[one.kind.unit]
            values = values.cast(pa.int32()) if pa.types.is_time32(one.kind) else values
            values = values.cast(pa.int64())
            if self._begin is None and not pa.types.is_time(one.kind):
                self._begin = next((stamp.as_py() for stamp in values if stamp.is_valid), None)
            # The first date is subtracted before the conversion to float, which resolves Unix times only to
            # 0.2 µs.
            values = compute.subtract(values, self._begin or 0)
        return np.asarray(values.cast(pa.float64(), safe=False).to_numpy() * scale)

    def _seconds_of(self, texts: Sequence[str | None]) -> Floats:
        points = points_of_time(texts, is_known=True)
        assert points is not None
        known = points[~np.isnat(points)]
        if self._begin is None and len(known):
            self._begin = int(known[0].astype(np.int64))
        seconds = (points - np.datetime64(self._begin or 0, "ns")) / np.timedelta64(1, "s") + self._passed_s
        first, last = (seconds[np.isfinite(seconds)][[0, -1]]) if len(known) else (self._last_s, self._last_s)
        if first < self._last_s - DAY_S / 2:  # the time of day fell: midnight is between two batches
            self._passed_s += DAY_S
            seconds, last = seconds + DAY_S, last + DAY_S
        self._last_s = float(last)
        return np.asarray(seconds)


def _columns(schema: Any, batches: Batches) -> Iterator[_Column]:
    """Yield all columns. Fields of structures and elements of lists of equal length are columns, too."""
    import pyarrow as pa
    from pyarrow import compute

    for field in _flat(pa.Table.from_batches([], schema)).schema:
        name, kind = field.name, field.type
        is_list = pa.types.is_list(kind) or pa.types.is_large_list(kind) or pa.types.is_fixed_size_list(kind)
        if not (is_list or _is_text(kind)):
            yield _Column(name, name, kind)
            continue
        first = next((_flat(batch).column(name).drop_null() for batch in batches([name])), None)
        if first is None or not len(first):
            yield _Column(name, name, kind)
        elif is_list:
            width = int(compute.max(compute.list_value_length(first)).as_py())
            labels = [named_axis(name, k) if width == 3 else f"{name}#{k + 1}" for k in range(width)]
            inner = kind.value_type if 1 < width <= MOST_WIDE else kind
            found = [_Column(label, name, inner, k, width) for k, label in enumerate(labels)]
            yield from found if inner is not kind else [_Column(name, name, kind)]
        else:
            is_date = points_of_time(first.cast(pa.string())[:SAMPLE_ROWS].to_pylist()) is not None
            words = _words(batches([name]), name) if tells_sensors(name) or states_units(name) else []
            yield _Column(name, name, kind, is_date=is_date, words=words)


def _facts(schema: Any) -> dict[str, Any]:
    """Return the metadata of the file and of its columns, which include the `attrs` of pandas."""
    facts: dict[str, Any] = {}
    for key, value in (schema.metadata or {}).items():
        name, text = key.decode(errors="replace"), value.decode(errors="replace")
        if not text.startswith("{"):
            facts[name] = text
            continue
        with contextlib.suppress(msgspec.DecodeError, RecursionError):
            found = msgspec.json.decode(text)
            facts |= flat(found.get("attributes") or {} if name == "pandas" else found)

    def add_metadata(prefix: str, field: Any) -> None:
        is_group = bool(field.type.num_fields) and hasattr(field.type, "get_field_index")
        for key, value in (field.metadata or {}).items():
            mark = "." if is_group else "@"
            facts[f"{prefix}{field.name}{mark}{key.decode(errors='replace')}"] = value.decode(
                errors="replace"
            )
        for k in range(field.type.num_fields if is_group else 0):
            add_metadata(f"{prefix}{field.name}.", field.type.field(k))

    for field in schema:
        add_metadata("", field)
    return facts


def _words(batches: Iterator[Any], name: str) -> list[str]:
    """Return the different texts of a column; empty if there are too many to be names of sensors."""
    found: set[str] = set()
    for batch in batches:
        found |= {one for one in _flat(batch).column(name).unique().to_pylist() if one is not None}
        if len(found) > MOST_SENSORS:
            return []
    return sorted(found)


def _flat(table: Any) -> Any:
    import pyarrow as pa

    table = pa.Table.from_batches([table]) if isinstance(table, pa.RecordBatch) else table
    while any(pa.types.is_struct(field.type) for field in table.schema):
        table = table.flatten()
    return table


def _is_number(kind: Any) -> bool:
    from pyarrow import types

    kind = kind.value_type if types.is_dictionary(kind) else kind
    numbers = types.is_integer, types.is_floating, types.is_boolean, types.is_decimal
    return any(is_kind(kind) for is_kind in numbers)


def _is_text(kind: Any) -> bool:
    from pyarrow import types

    kind = kind.value_type if types.is_dictionary(kind) else kind
    return bool(types.is_string(kind) or types.is_large_string(kind) or types.is_string_view(kind))


def _is_stamp(kind: Any) -> bool:
    from pyarrow import types

    return bool(types.is_timestamp(kind) or types.is_duration(kind) or types.is_time(kind))
