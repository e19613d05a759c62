"""Define what a worker needs to continue with a device in place of another worker.

It needs the states of the device's estimators, and the number of the device's last processed message.
"""

import zlib
from typing import Annotated

import msgspec

from fltea.records.records import Hello
from fltea.stream.snapshot import DeviceState

LARGEST = 1_000_000
"""Largest size of a snapshot [bytes]. By default, a NATS server accepts messages of up to 1 MiB."""


class Kept(msgspec.Struct, frozen=True):
    """Snapshot of a device after message `mark` of the broker's stream.

    `state`: the estimators; None while the start-up window fills. `hello`: the device's newest HELLO, so that
    its samples can be used at once. `unix_ns`: Unix time at which the snapshot was taken [ns].
    """

    mark: Annotated[int, msgspec.Meta(ge=0)]
    unix_ns: int
    hello: Hello | None = None
    state: DeviceState | None = None


def pack(kept: Kept) -> bytes | None:
    """Return the snapshot as bytes; None if it is too large for a message."""
    data = zlib.compress(msgspec.msgpack.encode(kept), 1)
    return data if len(data) <= LARGEST else None


def unpack(data: bytes) -> Kept | None:
    """Return the snapshot that `pack` has converted to these bytes.

    Return None for other bytes, such as those that another version of the program has stored.
    """
    try:
        unpacker = zlib.decompressobj()
        whole = unpacker.decompress(data, 16 * LARGEST)
        return None if unpacker.unconsumed_tail else msgspec.msgpack.decode(whole, type=Kept)
    except (zlib.error, msgspec.DecodeError):
        return None
