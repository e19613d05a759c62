"""Defines the types of decoded frames, and encodes frames (protocol/README.md).

The native decoder decodes frames (`fltea.wire.block_reader`).
"""

from struct import Struct
from typing import Final, NamedTuple
from zlib import crc32

# The package `cobs` was written independently of the device's encoder. It therefore does not have the same
# faults, and tests can compare the two. The package is fast where its C extension is installed.
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
    "partial": "the end of a frame whose start was not received: normal when the port is opened",
    "cobs": "not a COBS block",
    "oversize": "no 0x00 within the length of the longest frame",
    "short": "shorter than header and CRC",
    "crc": "CRC-32 does not match",
    "length": "CRC-32 matches, but the payload is shorter than that of any message of this type",
    "unknown_type": "an intact frame of a type that this version does not know",
}
"""For each reason why a block of bytes is a `BadFrame`, a short text that explains it."""

CRC_SIZE: Final = 4
VERSION: Final = Struct("<BBI")
"""Layout of the bytes with which a HELLO of every protocol version begins: major version, minor version and
schema hash.
"""


class Frame(NamedTuple):
    """One undamaged frame with a known message."""

    type: int
    """Number of the message's type, as in `wire.MESSAGES`."""
    sequence: int
    """Sequence number of the frame, counted for each type of message separately, modulo 2**16."""
    device_us: int
    """Device time since boot, modulo 2**32 [us]."""
    message: Message
    """The decoded message, with numbers as they were sent."""


class BadFrame(NamedTuple):
    """A damaged block, or a frame of a type that this program does not know."""

    reason: str
    """Why the frame cannot be used: a key of `REASONS`."""
    data: bytes
    """The bytes of the block as they arrived, COBS-encoded, without the closing 0x00. Of a longer block, only
    the first `MAX_ENCODED` bytes are kept.
    """


class Refused(NamedTuple):
    """The protocol version that an undamaged HELLO states and this program cannot read.

    After such a HELLO, nothing else that the device sends may be interpreted.
    """

    protocol_major: int
    protocol_minor: int
    schema_hash: int

    @property
    def message(self) -> str:
        """Error message that names the device's and this program's versions."""
        return (
            f"device speaks protocol {self.protocol_major}.{self.protocol_minor}, schema "
            f"0x{self.schema_hash:08X}; this fltea speaks {PROTOCOL_MAJOR}.{PROTOCOL_MINOR}, schema "
            f"0x{SCHEMA_HASH:08X}"
        )


def refusal(payload: bytes) -> Refused | None:
    """Return the protocol version of a HELLO if this program cannot read that version; None if it can.

    Other major versions and unknown layouts are refused. A later minor version only adds messages and fields,
    so the messages of this version can still be read.
    """
    device = Refused(*VERSION.unpack_from(payload))
    known = device.protocol_minor > PROTOCOL_MINOR or device.schema_hash in SCHEMA_HASHES
    return None if known and device.protocol_major == PROTOCOL_MAJOR else device


def encode(message: Message, sequence: int, device_us: int) -> bytes:
    """Return the message as the bytes of one frame, including the closing 0x00.

    `sequence`: number of the frame, wrapped by the caller to 0 to 65535.
    `device_us`: device time, wrapped by the caller to 0 to 2**32 - 1 [us].

    Raises:
        struct.error: a number does not fit its field.
        ValueError: a text or bytes do not fit their field.
    """
    return encode_frame(message.TYPE, sequence, device_us, message.pack())


def encode_frame(type: int, sequence: int, device_us: int, payload: bytes) -> bytes:
    """Return the bytes of one frame as they are sent, including the closing 0x00.

    Only simulated devices, tests and benchmarks use this function; a real device has its own encoder.

    `device_us`: device time since boot, modulo 2**32 [us].

    Raises:
        ValueError: the payload is longer than `MAX_PAYLOAD`.
        struct.error: a number does not fit its field in the header.
    """
    if len(payload) > MAX_PAYLOAD:
        raise ValueError(f"payload has {len(payload)} bytes; a frame has room for at most {MAX_PAYLOAD}")
    body = HEADER.pack(type, sequence, device_us) + payload
    block: bytes = cobs.encode(body + crc32(body).to_bytes(CRC_SIZE, "little"))
    return block + b"\0"
