"""Messages out of frames: CRC, version, length, fields (protocol/README.md, "Messages" and "Versions").

Exceptions::

    ProtocolError
    ├── FrameError        a frame that is damaged or of no known kind; has a reason
    └── VersionMismatch   an intact HELLO of a device that this program must not interpret
"""

from collections import Counter
from struct import Struct, error
from typing import Final, NamedTuple
from zlib import crc32

from cobs import cobs  # the reason stands in fltea.wire.framing

from fltea.wire.framing import CRC_SIZE, BadFrame, Deframer, encode_frame
from fltea.wire.layout import HEADER, MESSAGES, PROTOCOL_MAJOR, PROTOCOL_MINOR, SCHEMA_HASH, Hello, Message

REASONS: Final = {
    "partial": "the end of a frame whose start was not heard: normal when attaching",
    "cobs": "not a COBS block",
    "oversize": "no 0x00 within the length of the longest frame",
    "short": "shorter than header and CRC",
    "crc": "CRC-32 does not fit",
    "length": "CRC fits, but the payload is not as long as its type demands",
    "unknown_type": "intact, of a type that this version does not know",
}
"""Every reason that `FrameReader.counts` counts, in plain words; its further key is "frames" (good ones)."""

# What the end of a frame can look like to a receiver that heard only that end.
_CUT: Final = frozenset({"cobs", "oversize", "short", "crc"})

# CRC-32 over anything followed by its own CRC-32 in little-endian gives this constant (CRC-32/ISO-HDLC in the
# RevEng catalogue: residue 0xDEBB20E3 before the final inversion), which saves cutting the four bytes off.
_CRC_RESIDUE: Final = 0x2144DF1C

_SMALLEST: Final = HEADER.size + CRC_SIZE
_VERSION: Final = Struct("<BBI")


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


class ProtocolError(Exception):
    """Something came over the wire that this program cannot use."""


class FrameError(ProtocolError):
    """A frame that is damaged or of no known kind."""

    def __init__(self, reason: str, detail: str) -> None:
        super().__init__(f"{reason}: {detail}")
        self.reason = reason
        """One of `REASONS`."""
        self.detail = detail
        """What was found and what was expected."""


class VersionMismatch(ProtocolError):
    """The device speaks another protocol version; the text names both."""

    def __init__(self, device: Refused) -> None:
        super().__init__(device.message)
        self.device = device


def encode(message: Message, sequence: int, device_us: int) -> bytes:
    """Return the message as one frame on the wire, closing 0x00 included.

    `sequence` (0 to 65535) and `device_us` (microseconds, 0 to 2**32 - 1) are wrapped by the caller. Raises
    `struct.error` for a number and `ValueError` for text or bytes that do not fit their fields.
    """
    return encode_frame(message.TYPE, sequence, device_us, message.pack())


def decode(body: bytes) -> Frame:
    """Return the frame in `body`: COBS removed, CRC still on.

    Raises `FrameError` with reason "short", "crc", "unknown_type" or "length", and `VersionMismatch` for an
    intact HELLO of another version, whatever its length.
    """
    if len(body) < _SMALLEST:
        raise FrameError("short", f"{len(body)} bytes; a frame has at least {_SMALLEST}")
    if crc32(body) != _CRC_RESIDUE:
        sent = int.from_bytes(body[-CRC_SIZE:], "little")
        raise FrameError("crc", f"0x{crc32(body[:-CRC_SIZE]):08X}; the frame says 0x{sent:08X}")
    type, sequence, device_us = HEADER.unpack_from(body)
    payload = body[HEADER.size : -CRC_SIZE]
    if type == Hello.TYPE:
        check_version(payload)
    kind = MESSAGES.get(type)
    if kind is None:
        raise FrameError("unknown_type", f"type {type} with {len(payload)} bytes of payload")
    try:
        return Frame(type, sequence, device_us, kind.unpack(payload))
    except error:
        raise FrameError(
            "length", f"{kind.__name__} with {len(payload)} bytes of payload; it has {kind.SIZE}"
        ) from None


def check_version(payload: bytes) -> None:
    """Raise `VersionMismatch` if the payload of a HELLO states another major version or schema hash.

    Major, minor and hash are the first six bytes in every version; a payload without them raises
    `FrameError("length", …)`. Another minor version alone passes.
    """
    if len(payload) < _VERSION.size:
        raise FrameError("length", f"Hello with {len(payload)} bytes of payload; the version alone takes 6")
    device = Refused(*_VERSION.unpack_from(payload))
    if device.protocol_major != PROTOCOL_MAJOR or device.schema_hash != SCHEMA_HASH:
        raise VersionMismatch(device)


class FrameReader:
    """Bytes of one port in, frames out; counts everything on the way.

    `counts` holds "frames" (good ones) and the `REASONS`, and only what occurred; a `Refused` is left to the
    caller, who has to count what follows it too. `bytes_in` counts the bytes fed. Both run on over `reset`.
    What comes out depends on the bytes alone, never on their chunks.
    """

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self.bytes_in = 0
        self._deframer = Deframer()
        self._attaching = True

    def reset(self) -> None:
        """Start again on a reopened port: drop the unfinished block; the next one may be partial again."""
        self._deframer.reset()
        self._attaching = True

    def feed(self, data: bytes) -> list[Frame | Refused]:
        """Return the good frames that end in `data`; the bad ones are only counted. Never raises.

        A `Refused` stands where a HELLO of another version came. The caller must interpret nothing after it.
        """
        return [item for item in self.feed_all(data) if not isinstance(item, BadFrame)]

    def feed_all(self, data: bytes) -> list[Frame | Refused | BadFrame]:
        """Return the good frames and, in their places, the bad ones. Never raises."""
        self.bytes_in += len(data)
        found: list[Frame | Refused | BadFrame] = []
        if self._attaching:
            # A block counts as partial only before the first 0x00: after it, the start of each is known.
            end = data.find(0) + 1
            first, data = (data[:end], data[end:]) if end else (data, b"")
            for item in map(self._read, self._deframer.feed(first)):
                if isinstance(item, BadFrame) and item.reason in _CUT:
                    item = BadFrame("partial", item.data)
                found.append(item)
            self._attaching = not end
        found += map(self._read, self._deframer.feed(data))
        good = 0
        for item in found:
            if isinstance(item, Frame):
                good += 1
            elif isinstance(item, BadFrame):
                self.counts[item.reason] += 1
        if good:
            self.counts["frames"] += good
        return found

    @staticmethod
    def _read(body: bytes | BadFrame) -> Frame | Refused | BadFrame:
        if isinstance(body, BadFrame):
            return body
        try:
            return decode(body)
        except FrameError as bad:
            # The block as it came: at this length only one COBS block decodes to a given body.
            return BadFrame(bad.reason, cobs.encode(body))
        except VersionMismatch as mismatch:
            return mismatch.device
