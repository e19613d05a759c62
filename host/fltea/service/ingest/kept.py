"""Define what another worker needs to continue with a device: its estimators, and its last message."""

import zlib
from typing import Annotated

import msgspec

from fltea.records.records import Hello
from fltea.stream.snapshot import DeviceState

LARGEST = 1_000_000
"""Most bytes of a snapshot, since a NATS server takes messages of 1 MiB by default."""


class Kept(msgspec.Struct, frozen=True):
    """A device's snapshot after message `mark` of the stream.

    `state`: the estimators; None while the start-up window fills. `hello`: the device's newest HELLO, so that
    its samples can be used at once. `unix_ns`: when it was taken.
    """

    mark: Annotated[int, msgspec.Meta(ge=0)]
    unix_ns: int
    hello: Hello | None = None
    state: DeviceState | None = None


def pack(kept: Kept) -> bytes | None:
    """Return the snapshot as bytes; None if they are more than a message may have."""
    data = zlib.compress(msgspec.msgpack.encode(kept), 1)
    return data if len(data) <= LARGEST else None


def unpack(data: bytes) -> Kept | None:
    """Return the snapshot in the bytes of `pack`; None for other data, such as another version's."""
    try:
        unpacker = zlib.decompressobj()
        whole = unpacker.decompress(data, 16 * LARGEST)
        return None if unpacker.unconsumed_tail else msgspec.msgpack.decode(whole, type=Kept)
    except (zlib.error, msgspec.DecodeError):
        return None
