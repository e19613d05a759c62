"""Types of decoded frames, and the encoder of frames (protocol/README.md).

The native decoder reads frames (`fltea.wire.block_reader`).
"""

from struct import Struct
from typing import Final, NamedTuple
from zlib import crc32

# The package cobs is an independent implementation, so it does not share a fault in the device's encoder. It
# is a fast C extension.
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
    "crc": "CRC-32 does not fit",
    "length": "CRC fits, but the payload is shorter than its type demands",
    "unknown_type": "intact, of a type that this version does not know",
}
"""Texts for the reasons why a block is a `BadFrame`."""

CRC_SIZE: Final = 4
VERSION: Final = Struct("<BBI")
"""Major version, minor version and schema hash: the first bytes of a HELLO in every version."""


class Frame(NamedTuple):
    """One undamaged frame with a known message."""

    type: int
    """Type byte, as in `wire.MESSAGES`."""
    sequence: int
    """Number of the frame among the frames of its type, modulo 2**16."""
    device_us: int
    """Device time since boot, modulo 2**32 [us]."""
    message: Message
    """The payload in raw counts."""


class BadFrame(NamedTuple):
    """A damaged block, or a frame of a type that this program does not know."""

    reason: str
    """Reason for the refusal: a key of `REASONS`."""
    data: bytes
    """The block as it arrived, COBS-encoded, without its 0x00; a block that is too long is cut at
    `MAX_ENCODED`."""


class Refused(NamedTuple):
    """The version in an intact HELLO whose protocol version this program cannot read.

    Nothing else that this device sends may be interpreted.
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
    """Return the version in a HELLO's payload if this program cannot read that version; None if it can.

    Other major versions and unknown layouts are refused. A later minor version only adds messages and fields,
    so the messages of this version can still be read.
    """
    device = Refused(*VERSION.unpack_from(payload))
    known = device.protocol_minor > PROTOCOL_MINOR or device.schema_hash in SCHEMA_HASHES
    return None if known and device.protocol_major == PROTOCOL_MAJOR else device


def encode(message: Message, sequence: int, device_us: int) -> bytes:
    """Return the message as one frame for the wire, including the closing 0x00.

    `sequence`: number of the frame, wrapped by the caller to 0 to 65535.
    `device_us`: device time, wrapped by the caller to 0 to 2**32 - 1 [us].

    Raises:
        struct.error: a number does not fit its field.
        ValueError: a text or bytes do not fit their field.
    """
    return encode_frame(message.TYPE, sequence, device_us, message.pack())


def encode_frame(type: int, sequence: int, device_us: int, payload: bytes) -> bytes:
    """Return one frame in the form in which it is sent, including the closing 0x00.

    The device has its own encoder. This function is for simulated devices, tests and benchmarks.

    `device_us`: device time since boot, modulo 2**32 [us].

    Raises:
        ValueError: the payload is longer than `MAX_PAYLOAD`.
        struct.error: a number does not fit its field in the header.
    """
    if len(payload) > MAX_PAYLOAD:
        raise ValueError(f"payload of {len(payload)} bytes; at most {MAX_PAYLOAD} fit")
    body = HEADER.pack(type, sequence, device_us) + payload
    block: bytes = cobs.encode(body + crc32(body).to_bytes(CRC_SIZE, "little"))
    return block + b"\0"
