"""Pieces of bags of ROS 1: some chunks each, behind what the bag says of its topics."""

import struct
from io import BytesIO

from fltea.cluster.cut import Cut, Ranges, even_pieces
from fltea.recording.bag_ros1 import LENGTH, VERSION, Op, next_record

HEADER_BYTES = 4096 + 256
MOST_INDEX_BYTES = 256 << 20
PLACE = struct.Struct("<Q")


def cuts(source: Ranges, block_bytes: int) -> list[Cut]:
    """Return where it may be cut; nowhere if it was not closed, and has no index."""
    begin = BytesIO(source.read(len(VERSION), len(VERSION) + HEADER_BYTES))
    header = next_record(begin, source.size)
    if header is None or header.fields.get(b"op") != Op.BAG_HEADER:
        return []
    place = header.fields.get(b"index_pos", b"")
    index_at = PLACE.unpack(place)[0] if len(place) == PLACE.size else 0
    if not 0 < index_at < source.size or source.size - index_at > MOST_INDEX_BYTES:
        return []
    data = source.read(index_at, source.size)
    index = BytesIO(data)
    topics, chunks = b"", []
    while True:
        at = index.tell()
        record = next_record(index, len(data))
        if record is None:
            break
        index.seek(record.length, 1)
        if record.fields.get(b"op") == Op.CONNECTION:
            topics += data[at : index.tell()]
        elif record.fields.get(b"op") == Op.CHUNK_INFO and len(record.fields.get(b"chunk_pos", b"")) == 8:
            chunks.append(PLACE.unpack(record.fields[b"chunk_pos"])[0])
    head = VERSION + _header() + topics
    return [Cut(b, e, head) for b, e in even_pieces(sorted(chunks), index_at, block_bytes)]


def _header() -> bytes:
    """Of a bag that was closed, and has no chunks in its index."""
    fields = ((b"op", Op.BAG_HEADER), (b"index_pos", PLACE.pack(1)), (b"chunk_count", LENGTH.pack(0)))
    pairs = b"".join(LENGTH.pack(len(name) + 1 + len(value)) + name + b"=" + value for name, value in fields)
    return LENGTH.pack(len(pairs)) + pairs + LENGTH.pack(0)
