"""Tables of Arrow: Parquet and Feather, as pandas and polars write them."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fltea.recording.files import AT_ONCE
from fltea.recording.one_sensor import MOST_SENSORS
from fltea.recording.sample_times import SECONDS, Floats
from fltea.recording.sheet import Sheet

FEATHER = b"ARROW1"


def read(path: Path, _: str) -> Sheet:
    """Read columns of a Parquet or Feather file; those in structures are called `angular_velocity.x`."""
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


def _arrow(schema: Any, rows: int, batches: Callable[[list[str]], Iterator[Any]]) -> Sheet:
    import pyarrow as pa
    from pyarrow import compute

    flat = _flat(pa.Table.from_batches([], schema)).schema
    names = list(flat.names)
    kinds = [field.type for field in flat]
    stamps = [n for n, kind in zip(names, kinds, strict=True) if _is_stamp(kind)]

    is_bad = [not (_is_stamp(kind) or _is_number(kind)) for kind in kinds]
    words = {n: _words(batches([n]), n) for n, bad in zip(names, is_bad, strict=True) if bad}
    words = {name: some for name, some in words.items() if some}
    doubts = {
        name: f"holds {kind}, no numbers."
        for name, kind, bad in zip(names, kinds, is_bad, strict=True)
        if bad
    }

    def blocks(places: Sequence[int]) -> Iterator[Floats]:
        begin = None
        for batch in batches([names[p] for p in places]):
            table = _flat(pa.Table.from_batches([batch]))
            values = np.empty((len(table), len(places)))
            for i, place in enumerate(places):
                if names[place] in words:
                    column = table.column(names[place]).cast(pa.string())
                    values[:, i] = compute.index_in(column, pa.array(words[names[place]])).to_numpy()
                    continue
                if is_bad[place]:
                    values[:, i] = np.nan
                    continue
                column, scale = table.column(names[place]), 1.0
                if _is_stamp(kinds[place]):
                    column, scale = column.cast(pa.int64()), SECONDS[kinds[place].unit]
                    if begin is None:
                        begin = next((stamp.as_py() for stamp in column if stamp.is_valid), None)
                    column = compute.subtract(column, begin or 0)  # floats tell Unix times to 0.2 µs only
                values[:, i] = column.cast(pa.float64(), safe=False).to_numpy() * scale
            for first in range(0, len(values), AT_ONCE):
                yield values[first : first + AT_ONCE]

    units = [_unit(field.metadata or {}) for field in flat]
    return Sheet(names, units, rows, stamps=tuple(stamps), doubts=doubts, words=words, blocks=blocks)


def _words(batches: Iterator[Any], name: str) -> list[str]:
    """What stands in a column of texts; none if that is too much to be names of sensors."""
    import pyarrow as pa

    found: set[str] = set()
    for batch in batches:
        column = _flat(pa.Table.from_batches([batch])).column(name)
        if not _is_text(column.type):
            return []
        found |= {one for one in column.unique().to_pylist() if one is not None}
        if len(found) > MOST_SENSORS:
            return []
    return sorted(found)


def _unit(metadata: Mapping[bytes, bytes]) -> str:
    return next(
        (metadata[key].decode(errors="replace") for key in (b"units", b"unit") if key in metadata), ""
    )


def _flat(table: Any) -> Any:
    import pyarrow as pa

    while any(pa.types.is_struct(field.type) for field in table.schema):
        table = table.flatten()
    return table


def _is_number(kind: Any) -> bool:
    from pyarrow import types

    numbers = types.is_integer, types.is_floating, types.is_boolean, types.is_decimal
    return any(is_kind(kind) for is_kind in numbers)


def _is_text(kind: Any) -> bool:
    from pyarrow import types

    kind = kind.value_type if types.is_dictionary(kind) else kind
    return bool(types.is_string(kind) or types.is_large_string(kind) or types.is_string_view(kind))


def _is_stamp(kind: Any) -> bool:
    from pyarrow import types

    return bool(types.is_timestamp(kind) or types.is_duration(kind))
