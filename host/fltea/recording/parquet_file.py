"""Recordings in Parquet files, as pandas and polars write them. Loads pyarrow, which is an extra."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pyarrow as pa
from pyarrow import compute, parquet

from fltea.recording.column_names import is_time
from fltea.recording.columns import Chosen, choose
from fltea.recording.files import AT_ONCE, Stored, listed
from fltea.recording.npz_arrays import NUMBER_BYTES
from fltea.recording.table import Rows, gather, row_place
from fltea.records.errors import UsageError
from fltea.settings.how import AS_IT_SAYS, How
from fltea.settings.limits import DEFAULT_LIMITS, Limits


def open_parquet(path: Path, how: How = AS_IT_SAYS, limits: Limits = DEFAULT_LIMITS) -> Stored:
    """Read the columns of a gyroscope; those in structures are called `angular_velocity.x`.

    A column of time stamps says its unit, and is the one of times if no other is.

    Raises:
        UsageError: not such a file, columns that hold no numbers, or what `table.gather` refuses.
    """
    try:
        with path.open("rb") as file, parquet.ParquetFile(file, pre_buffer=False) as found:
            schema = _flat(pa.Table.from_batches([], found.schema_arrow)).schema
            rows = found.metadata.num_rows
            names = list(schema.names)
            stamps = {name: schema.field(name).type.unit for name in names if _is_stamp(schema, name)}
            if how.time_column is None and len(stamps) == 1 and not any(map(is_time, names)):
                how = msgspec.structs.replace(how, time_column=next(iter(stamps)))
            chosen = choose(str(path), names, None, len(names), how)
            if chosen.time is not None and names[chosen.time] in stamps:
                chosen = chosen._replace(time_unit=stamps[names[chosen.time]])
            text = [name for name in chosen.read if name not in stamps and not _is_number(schema, name)]
            if text:
                raise UsageError(f"{path}: column {listed(text)} does not hold numbers.")
            if rows * len(chosen.places) * NUMBER_BYTES > limits.whole_bytes:
                size_bytes = rows * len(chosen.places) * NUMBER_BYTES
                raise limits.whole_too_large(f"{path}: declares {rows} rows", size_bytes)
            return gather(path, chosen, _blocks(found, chosen), how, limits, partial(row_place, path))
    except (OSError, ValueError, RecursionError, pa.ArrowException) as error:
        reason = str(error).partition("\n")[0]
        raise UsageError(f"{path}: cannot be read as Parquet ({reason}).") from error


def _blocks(file: parquet.ParquetFile, chosen: Chosen) -> Iterator[Rows]:
    row, begin = 0, None
    for batch in file.iter_batches(AT_ONCE, columns=chosen.read, use_threads=False):
        table = _flat(pa.Table.from_batches([batch]))
        values = np.empty((len(table), len(chosen.places)))
        for i, name in enumerate(chosen.read):
            column = table.column(name)
            if pa.types.is_temporal(column.type):
                column = column.cast(pa.int64())
                if begin is None:
                    begin = next((stamp.as_py() for stamp in column if stamp.is_valid), None)
                column = compute.subtract(column, begin or 0)  # floats tell Unix times to 0.2 µs only
            values[:, i] = column.cast(pa.float64(), safe=False).to_numpy()
        numbers = np.arange(row, row + len(table))
        yield Rows(numbers, chosen.scale(values), numbers)
        row += len(table)


def _flat(table: Any) -> Any:
    while any(pa.types.is_struct(field.type) for field in table.schema):
        table = table.flatten()
    return table


def _is_number(schema: Any, name: str) -> bool:
    kind = schema.field(name).type if schema.names.count(name) == 1 else pa.float64()
    numbers = pa.types.is_integer, pa.types.is_floating, pa.types.is_boolean, pa.types.is_decimal
    return any(is_kind(kind) for is_kind in numbers)


def _is_stamp(schema: Any, name: str) -> bool:
    if schema.names.count(name) != 1:
        return False
    kind = schema.field(name).type
    return bool(pa.types.is_timestamp(kind) or pa.types.is_duration(kind))
