"""Blocks of samples, or single frames, out of the bytes of one port, by the native decoder.

The rules are those of protocol/README.md.
"""

from collections import Counter
from collections.abc import Iterator
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from fltea import _native
from fltea.wire.layout import MESSAGES, Hello, Sample
from fltea.wire.messages import BadFrame, Frame, Refused, refusal


class SampleColumns(NamedTuple):
    """SAMPLE frames that follow each other without anything between them, n ≥ 1 of them."""

    sequence: NDArray[np.int64]
    """Number of the sampling instant, modulo 2**16; shape (n,)."""
    device_us: NDArray[np.int64]
    """Device time since boot, modulo 2**32 [us]; shape (n,)."""
    gyro: NDArray[np.int16]
    """Rates about x, y, z; HELLO gives the scale [LSB]; shape (n, 3)."""
    accel: NDArray[np.int16]
    """Specific force along x, y, z; HELLO gives the scale [LSB]; shape (n, 3)."""
    temperature: NDArray[np.int16]
    """Die temperature [LSB]; shape (n,)."""
    flags: NDArray[np.int64]
    """Bits of `wire.SampleFlags`; shape (n,)."""
    end: NDArray[np.int64]
    """Offset within the bytes of the call, just behind the frame's closing 0x00 [bytes]; shape (n,)."""

    def frames(self) -> Iterator[Frame]:
        """Yield the same, frame by frame."""
        numbers = (column.tolist() for column in self[:-1])
        for sequence, device_us, gyro, accel, temperature, flags in zip(*numbers, strict=True):
            yield Frame(Sample.TYPE, sequence, device_us, Sample._make((*gyro, *accel, temperature, flags)))


class Located(NamedTuple):
    """Anything that is not a sample, and where it ended."""

    item: Frame | Refused | BadFrame
    """A frame that is no SAMPLE, or no good frame."""
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
    refused = refusal(payload) if type == Hello.TYPE else None
    return refused or Frame(type, sequence, device_us, MESSAGES[type].unpack(payload))


class FrameReader:
    """Bytes of one port in, frames out, one by one.

    `counts` counts "frames" (good ones) and the `REASONS`, and only what occurred; a `Refused` is left to the
    caller, who has to count what follows it too.
    """

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self._blocks = BlockReader()

    @property
    def bytes_in(self) -> int:
        """The number of bytes fed."""
        return self._blocks.bytes_in

    def feed(self, data: bytes) -> list[Frame | Refused]:
        """Return the good frames that end in `data`; the bad ones are only counted. Never raises.

        A `Refused` stands where a HELLO of another version came. The caller must interpret nothing after it.
        """
        return [item for item in self.feed_all(data) if not isinstance(item, BadFrame)]

    def feed_all(self, data: bytes) -> list[Frame | Refused | BadFrame]:
        """Return the good frames and, in their places, the bad ones. Never raises."""
        found: list[Frame | Refused | BadFrame] = []
        for one in self._blocks.feed(data):
            found += one.frames() if isinstance(one, SampleColumns) else [one.item]
        self.counts.update(
            "frames" if isinstance(item, Frame) else item.reason
            for item in found
            if not isinstance(item, Refused)
        )
        return found
