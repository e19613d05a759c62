"""Samples and blocks, from one to the other: tests write samples, the program walks in blocks."""

from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from typing import Any

import msgspec
import numpy as np
from fltea.records.block import Block
from fltea.records.events import RawBlock, RawSample, block_of
from fltea.records.records import AnyRecord
from fltea.stream.place import Place
from hypothesis import strategies as st
from place_one_by_one import Placed


def as_block(*samples: RawSample) -> RawBlock:
    """Samples as one block."""
    return block_of(samples)


def records_of(items: Iterable[AnyRecord | Block]) -> list[AnyRecord]:
    """What a sink that prints all makes of what a pipeline gives."""
    return [r for item in items for r in (item.records() if isinstance(item, Block) else [item])]


def ndjson(items: Iterable[AnyRecord | Block]) -> list[bytes]:
    """The same as lines; a difference shows as one line."""
    return [msgspec.json.encode(record) for record in records_of(items)]


def samples_of(events: Iterable[object]) -> list[RawSample]:
    """The samples among events, one by one."""
    return [raw for event in events if isinstance(event, RawBlock) for raw in event.samples()]


def in_samples(events: Iterable[object]) -> list[Any]:
    """The same events, the samples of a block one by one in its place."""
    return [one for event in events for one in (event.samples() if isinstance(event, RawBlock) else [event])]


def of_samples(events: Iterable[object]) -> list[Any]:
    """The other way: each sample a block."""
    return [as_block(event) if isinstance(event, RawSample) else event for event in events]


def one_by_one(events: Iterable[object]) -> Iterator[object]:
    """The same events, each sample a block of its own."""
    for event in events:
        if isinstance(event, RawBlock):
            yield from (event.rows(k, k + 1) for k in range(len(event.sequence)))
        else:
            yield event


def in_blocks(block: RawBlock, cuts: Sequence[int]) -> Iterator[RawBlock]:
    """The same samples, cut before the rows `cuts`; what lies outside cuts nothing."""
    n = len(block.sequence)
    places = sorted({0, n, *(cut for cut in cuts if 0 < cut < n)})
    return (block.rows(begin, end) for begin, end in pairwise(places))


def cuts(n: int) -> st.SearchStrategy[list[int]]:
    """Any places to cut n rows, bytes or chunks: none, few, or many."""
    return st.lists(st.integers(0, n), max_size=12) | st.sets(st.integers(0, n)).map(sorted)


def place_all(place: Place, samples: Sequence[RawSample]) -> list[Placed | None]:
    """Where each sample of a block stands; None for one that was left out."""
    numbered = block_of(samples)._replace(temperature=np.arange(float(len(samples))))
    found: list[Placed | None] = [None] * len(samples)
    for piece in place.on_block(numbered):
        assert piece.raw.temperature is not None
        rows = piece.raw.temperature.astype(int).tolist()
        for row, seq, device_us in zip(rows, piece.seq.tolist(), piece.device_us.tolist(), strict=True):
            broken = (piece.missing, piece.new_epoch) if row == rows[0] else (0, None)
            found[row] = Placed(samples[row], seq, device_us, *broken)
    return found


def place_one(place: Place, raw: RawSample) -> Placed | None:
    """Where one sample stands."""
    return place_all(place, [raw])[0]
