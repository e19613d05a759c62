"""Convert between samples and blocks: tests write single samples, the program processes blocks."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any, NamedTuple, TypeVar

import msgspec
import numpy as np
from fltea.records.block import AxisColumns, Block, TrackedColumns
from fltea.records.estimate import AxisEstimate
from fltea.records.events import Event, RawBlock, RawSample, block_of
from fltea.records.records import AnyRecord, EpochReason, Estimate, Sample
from fltea.records.stats import SampleStats
from fltea.stream.decode import Decoded, Decoder
from hypothesis import strategies as st

T = TypeVar("T")


def of(kind: type[T], found: Iterable[object]) -> list[T]:
    """Return those of the records, events or frames that have this type."""
    return [one for one in found if isinstance(one, kind)]


def as_block(*samples: RawSample) -> RawBlock:
    return block_of(samples)


def records_of(items: Iterable[AnyRecord | Block]) -> list[AnyRecord]:
    """Return the records in the output of a pipeline, with each block expanded into its records."""
    return [r for item in items for r in (item.records() if isinstance(item, Block) else [item])]


def as_items(records: Iterable[AnyRecord | Block]) -> Iterator[AnyRecord | Block]:
    """Undo `records_of`: convert each sample and the estimate that follows it to a block of one row."""
    waiting: Sample | None = None
    for record in records:
        if waiting is not None:
            mine = isinstance(record, Estimate) and record.seq == waiting.seq
            yield block_of_records(waiting, record if mine else None)
            waiting = None
            if mine:
                continue
        if isinstance(record, Sample):
            waiting = record
        else:
            yield record
    if waiting is not None:
        yield block_of_records(waiting)


def block_of_records(sample: Sample, estimate: Estimate | None = None) -> Block:
    def row(values: Sequence[float] | None) -> np.ndarray | None:
        return None if values is None else np.array([values], dtype=np.float64)

    numbers = (sample.seq, sample.device_us, sample.host_ns)
    block = Block(
        sample.device,
        sample.epoch,
        *(np.array([number]) for number in numbers),
        row(sample.gyro_dps),
        row(sample.accel_ms2),
        None if sample.temperature_c is None else np.array([sample.temperature_c]),
        np.array([sample.flags]),
    )
    if estimate is None:
        return block
    columns, tracked = [], []
    for unit in dict.fromkeys(axis.unit for axis in estimate.axes.values()):
        found = {name: axis for name, axis in estimate.axes.items() if axis.unit == unit}
        values = {
            name: [getattr(axis.fltea, name) for axis in found.values()]
            for name in ("valid", "settled", *NUMBERS)
        }
        tracked.append(tracked_columns(unit, found))
        columns.append(
            AxisColumns(
                tuple(found),
                unit,
                tuple(axis.null_p for axis in found.values()),
                tuple(axis.whiteness for axis in found.values()),
                *(np.array([values[name]], dtype=np.float64) for name in NUMBERS),
                np.array([values["valid"]]),
                np.array([values["settled"]]),
            )
        )
    return replace(block, variant=estimate.variant, estimates=tuple(columns), tracked=tuple(tracked))


def tracked_columns(unit: str, found: dict[str, AxisEstimate]) -> TrackedColumns:
    """Return the bias fields of one sample's estimates, as `TrackedColumns` of a block of one row."""
    axes = found.values()
    return TrackedColumns(
        tuple(found),
        unit,
        *(np.array([[getattr(one, name) for one in axes]], dtype=np.float64) for name in TRACKED),
        np.array([[one.moving for one in axes]]),
        tuple(one.verdict for one in axes),
        tuple(one.alpha for one in axes),
        tuple(one.f for one in axes),
    )


TRACKED = ("state", "state_std", "bias", "bias_std", "innovation")
NUMBERS = ("alpha", "alpha_std", "f", "f_std", "state", "innovation")


def ndjson(items: Iterable[AnyRecord | Block]) -> list[bytes]:
    """Encode all records as lines of JSON. A difference between two outputs then appears as one line."""
    return [msgspec.json.encode(record) for record in records_of(items)]


def samples_of(events: Iterable[object]) -> list[RawSample]:
    return [raw for event in events if isinstance(event, RawBlock) for raw in event.samples()]


def in_samples(events: Iterable[object]) -> list[Any]:
    """Replace each block among the events by its samples."""
    return [one for event in events for one in (event.samples() if isinstance(event, RawBlock) else [event])]


def of_samples(events: Iterable[object]) -> list[Any]:
    """Replace each sample among the events by a block of one row."""
    return [as_block(event) if isinstance(event, RawSample) else event for event in events]


def one_by_one(events: Iterable[object]) -> Iterator[object]:
    """Split each block among the events into blocks of one row."""
    for event in events:
        if isinstance(event, RawBlock):
            yield from (event.rows(k, k + 1) for k in range(len(event.sequence)))
        else:
            yield event


def in_blocks(block: RawBlock, cuts: Sequence[int]) -> Iterator[RawBlock]:
    """Split a block before the rows `cuts`; cuts outside the block have no effect."""
    n = len(block.sequence)
    places = sorted({0, n, *(cut for cut in cuts if 0 < cut < n)})
    return (block.rows(begin, end) for begin, end in pairwise(places))


def cuts(n: int) -> st.SearchStrategy[list[int]]:
    """Draw positions at which a test splits `n` rows, bytes or chunks: no position, few or many."""
    return st.lists(st.integers(0, n), max_size=12) | st.sets(st.integers(0, n)).map(sorted)


_counts = st.integers(-(2**15), 2**15 - 1)
raw_samples = st.builds(
    RawSample,
    sequence=st.integers(0, 65535),
    device_us=st.integers(0, 2**32 - 1),
    host_ns=st.integers(0, 2**40),
    gyro=st.tuples(_counts, _counts, _counts),
    accel=st.tuples(_counts, _counts, _counts),
    temperature=_counts,
    flags=st.integers(0, 255),
)
"""Any sample that a frame of the protocol can hold."""


class Tracked(NamedTuple):
    """A sample with its sequence number and its device time, both without wraps.

    `missing`: number of samples lost just before this sample. `new_epoch`: if the sample begins a new run
    (epoch), the reason for it.
    """

    raw: RawSample
    seq: int
    device_us: int
    missing: int = 0
    new_epoch: EpochReason | None = None


def track_all(decoder: Decoder, samples: Sequence[RawSample]) -> list[Tracked | None]:
    """Return each sample of a block with its number and time; None for a sample that was rejected."""
    numbered = block_of(samples)._replace(temperature=np.arange(float(len(samples))))
    found: list[Tracked | None] = [None] * len(samples)
    for piece in of(Decoded, decoder.feed(numbered)):
        assert piece.raw.temperature is not None
        rows, block = piece.raw.temperature.astype(int).tolist(), piece.block
        for row, seq, device_us in zip(rows, block.seq.tolist(), block.device_us.tolist(), strict=True):
            broken = (piece.missing, piece.new_epoch) if row == rows[0] else (0, None)
            found[row] = Tracked(samples[row], seq, device_us, *broken)
    return found


def track_events(events: Iterable[Event]) -> tuple[SampleStats, list[Decoded]]:
    """Decode all blocks of samples among the events of a source. Return the decoder's final counts of
    samples, and the decoded samples, which it splits at each gap.
    """
    decoder = Decoder(lambda: 0, max_gap=100)
    found = [piece for event in events for piece in of(Decoded, decoder.feed(event))]
    return decoder.counts, found


def track_one(decoder: Decoder, raw: RawSample) -> Tracked | None:
    return track_all(decoder, [raw])[0]
