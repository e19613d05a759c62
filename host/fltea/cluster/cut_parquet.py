"""Cuts Parquet files into pieces of several row groups. This module loads pyarrow, an optional package."""

from pathlib import Path

import pyarrow as pa
from pyarrow import parquet

from fltea.cluster.content import open_bytes
from fltea.cluster.cut import Cut, Ranges, even_pieces
from fltea.cluster.fetch import check_room
from fltea.cluster.listing import File
from fltea.records.errors import UsageError
from fltea.records.temporary import named_file

AT_ONCE = 1 << 16
"""Number of rows that are copied at a time."""


def cuts(source: Ranges, block_bytes: int) -> list[Cut]:
    """Return the pieces, each with its range of row groups; an empty list if the file is damaged."""
    try:
        with open_bytes(source.file) as stream, parquet.ParquetFile(stream, pre_buffer=False) as found:
            places = [0]
            for k in range(found.num_row_groups):
                group = found.metadata.row_group(k)
                stored = sum(group.column(i).total_compressed_size for i in range(group.num_columns))
                places.append(places[-1] + stored)
    except (ValueError, pa.ArrowException):
        return []
    pieces = even_pieces(places[:-1], places[-1], block_bytes)
    return [Cut(places.index(begin), places.index(end)) for begin, end in pieces]


def write_groups(file: File, cut: Cut, folder: Path) -> Path:
    """Write the row groups of a piece to a Parquet file in `folder`; return its path."""
    path = folder / "piece.parquet"
    try:
        with open_bytes(file) as stream, parquet.ParquetFile(stream, pre_buffer=False) as found:
            stored = sum(found.metadata.row_group(k).total_byte_size for k in range(cut.begin, cut.end))
            check_room(file, stored, folder)
            with (
                named_file(path) as piece,
                parquet.ParquetWriter(piece, found.schema_arrow, compression="none") as out,
            ):
                for batch in found.iter_batches(AT_ONCE, range(cut.begin, cut.end), use_threads=False):
                    out.write_batch(batch)
    except (ValueError, pa.ArrowException) as error:
        raise UsageError(f"{file.url}: cannot be read as Parquet ({error}).") from error
    return path
