"""Convert the columns of blocks to records as JSON lines.

The lines are byte for byte those that the library msgspec would make of the records.

The records of one kind in a block differ only in the numbers that come from the block's columns. So one
record is encoded with a gap in place of each such number. For all other records, the text between the gaps is
used again, and only the numbers are converted.
"""

import re
from collections.abc import Sequence
from typing import Any

import msgspec
from numpy.typing import NDArray

from fltea._native import Lines, RunPrinter
from fltea.recording.schema import NULL
from fltea.records.block import Block, Values
from fltea.records.ports import Wanted
from fltea.records.records import ACCEL_UNIT

MOST = 4096
"""The text between the numbers of a JSON line is kept. There is one such text for each device and each
`Wanted` (which kinds of records to convert). If there are more than this number of texts, all are deleted and
made anew.
"""

HOLE = re.compile(rb"\0(\d+) (\d+)\0")
_encode = msgspec.json.Encoder().encode


class BlockLines:
    """Converts the records of blocks to JSON lines. The text between the numbers is kept for each device."""

    def __init__(self) -> None:
        self._known: dict[tuple[str | None, Wanted], tuple[object, Lines]] = {}

    def of(self, block: Block, wanted: Wanted, rows: range) -> bytes:
        """Return the records of the block's `rows` as JSON lines. `wanted`: which records to return."""
        found = bytearray()
        self.add(found, block, wanted, rows)
        return bytes(found)

    def add(self, into: bytearray, block: Block, wanted: Wanted, rows: range) -> None:
        """Append the records of the block's `rows` as JSON lines to `into`."""
        place, said = (block.device, wanted), _said(block)
        known = self._known.get(place)
        if known is None or known[0] != said:
            if len(self._known) >= MOST:
                self._known.clear()
            known = self._known[place] = said, _lines(block, wanted)
        known[1].add(into, _columns(block), rows.start, rows.stop, rows.step)


def run_printer(block: Block, wanted: Wanted) -> RunPrinter:
    """Return a native printer, which converts samples to JSON lines in C++.

    `block`: a block that the native device has processed. The printer's lines contain those values of this
    block that are equal in all its records (`_said`). If one of these values changes, a new printer is
    needed.
    """
    return RunPrinter(_lines(block, wanted), block.every, block.weight_of_row, _shape(block))


def _shape(block: Block) -> list[int]:
    """Return which columns the block has, and how many, in the form that `_native.RunPrinter` takes."""
    accel_axes = 0 if block.accel_ms2 is None else block.accel_ms2.shape[1]
    shape = [block.gyro_dps.shape[1], accel_axes, block.temperature_c is not None, block.flags is not None]
    estimated = [one.unit for one in block.estimates]
    for one in block.tracked:
        shape += [len(one.axes), one.unit == ACCEL_UNIT, one.unit in estimated]
    return shape


def _said(block: Block) -> object:
    """Return what determines the text between the numbers of a block's JSON lines.

    If two blocks of a device have the same, the text is the same, too.
    """
    return (
        block.epoch,
        block.variant,
        (block.accel_ms2 is None, block.temperature_c is None, block.flags is None, block.corrected),
        [one[:4] for one in block.estimates],
        [(*one[:2], *one[8:]) for one in block.tracked],
    )


def _columns(block: Block) -> list[Any]:
    """Return all columns of the block that have one row per sample."""
    columns: list[Any] = [block.seq, block.device_us, block.host_ns, block.gyro_dps]
    columns += [block.accel_ms2, block.temperature_c, block.flags, block.corrected_dps]
    for estimates in block.estimates:
        columns += estimates[4:]
    for tracked in block.tracked:
        columns += tracked[2:8]
    return columns


class _Holes(Values):
    """Makes records that have a mark in place of each number from a column.

    A mark tells which number belongs there. It consists of two indices: that of the column in `columns`, and
    that of the number in the column's row, such as 2 for the third axis.
    """

    def __init__(self, columns: Sequence[Any]) -> None:
        self._columns = columns

    def of(self, column: NDArray[Any]) -> Sequence[Any]:
        number = next(i for i, one in enumerate(self._columns) if one is column)
        places = range(1 if column.ndim == 1 else column.shape[1])
        return [msgspec.Raw(b"\0%d %d\0" % (number, place)) for place in places]

    nullable = of


def _lines(block: Block, wanted: Wanted) -> Lines:
    records = block.records(
        samples=wanted.samples,
        estimates=wanted.estimates,
        corrected=wanted.corrected,
        values=_Holes(_columns(block)),
    )
    text = b"".join(_encode(record) + b"\n" for record in records)
    *parts, last = HOLE.split(text if wanted.nulls else NULL.sub(b"", text))
    holes = zip(map(int, parts[1::3]), map(int, parts[2::3]), strict=True)
    return Lines([*parts[::3], last], list(holes), wanted.nulls)
