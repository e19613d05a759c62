"""What the native decoder gives, frame by frame, as the Python one gives it."""

from collections import Counter
from collections.abc import Iterable
from typing import NamedTuple

from fltea.wire import layout as wire
from fltea.wire.block_reader import BlockReader, Decoded, SampleColumns
from fltea.wire.framing import BadFrame
from fltea.wire.messages import Frame, Refused


class Found(NamedTuple):
    item: Frame | Refused | BadFrame
    end: int


def of_columns(columns: SampleColumns) -> Iterable[Found]:
    for sequence, device_us, gyro, accel, temperature, flags, end in zip(*columns, strict=True):
        sample = wire.Sample(*map(int, (*gyro, *accel, temperature, flags)))
        yield Found(Frame(sample.TYPE, int(sequence), int(device_us), sample), int(end))


def flat(found: list[Decoded], before: int = 0) -> list[Found]:
    """What one call gave, item by item; `before` is the number of bytes fed before it."""
    items: list[Found] = []
    for one in found:
        items += of_columns(one) if isinstance(one, SampleColumns) else [Found(*one)]
    return [Found(item, before + end) for item, end in items]


def in_chunks(reader: BlockReader, chunks: Iterable[bytes]) -> list[Found]:
    return [item for chunk in chunks for item in flat(reader.feed(chunk), reader.bytes_in - len(chunk))]


def counted(found: list[Found]) -> Counter[str]:
    names = ("frames" if isinstance(item, Frame) else getattr(item, "reason", None) for item, _ in found)
    return Counter(name for name in names if name)
