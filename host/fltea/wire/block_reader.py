"""Decodes the bytes of one port to blocks of samples and single frames, with the native decoder.

The rules of decoding are in protocol/README.md.
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
    """The columns of n ≥ 1 consecutive SAMPLE frames, between which no other frame came."""

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
    """End of each frame, its closing 0x00 included, as an offset in the bytes of the call [bytes]; shape
    (n,)."""

    def frames(self) -> Iterator[Frame]:
        """Yield each sample as a single frame."""
        numbers = (column.tolist() for column in self[:-1])
        for sequence, device_us, gyro, accel, temperature, flags in zip(*numbers, strict=True):
            yield Frame(Sample.TYPE, sequence, device_us, Sample._make((*gyro, *accel, temperature, flags)))


class Located(NamedTuple):
    """A decoded item that is not a sample, with its end in the bytes of the call."""

    item: Frame | Refused | BadFrame
    """A frame other than SAMPLE, a refused HELLO, or a bad frame."""
    end: int
    """End of the item, its closing 0x00 included, as an offset in the bytes of the call [bytes].

    A block that is too long ends after the first surplus byte, since it is reported before its 0x00 comes.
    """


Decoded: TypeAlias = SampleColumns | Located


class BlockReader:
    """Decodes the bytes of one port to blocks of samples and other items, in the order of the bytes.

    The only counter here is `bytes_in`, the number of bytes fed, which `reset` does not change. The items
    depend only on the bytes, not on how the bytes are split into calls, except that a block of samples ends
    with its call.
    """

    def __init__(self) -> None:
        self.bytes_in = 0
        self._decoder = _native.Decoder()

    def reset(self) -> None:
        """Start again after the port was reopened: drop the unfinished block.

        The next block may be incomplete.
        """
        self._decoder.reset()

    @property
    def pending(self) -> int:
        """Number of bytes in the unfinished block."""
        return self._decoder.pending

    def feed(self, data: bytes | bytearray | memoryview) -> list[Decoded]:
        """Return all items that end in `data`. This method never raises, whatever the bytes are.

        A HELLO of another protocol version gives a `Refused`; the caller must not interpret any later item.
        """
        self.bytes_in += len(data)
        columns, others = self._decoder.feed(data)
        if not others:
            return [] if columns is None else [SampleColumns._make(columns)]
        items: list[Decoded] = []
        given = 0
        for row, end, reason, type, sequence, device_us, content in others:
            if columns is not None and row > given:
                items.append(SampleColumns._make([column[given:row] for column in columns]))
                given = row
            if reason is None:
                items.append(Located(_read(type, sequence, device_us, content), end))
            else:
                items.append(Located(BadFrame(reason, content), end))
        if columns is not None and given < len(columns[0]):
            items.append(SampleColumns._make([column[given:] for column in columns]))
        return items


def _read(type: int, sequence: int, device_us: int, payload: bytes) -> Frame | Refused:
    """Return an intact frame; the decoder has already checked its type and length."""
    refused = refusal(payload) if type == Hello.TYPE else None
    return refused or Frame(type, sequence, device_us, MESSAGES[type].unpack(payload))


class FrameReader:
    """Decodes the bytes of one port to single frames.

    `counts`: number of good frames under "frames", and number of bad frames under each reason in `REASONS`. A
    `Refused` is not counted; the caller counts it and the frames after it.
    """

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self._blocks = BlockReader()

    @property
    def bytes_in(self) -> int:
        """Number of bytes fed."""
        return self._blocks.bytes_in

    def feed(self, data: bytes) -> list[Frame | Refused]:
        """Return the good frames that end in `data`; bad frames are only counted. This method never raises.

        A HELLO of another protocol version gives a `Refused`; the caller must not interpret any later frame.
        """
        return [item for item in self.feed_all(data) if not isinstance(item, BadFrame)]

    def feed_all(self, data: bytes) -> list[Frame | Refused | BadFrame]:
        """Return the good and bad frames that end in `data`, in order. This method never raises."""
        items: list[Frame | Refused | BadFrame] = []
        for decoded in self._blocks.feed(data):
            items += decoded.frames() if isinstance(decoded, SampleColumns) else [decoded.item]
        self.counts.update(
            "frames" if isinstance(item, Frame) else item.reason
            for item in items
            if not isinstance(item, Refused)
        )
        return items
