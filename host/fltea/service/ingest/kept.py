"""What another worker needs to go on with a device: its estimators, and how far it has come (pure)."""

import zlib
from typing import Annotated

import msgspec

from fltea.records.records import Hello
from fltea.stream.snapshot import DeviceState

LARGEST = 1_000_000
"""Bytes; a NATS server takes messages of a MiB by default."""


class Kept(msgspec.Struct, frozen=True):
    """After the message `mark` of the stream. state: None while the start-up window fills.

    hello: the newest HELLO of the device, so that its samples can be used at once. unix_ns: when.
    """

    mark: Annotated[int, msgspec.Meta(ge=0)]
    unix_ns: int
    hello: Hello | None = None
    state: DeviceState | None = None


def pack(kept: Kept) -> bytes | None:
    """Bytes of it; None if they are more than a message may have."""
    data = zlib.compress(msgspec.msgpack.encode(kept), 1)
    return data if len(data) <= LARGEST else None


def unpack(data: bytes) -> Kept | None:
    """What `pack` put together; None for anything else, such as of another version of this program."""
    try:
        unpacker = zlib.decompressobj()
        whole = unpacker.decompress(data, 16 * LARGEST)
        return None if unpacker.unconsumed_tail else msgspec.msgpack.decode(whole, type=Kept)
    except (zlib.error, msgspec.DecodeError):
        return None
