"""Blocks of samples out of the bytes of one port, by the native decoder.

The rules are those of protocol/README.md. What comes out is what `fltea.wire.messages.FrameReader` gives,
which stays as the oracle; only the samples come as columns instead of one object each.
"""

from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from fltea import _native
from fltea.wire.framing import BadFrame
from fltea.wire.layout import MESSAGES, Hello
from fltea.wire.messages import Frame, Refused, VersionMismatch, check_version


class SampleColumns(NamedTuple):
    """SAMPLE frames that follow each other without anything between them, n ≥ 1 of them."""

    sequence: NDArray[np.uint16]
    """Number of the sampling instant, modulo 2**16; shape (n,)."""
    device_us: NDArray[np.uint32]
    """Device time since boot, modulo 2**32 [us]; shape (n,)."""
    gyro: NDArray[np.int16]
    """Rates about x, y, z; HELLO gives the scale [LSB]; shape (n, 3)."""
    accel: NDArray[np.int16]
    """Specific force along x, y, z; HELLO gives the scale [LSB]; shape (n, 3)."""
    temperature: NDArray[np.int16]
    """Die temperature [LSB]; shape (n,)."""
    flags: NDArray[np.uint8]
    """Bits of `wire.SampleFlags`; shape (n,)."""
    end: NDArray[np.int64]
    """Offset within the bytes of the call, just behind the frame's closing 0x00 [bytes]; shape (n,)."""


class Located(NamedTuple):
    """Anything that is not a sample, and where it ended."""

    item: Frame | Refused | BadFrame
    """The item as `fltea.wire.messages.FrameReader` gives it; a `Frame` is never a SAMPLE here."""
    end: int
    """Offset within the bytes of the call, just behind the closing 0x00 [bytes].

    An oversize block ends behind the byte that made it too long, as it is given before its 0x00 has come.
    """


Decoded: TypeAlias = SampleColumns | Located


class BlockReader:
    """Bytes of one port in, blocks of samples and everything else out, in the order of the bytes.

    It counts the bytes fed (`bytes_in`, which runs on over `reset`) and nothing else. What comes out depends
    on the bytes alone, never on their chunks, except that a run of samples ends where its call does.
    """

    def __init__(self) -> None:
        self.bytes_in = 0
        self._decoder = _native.Decoder()

    def reset(self) -> None:
        """Begin again on a reopened port: drop the unfinished block; the next one may be partial again."""
        self._decoder.reset()

    @property
    def pending(self) -> int:
        """The number of bytes in the unfinished block."""
        return self._decoder.pending

    def feed(self, data: bytes | bytearray | memoryview) -> list[Decoded]:
        """Return what ends in `data`. Never raises, whatever the bytes are.

        A `Refused` stands where a HELLO of another version came. The caller must interpret nothing after it.
        """
        self.bytes_in += len(data)
        columns, others = self._decoder.feed(data)
        if not others:
            return [] if columns is None else [SampleColumns._make(columns)]
        found: list[Decoded] = []
        given = 0
        for row, end, reason, type, sequence, device_us, content in others:
            if columns is not None and row > given:
                found.append(SampleColumns._make([column[given:row] for column in columns]))
                given = row
            if reason is None:
                found.append(Located(_read(type, sequence, device_us, content), end))
            else:
                found.append(Located(BadFrame(reason, content), end))
        if columns is not None and given < len(columns[0]):
            found.append(SampleColumns._make([column[given:] for column in columns]))
        return found


def _read(type: int, sequence: int, device_us: int, payload: bytes) -> Frame | Refused:
    """Return an intact frame, of whose type and length the decoder has made sure."""
    if type == Hello.TYPE:
        try:
            check_version(payload)
        except VersionMismatch as mismatch:
            return mismatch.device
    return Frame(type, sequence, device_us, MESSAGES[type].unpack(payload))
