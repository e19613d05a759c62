"""Cuts text, .npy files and bags of ROS 1 into pieces.

A file with errors is not cut but read whole, so that the errors are reported.
"""

import io
import math
import struct
from itertools import pairwise

import numpy as np

from fltea.cluster.cut import Cut, Ranges, even_pieces
from fltea.recording.bag_ros1 import VERSION
from fltea.recording.bag_ros1_records import LENGTH, Op, next_record
from fltea.recording.csv_file import HEAD_BYTES
from fltea.recording.npz_arrays import read_header
from fltea.recording.raw_lines import LONGEST_LINE, UTF_16
from fltea.recording.text_rows import TextReader
from fltea.records.errors import UsageError
from fltea.settings.how import How

NEAR_BYTES = 1 << 12
"""The end of a line of text is searched for in this many bytes at first, and then in a longer range."""
NPY_HEAD_BYTES = 1 << 16
BAG_HEADER_BYTES = 4096 + 256
MOST_INDEX_BYTES = 256 << 20
PLACE = struct.Struct("<Q")


def of_text(source: Ranges, block_bytes: int, how: How) -> list[Cut]:
    """Cut text at line ends.

    Each piece begins with the header lines. The file is not cut if its columns are not recognised.
    """
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
    return [Cut(b, e, head) for b, e in pairwise([*places, size])]


def _line_from(source: Ranges, place: int) -> int | None:
    """Return the offset at which the next line of text begins; None if there is none."""
    for length in (NEAR_BYTES, LONGEST_LINE):
        found = source.read(place, place + length).find(b"\n")
        if found >= 0:
            return place + found + 1
    return None


def of_npy(source: Ranges, block_bytes: int) -> list[Cut]:
    """Cut an array between rows; each piece gets its own header.

    An array that is stored column by column is not cut.
    """
    try:
        found = read_header(io.BytesIO(source.read(0, NPY_HEAD_BYTES)), source.file.url)
    except (ValueError, struct.error):
        return []
    shape, by_columns, dtype, begin = found
    if not shape or (by_columns and len(shape) > 1) or dtype.hasobject:
        return []
    row_bytes = math.prod(shape[1:]) * dtype.itemsize
    if row_bytes == 0 or begin + shape[0] * row_bytes != source.size:
        return []
    pieces = max(1, math.ceil(shape[0] * row_bytes / block_bytes))
    cuts, descr = [], np.lib.format.dtype_to_descr(dtype)
    for first, last in pairwise(round(shape[0] * k / pieces) for k in range(pieces + 1)):
        head = io.BytesIO()
        about = {"descr": descr, "fortran_order": False, "shape": (last - first, *shape[1:])}
        np.lib.format.write_array_header_2_0(head, about)
        cuts.append(Cut(begin + first * row_bytes, begin + last * row_bytes, head.getvalue()))
    return cuts


def of_bag(source: Ranges, block_bytes: int) -> list[Cut]:
    """Cut a bag between chunks.

    Each piece begins with the descriptions of the topics. A bag without an index is not cut.
    """
    begin = io.BytesIO(source.read(len(VERSION), len(VERSION) + BAG_HEADER_BYTES))
    header = next_record(begin, source.size)
    if header is None or header.fields.get(b"op") != Op.BAG_HEADER:
        return []
    place = header.fields.get(b"index_pos", b"")
    index_at = PLACE.unpack(place)[0] if len(place) == PLACE.size else 0
    if not 0 < index_at < source.size or source.size - index_at > MOST_INDEX_BYTES:
        return []
    data = source.read(index_at, source.size)
    index = io.BytesIO(data)
    topics, chunks = b"", []
    at = 0
    while (record := next_record(index, len(data))) is not None:
        index.seek(record.length, 1)
        if record.fields.get(b"op") == Op.CONNECTION:
            topics += data[at : index.tell()]
        elif record.fields.get(b"op") == Op.CHUNK_INFO and len(record.fields.get(b"chunk_pos", b"")) == 8:
            chunks.append(PLACE.unpack(record.fields[b"chunk_pos"])[0])
        at = index.tell()
    head = VERSION + _bag_header() + topics
    return [Cut(b, e, head) for b, e in even_pieces(sorted(chunks), index_at, block_bytes)]


def _bag_header() -> bytes:
    """Return a bag header for a piece. It states a properly closed bag whose index has no chunks."""
    fields = ((b"op", Op.BAG_HEADER), (b"index_pos", PLACE.pack(1)), (b"chunk_count", LENGTH.pack(0)))
    pairs = b"".join(LENGTH.pack(len(name) + 1 + len(value)) + name + b"=" + value for name, value in fields)
    return LENGTH.pack(len(pairs)) + pairs + LENGTH.pack(0)
