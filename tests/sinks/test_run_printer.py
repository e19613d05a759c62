"""Tests the native code that prints a device's samples as text.

It prints the same bytes as the Python class `BlockLines` does for the samples' blocks.
"""

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
import pytest
from fltea._native import Device, Lines, RunPrinter
from fltea.records.block import Block
from fltea.records.events import Event, RawBlock
from fltea.records.ports import Wanted
from fltea.settings.config import load_config
from fltea.sinks.json_lines import BlockLines, run_printer
from fltea.stream.pipeline import Pipeline
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.rig.device_stream_support import SMALL, Source, raw, reads

N = 700
BOTH = ["gyro_z", "accel_x", "gyro_x"]
ALL = Wanted(samples=True, estimates=True, corrected=True)
SETTINGS: list[dict[str, Any]] = [
    {},
    {"live.on": False, "output.corrected": True},
    {"estimator.startup": 470, "live.period_s": 0.7},
    {"output.every": 7, "output.corrected": True, "live.period_s": 0.5},
    {"channels": BOTH, "accel.startup": 35, "accel.window": 50, "output.corrected": True},
    {"channels": BOTH, "accel.startup": 300, "accel.window": 50, "output.every": 1000},
    {"channels": ["accel_y"], "accel.startup": 30, "accel.window": 50, "output.corrected": True},
]
wanted = st.builds(Wanted, *[st.booleans()] * 4)


class Printing:
    """A pipeline whose samples the native code prints as text.

    A new printer is made whenever the fields that all records of a block share have changed. Numbers:

        compared: rows that were printed natively, with the same text as `BlockLines` gives
        made: printers
        missed: rows that came before a new printer, and that the old one left to Python
    """

    def __init__(self, changes: dict[str, Any], wanted: Wanted) -> None:
        self._pipeline = Pipeline(Source(), load_config(None, SMALL | changes))
        self._wanted, self._lines = wanted, BlockLines()
        self._printer: RunPrinter | None = None
        self._text: object = None
        self.compared = self.made = self.missed = 0
        self.printed = b""

    def feed(self, events: Iterable[Event]) -> None:
        for event in events:
            for item in self._pipeline.feed(event):
                if isinstance(item, Block):
                    self._compare(item)

    def _compare(self, block: Block) -> None:
        data, records, missed = (b"", 0, len(block)) if self._printer is None else self._printer.take()
        expected = self._lines.of(block, self._wanted, block.due_rows)
        text = self._lines._known[block.device, self._wanted][0]
        assert missed in (0, len(block))
        if text == self._text:
            assert (data, records, missed) == (expected, block.weight, 0)
            self.compared += len(block)
            self.printed += data
            return
        self.missed += missed
        self._text, self._printer = text, run_printer(block, self._wanted)
        self._pipeline._decoder.native.set_printers([self._printer])
        self.made += 1


def with_unknown(events: Iterable[Event]) -> Iterator[Event]:
    """Yield the events with every third temperature unknown."""
    for event in events:
        if isinstance(event, RawBlock) and event.temperature is not None:
            known = np.arange(len(event.temperature)) % 3 > 0
            event = event._replace(temperature=np.where(known, event.temperature, np.nan))
        yield event


@pytest.mark.slow
@given(st.sampled_from(SETTINGS), wanted, st.lists(st.integers(1, 300), min_size=1), st.booleans())
@settings(max_examples=15)
def test_a_device_prints_what_its_blocks_are_printed_as(
    changes: dict[str, Any], wanted: Wanted, sizes: list[int], known: bool
) -> None:
    sizes = [*sizes, *[3] * 10][: 1 + int(np.searchsorted(np.cumsum([*sizes, *[3] * 10]), N))]
    printing = Printing(changes, wanted)
    printing.feed(reads(sizes) if known else with_unknown(reads(sizes)))
    assert printing.made > 0


@pytest.mark.parametrize("changes", SETTINGS)
def test_nearly_all_is_printed_by_the_device(changes: dict[str, Any]) -> None:
    printing = Printing(changes, ALL)
    printing.feed(with_unknown(reads([10] * (N // 10))))
    assert printing.compared > N - 10 * printing.made - 1
    assert printing.made < N // 20
    due = printing.printed.count(b'"class":"sample"')
    assert due == 0 if changes.get("output.every") == 1000 else due > 0
    assert (b'"class":"corrected"' in printing.printed) == (
        changes.get("output.corrected", False) and "accel_y" not in changes.get("channels", ())
    )


def test_rows_without_the_columns_of_a_text_are_not_printed() -> None:
    printing = Printing({"channels": BOTH, "accel.startup": 35, "accel.window": 50}, ALL)
    events = list(reads([10] * 60))
    for k in (20, 21, 40):
        block = events[k]
        assert isinstance(block, RawBlock)
        events[k] = block._replace(accel=None)
    printing.feed(events)
    # the printer misses rows twice: when the accelerometer's samples end, and when they come back
    assert printing.missed >= 10 * 4
    assert printing.compared > 400


def test_what_follows_rows_that_were_not_printed_is_not_printed_either() -> None:
    pipeline = Pipeline(Source(), load_config(None, SMALL))
    events = list(reads([10] * 10))
    block = [item for event in events[:6] for item in pipeline.feed(event)][-1]
    assert isinstance(block, Block)
    printer, other = run_printer(block, ALL), run_printer(block, ALL._replace(samples=False))
    pipeline._decoder.native.set_printers([printer, other])
    without = events[7]
    assert isinstance(without, RawBlock)
    found = [
        item
        for event in (events[6], without._replace(flags=None), events[8])
        for item in pipeline.feed(event)
        if isinstance(item, Block)
    ]
    first = found[0]
    assert printer.take() == (BlockLines().of(first, ALL, first.due_rows), first.weight, 20)
    assert other.take()[1:] == (first.weight, 20)
    assert printer.take() == (b"", 0, 0)
    list(pipeline.feed(events[9]))
    assert printer.take()[1:] == (first.weight, 0)
    pipeline._decoder.native.set_printers([])
    list(pipeline.feed(raw(range(100, 110))))
    assert printer.take() == (b"", 0, 0)


@pytest.mark.parametrize(
    ("hole", "shape", "every"),
    [
        ((3, 3), [3, 3, 1, 1], 1),
        ((4, 0), [3, 0, 1, 1], 1),
        ((5, 0), [3, 3, 0, 1], 1),
        ((6, 0), [3, 3, 1, 0], 1),
        ((7, 0), [3, 3, 1, 1], 1),
        ((7, 0), [3, 3, 1, 1, 2, 1, 1], 1),
        ((14, 0), [3, 3, 1, 1, 2, 0, 0], 1),
        ((22, 0), [3, 3, 1, 1, 2, 0, 1], 1),
        ((21, 2), [3, 3, 1, 1, 2, 0, 1], 1),
        ((0, 1), [3, 3, 1, 1], 1),
        ((0, 0), [3, 3, 1, 1], 0),
        ((0, 0), [3, 3, 1], 1),
        ((0, 0), [3, 3, 1, 1, 2], 1),
    ],
)
def test_holes_without_a_column_are_refused(hole: tuple[int, int], shape: list[int], every: int) -> None:
    with pytest.raises(ValueError, match=r"a column that is not given|shape|every"):
        RunPrinter(Lines([b"[", b"]\n"], [hole], True), every, 1, shape)


def test_only_printers_print() -> None:
    with pytest.raises((TypeError, RuntimeError)):
        Device().set_printers([None])  # type: ignore[list-item]
