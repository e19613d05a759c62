"""Frames on the wire: COBS and the closing 0x00 (protocol/README.md, "Framing").

Pure: bytes in, bytes out. What the frames hold is the business of `fltea.wire.messages`.
"""

from typing import Final, NamedTuple
from zlib import crc32

# COBS as a C extension: fast, and not ours, so a misreading of COBS in the device's encoder shows here
# instead of being shared.
from cobs import cobs

from fltea.wire.layout import HEADER, MAX_ENCODED, MAX_PAYLOAD

CRC_SIZE: Final = 4


class BadFrame(NamedTuple):
    """A block that is not a frame that this program understands.

    The reasons are listed in `fltea.wire.messages.REASONS`. `data` is the block as it came, COBS still on and
    without the 0x00; of an oversize run it is the first `MAX_ENCODED` bytes.
    """

    reason: str
    data: bytes


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


class Deframer:
    """Cuts a byte stream into frames.

    What it returns depends on the bytes alone, never on how they were cut into chunks, and between calls it
    keeps at most `MAX_ENCODED` bytes.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget the unfinished block, as after a port was closed and opened again."""
        self._pending = b""
        self._discarding = False

    @property
    def pending(self) -> int:
        """The number of bytes in the unfinished block."""
        return len(self._pending)

    def feed(self, data: bytes) -> list[bytes | BadFrame]:
        """Return the frames that end in `data`, COBS removed and CRC still on, in their order.

        A block that is not COBS stands in its place as `BadFrame("cobs", …)`. A run of more than
        `MAX_ENCODED` bytes without 0x00 is one `BadFrame("oversize", …)`, given as soon as the run is too
        long; the rest of the run is discarded. Empty blocks are idle 0x00 and give nothing. Never raises.
        """
        blocks = (self._pending + data).split(b"\0")
        self._pending = blocks.pop()
        found: list[bytes | BadFrame] = []
        if self._discarding and blocks:
            del blocks[0]
            self._discarding = False
        for block in blocks:
            if not block:
                continue
            if len(block) > MAX_ENCODED:
                found.append(BadFrame("oversize", block[:MAX_ENCODED]))
                continue
            try:
                found.append(cobs.decode(block))
            except cobs.DecodeError:
                found.append(BadFrame("cobs", block))
        if self._discarding:
            self._pending = b""
        elif len(self._pending) > MAX_ENCODED:
            found.append(BadFrame("oversize", self._pending[:MAX_ENCODED]))
            self._pending = b""
            self._discarding = True
        return found
