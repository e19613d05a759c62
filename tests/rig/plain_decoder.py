"""Decode a whole stream of bytes with PyPI's cobs and zlib, as the oracle of the native decoder.

This decoder follows protocol/README.md literally, and shares only the layout of messages with the program.
"""

import struct
from collections.abc import Iterable
from typing import NamedTuple
from zlib import crc32

from cobs import cobs
from fltea.wire import layout as wire
from fltea.wire.block_reader import BlockReader, SampleColumns
from fltea.wire.messages import BadFrame, Frame, Refused

CUT = ("cobs", "oversize", "short", "crc")
"""Kinds of errors that can occur when a receiver gets only the end of a frame."""


class Found(NamedTuple):
    """A frame or an error that was decoded from the bytes.

    `end`: offset, from the first of all bytes, of the byte that follows the frame or error.
    """

    item: Frame | Refused | BadFrame
    end: int


def decoded(data: bytes) -> list[Found]:
    """Return all frames and errors that end within `data`, which are all bytes received since a port was
    opened.
    """
    found: list[Found] = []
    begin = 0
    blocks = data.split(b"\0")
    for number, block in enumerate(blocks):
        end = begin + len(block) + 1
        item: Frame | Refused | BadFrame | None = None
        # An oversized block is reported at the byte that makes it too long.
        if len(block) > wire.MAX_ENCODED:
            item, end_of_item = BadFrame("oversize", block[: wire.MAX_ENCODED]), begin + wire.MAX_ENCODED + 1
        elif block and number < len(blocks) - 1:
            item, end_of_item = of_block(block), end
        if number == 0 and isinstance(item, BadFrame) and item.reason in CUT:
            item = BadFrame("partial", item.data)
        if item is not None:
            found.append(Found(item, end_of_item))
        begin = end
    return found


def unfinished(data: bytes) -> int:
    """Return the number of bytes in the last block, whose end has not arrived."""
    last = len(data.rpartition(b"\0")[2])
    return 0 if last > wire.MAX_ENCODED else last


def of_block(block: bytes) -> Frame | Refused | BadFrame:
    """Decode the bytes between two bytes 0x00, which are one encoded frame."""
    try:
        body = cobs.decode(block)
    except cobs.DecodeError:
        return BadFrame("cobs", block)
    if len(body) < wire.HEADER.size + 4:
        return BadFrame("short", block)
    if crc32(body[:-4]).to_bytes(4, "little") != body[-4:]:
        return BadFrame("crc", block)
    kind, sequence, device_us = wire.HEADER.unpack_from(body)
    payload = body[wire.HEADER.size : -4]
    if kind == wire.Hello.TYPE and len(payload) >= 6:
        major, minor, schema = struct.unpack_from("<BBI", payload)
        if major != wire.PROTOCOL_MAJOR or (
            minor <= wire.PROTOCOL_MINOR and schema not in wire.SCHEMA_HASHES
        ):
            return Refused(major, minor, schema)
    if kind not in wire.MESSAGES:
        return BadFrame("unknown_type", block)
    try:
        return Frame(kind, sequence, device_us, wire.MESSAGES[kind].unpack(payload))
    except struct.error:
        return BadFrame("length", block)


def in_chunks(reader: BlockReader, chunks: Iterable[bytes]) -> list[Found]:
    """Return the frames and errors that the native decoder finds in these chunks, in the form that `decoded`
    returns.
    """
    found: list[Found] = []
    for chunk in chunks:
        before = reader.bytes_in
        for one in reader.feed(chunk):
            if isinstance(one, SampleColumns):
                found += map(Found, one.frames(), (before + one.end).tolist())
            else:
                found.append(Found(one.item, before + one.end))
    return found
