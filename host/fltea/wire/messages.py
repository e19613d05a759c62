"""Frames and their messages: what is read from the wire, and how one is written (protocol/README.md).

The native decoder reads them (`fltea.wire.block_reader`).
"""

from struct import Struct
from typing import Final, NamedTuple
from zlib import crc32

# COBS as a C extension: fast, and not ours, so a misreading of COBS in the device's encoder shows here
# instead of being shared.
from cobs import cobs

from fltea.wire.layout import (
    HEADER,
    MAX_PAYLOAD,
    PROTOCOL_MAJOR,
    PROTOCOL_MINOR,
    SCHEMA_HASH,
    SCHEMA_HASHES,
    Message,
)

REASONS: Final = {
    "partial": "the end of a frame whose start was not heard: normal when attaching",
    "cobs": "not a COBS block",
    "oversize": "no 0x00 within the length of the longest frame",
    "short": "shorter than header and CRC",
    "crc": "CRC-32 does not fit",
    "length": "CRC fits, but the payload is shorter than its type demands",
    "unknown_type": "intact, of a type that this version does not know",
}
"""Why a block is a `BadFrame`, in plain words."""

CRC_SIZE: Final = 4
VERSION: Final = Struct("<BBI")
"""Major and minor version and schema hash: the first bytes of a HELLO in every version."""


class Frame(NamedTuple):
    """One frame that is whole and whose message is known."""

    type: int
    """Type byte, as in `wire.MESSAGES`."""
    sequence: int
    """Number within the type, modulo 2**16."""
    device_us: int
    """Device time since boot, modulo 2**32 [us]."""
    message: Message
    """The payload in raw counts."""


class BadFrame(NamedTuple):
    """A block that is not a frame that this program understands."""

    reason: str
    """One of `REASONS`."""
    data: bytes
    """The block as it came, with COBS and without the 0x00; of an oversize run the first `MAX_ENCODED`."""


class Refused(NamedTuple):
    """What an intact HELLO of another protocol version said of itself.

    Nothing that this device sends may be interpreted.
    """

    protocol_major: int
    protocol_minor: int
    schema_hash: int

    @property
    def message(self) -> str:
        """The error for a person; it names both versions."""
        return (
            f"device speaks protocol {self.protocol_major}.{self.protocol_minor}, schema "
            f"0x{self.schema_hash:08X}; this fltea speaks {PROTOCOL_MAJOR}.{PROTOCOL_MINOR}, schema "
            f"0x{SCHEMA_HASH:08X}"
        )


def refusal(payload: bytes) -> Refused | None:
    """Return what is refused: the payload of a HELLO of another major version, or of an unknown layout.

    Later minor versions only add, so what they share with this one can be read.
    """
    device = Refused(*VERSION.unpack_from(payload))
    known = device.protocol_minor > PROTOCOL_MINOR or device.schema_hash in SCHEMA_HASHES
    return None if known and device.protocol_major == PROTOCOL_MAJOR else device


def encode(message: Message, sequence: int, device_us: int) -> bytes:
    """Return the message as one frame on the wire, closing 0x00 included.

    `sequence` (0 to 65535) and `device_us` (microseconds, 0 to 2**32 - 1) are wrapped by the caller. Raises
    `struct.error` for a number and `ValueError` for text or bytes that do not fit their fields.
    """
    return encode_frame(message.TYPE, sequence, device_us, message.pack())


def encode_frame(type: int, sequence: int, device_us: int, payload: bytes) -> bytes:
    """Return one frame as it goes on the wire, closing 0x00 included.

    The device has an encoder of its own; this one serves stand-ins, tests and benchmarks. `device_us` is in
    microseconds since boot, modulo 2**32. It raises `ValueError` when the payload is longer than
    `MAX_PAYLOAD` and `struct.error` when a number does not fit its place in the header.
    """
    if len(payload) > MAX_PAYLOAD:
        raise ValueError(f"payload of {len(payload)} bytes; at most {MAX_PAYLOAD} fit")
    body = HEADER.pack(type, sequence, device_us) + payload
    block: bytes = cobs.encode(body + crc32(body).to_bytes(CRC_SIZE, "little"))
    return block + b"\0"
