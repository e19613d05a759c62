"""Write the history as a Parquet file, which many programs for tables can read."""

import itertools
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from fltea.fleet.databases import Database
from fltea.fleet.history import COLUMNS, FIGURES
from fltea.records.whole_file import whole_file

AT_ONCE = 50_000

SCHEMA = pa.schema(
    [
        ("unix_s", pa.float64()),
        ("device_id", pa.string()),
        ("axis", pa.string()),
        ("verdict", pa.string()),
        ("samples", pa.int64()),
        *((name, pa.float64()) for name in FIGURES),
    ]
)


def write(database: Database, out: Path) -> int:
    """Write all rows of fits to `out`, and return their number.

    The file is written completely or not at all.
    """
    count = 0
    try:
        with whole_file(out) as file, pq.ParquetWriter(file, SCHEMA) as writer:
            rows = database.rows(f"SELECT {', '.join(COLUMNS)} FROM fit ORDER BY unix_s, device_id, axis")
            while block := list(itertools.islice(rows, AT_ONCE)):
                columns = zip(*block, strict=True)
                arrays = [pa.array(c, field.type) for c, field in zip(columns, SCHEMA, strict=True)]
                writer.write_batch(pa.record_batch(arrays, schema=SCHEMA))
                count += len(block)
    finally:
        database.close()
    assert SCHEMA.names == COLUMNS
    return count
