"""Decodes the scans that are read from a triggered buffer. A scan holds one sample of each channel.

The kernel documents the format in Documentation/driver-api/iio/buffers.rst and in the sysfs ABI
(Documentation/ABI/testing/sysfs-bus-iio, `scan_elements`).
"""

import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fltea.records.events import Ints

TYPE = re.compile(r"(be|le):([su])(\d{1,3})/(\d{1,3})(?:X(\d{1,3}))?>>(\d{1,3})")
STORAGE_BITS = (8, 16, 32, 64)
"""Possible sizes of one number of a channel [bits], which are powers of 2."""


class Element(NamedTuple):
    """Description of one channel in a scan.

    `name`: name such as `anglvel_x`. `place`: index of the channel among all channels of the scan.
    `storage_bits`: size of the field that holds one number [bits]. `shift`, `bits`: after a shift to the
    right by `shift` bits, the lowest `bits` bits of the field are the number. `repeat`: how many numbers the
    channel has in each scan.
    """

    name: str
    place: int
    big_endian: bool
    signed: bool
    bits: int
    storage_bits: int
    shift: int
    repeat: int = 1

    @property
    def size(self) -> int:
        """Number of bytes of the channel in a scan."""
        return self.storage_bits // 8 * self.repeat


def parse_element(name: str, index: str, text: str) -> Element:
    """Return the description of a channel from the texts of its files `…_index` and `…_type`.

    A type is, for example, `le:s16/16>>0`.

    Raises:
        ValueError: the content of the files does not have the form that the kernel documents.
    """
    found = TYPE.fullmatch(text.strip())
    if found is None or not index.strip().isdecimal():
        raise ValueError(f"{name}: '{text.strip()}', index '{index.strip()}' is no layout of a channel")
    bits, storage_bits, shift = int(found[3]), int(found[4]), int(found[6])
    if storage_bits not in STORAGE_BITS or not 1 <= bits <= storage_bits - shift:
        raise ValueError(
            f"{name}: {text.strip()}: {bits} bits, shifted by {shift}, in a field of {storage_bits}"
        )
    return Element(
        name, int(index), found[1] == "be", found[2] == "s", bits, storage_bits, shift, int(found[5] or 1)
    )


class ScanLayout:
    """The positions of the channels in a scan. `size`: length of a scan [bytes].

    Each channel is aligned to its own size, and the whole scan to the size of its largest channel.
    """

    def __init__(self, elements: Sequence[Element]) -> None:
        self.places: dict[str, tuple[Element, int]] = {}
        end = 0
        for element in sorted(elements, key=lambda element: element.place):
            begin = -(-end // element.size) * element.size
            self.places[element.name] = element, begin
            end = begin + element.size
        largest = max((element.size for element in elements), default=1)
        self.size = -(-end // largest) * largest

    def decode(self, data: bytes | memoryview) -> dict[str, Ints]:
        """Return for each channel an array (scans,): the channel's first number in every scan.

        Raises:
            ValueError: the bytes are not a whole number of scans.
        """
        if len(data) % self.size:
            raise ValueError(f"{len(data)} bytes are no whole number of scans of {self.size}")
        scans = np.frombuffer(data, dtype=np.uint8).reshape(-1, self.size)
        return {name: _numbers(scans, element, begin) for name, (element, begin) in self.places.items()}


def _numbers(scans: NDArray[np.uint8], element: Element, begin: int) -> Ints:
    width = element.storage_bits // 8
    stored = np.ascontiguousarray(scans[:, begin : begin + width])
    words = stored.view(f"{'>' if element.big_endian else '<'}u{width}")[:, 0].astype(np.uint64)
    unused = np.uint64(64 - element.bits)
    words = words >> np.uint64(element.shift) << unused
    return (words.view(np.int64) >> np.int64(unused)) if element.signed else (words >> unused).view(np.int64)
