"""Decodes the bytes from one port into blocks of samples and single frames, with the native decoder.

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
    """The columns of n ≥ 1 SAMPLE frames that came directly after one another."""

    sequence: NDArray[np.int64]
    """Number of the sampling instant, modulo 2**16; shape (n,)."""
    device_us: NDArray[np.int64]
    """Device time since boot, modulo 2**32 [us]; shape (n,)."""
    gyro: NDArray[np.int16]
    """Angular rates about x, y, z as raw counts, whose scale HELLO states; shape (n, 3)."""
    accel: NDArray[np.int16]
    """Specific force along x, y, z as raw counts, whose scale HELLO states; shape (n, 3)."""
    temperature: NDArray[np.int16]
    """Temperature of the sensor chip as raw counts; shape (n,)."""
    flags: NDArray[np.int64]
    """Bits of `wire.SampleFlags`; shape (n,)."""
    end: NDArray[np.int64]
    """Where each frame ends: the number of bytes from the first one passed to the call up to and including
    the frame's closing 0x00; shape (n,).
    """

    def frames(self) -> Iterator[Frame]:
        """Yield each sample as a single frame."""
        numbers = (column.tolist() for column in self[:-1])
        for sequence, device_us, gyro, accel, temperature, flags in zip(*numbers, strict=True):
            yield Frame(Sample.TYPE, sequence, device_us, Sample._make((*gyro, *accel, temperature, flags)))


class Located(NamedTuple):
    """A decoded item that is not a sample, and the place where it ends among the bytes."""

    item: Frame | Refused | BadFrame
    """A frame other than SAMPLE, a refused HELLO, or a bad frame."""
    end: int
    """Where the item ends: the number of bytes from the first one passed to `feed` in this call up to and
    including the item's closing 0x00.

    A COBS block that is too long is reported before its 0x00 arrives. It counts as ending with the first byte
    beyond the limit.
    """


Decoded: TypeAlias = SampleColumns | Located


class BlockReader:
    """Decodes the bytes from one port into blocks of samples and other items, in the order of arrival.

    `bytes_in` is the number of all bytes passed to `feed`; `reset` does not change it. The result does not
    depend on how the bytes are divided among calls of `feed`, with one exception: at the end of a call, a
    block of samples ends, too.
    """

    def __init__(self) -> None:
        self.bytes_in = 0
        self._decoder = _native.Decoder()

    def reset(self) -> None:
        """Begin again after the port was reopened. An unfinished frame is dropped.

        The beginning of the first frame after this call may be missing.
        """
        self._decoder.reset()

    @property
    def pending(self) -> int:
        """Number of bytes of the unfinished frame."""
        return self._decoder.pending

    def feed(self, data: bytes | bytearray | memoryview) -> list[Decoded]:
        """Return all items whose last byte is in `data`. This method never raises an exception.

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
    """Return an undamaged frame as a `Frame`. The native decoder has already checked its type and length."""
    refused = refusal(payload) if type == Hello.TYPE else None
    return refused or Frame(type, sequence, device_us, MESSAGES[type].unpack(payload))


class FrameReader:
    """Decodes the bytes from one port into single frames.

    `counts`: number of good frames under "frames", and number of bad frames under each reason in `REASONS`. A
    `Refused` is not counted here; the caller counts it and all frames after it.
    """

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self._blocks = BlockReader()

    @property
    def bytes_in(self) -> int:
        """Number of all bytes passed to `feed` and `feed_all`."""
        return self._blocks.bytes_in

    def feed(self, data: bytes) -> list[Frame | Refused]:
        """Return the good frames whose last byte is in `data`.

        Bad frames are only counted. No exception is raised. A HELLO of another protocol version gives a
        `Refused`; the caller must not interpret any later frame.
        """
        return [item for item in self.feed_all(data) if not isinstance(item, BadFrame)]

    def feed_all(self, data: bytes) -> list[Frame | Refused | BadFrame]:
        """Return the good and bad frames whose last byte is in `data`, in order. No exception is raised."""
        items: list[Frame | Refused | BadFrame] = []
        for decoded in self._blocks.feed(data):
            items += decoded.frames() if isinstance(decoded, SampleColumns) else [decoded.item]
        self.counts.update(
            "frames" if isinstance(item, Frame) else item.reason
            for item in items
            if not isinstance(item, Refused)
        )
        return items
