"""Blocks that are put together where nobody watches: what comes out is what comes of each by itself."""

from typing import Any

import msgspec
from fltea.records.block import Block
from fltea.records.events import Event, LinkDown, RawBlock, Tick, Trouble
from fltea.records.records import Hello
from fltea.records.stats import DeviceStatus
from fltea.stream import gathering
from fltea.stream.pipeline import Pipeline
from hypothesis import given, settings
from hypothesis import strategies as st
from walk_support import Source, raw, small_config

STATUS = DeviceStatus(0, 0, 0, 0, 0, "user")
HELLO = Hello("test", 0, 100.0, "recording", boot_id=1, gyro_lsb_per_dps=16.4)
BETWEEN: list[Any] = [
    Tick(0),
    STATUS,
    msgspec.structs.replace(STATUS, overruns=7),
    HELLO,
    msgspec.structs.replace(HELLO, host_ns=5),
    msgspec.structs.replace(HELLO, boot_id=2),
    LinkDown(0),
    Trouble("fault", "text", 0, fatal=False),
]


def outcome(events: list[tuple[Event, int]], *, gathers: bool) -> tuple[list[Any], list[int], Any]:
    """Records but for samples, the numbers of these, and what a later run needs."""
    source = Source()
    pipeline = Pipeline(source, small_config(), watched=False)
    if not gathers:
        pipeline._gathering = None
    found: list[Any] = []
    for event, source.unix_offset_ns in events:
        found += pipeline.feed(event)
    found += pipeline.finish(whole=True)
    blocks = [one for one in found if isinstance(one, Block)]
    numbers = [number for one in blocks for number in one.seq.tolist()]
    records = [one for one in found if not isinstance(one, Block)]
    return records, numbers, pipeline.save()


@settings(deadline=None, max_examples=60)
@given(
    st.lists(st.integers(1, 40), min_size=1, max_size=25),
    st.dictionaries(st.integers(0, 25), st.lists(st.sampled_from(BETWEEN), min_size=1, max_size=3)),
    st.dictionaries(st.integers(0, 25), st.sampled_from([1, 3, 70, -1, -5])),
    st.dictionaries(st.integers(0, 25), st.integers(-(10**9), 10**9)),
    st.sampled_from([30, 8192]),
)
def test_what_comes_out_is_what_comes_of_each_by_itself(
    sizes: list[int],
    between: dict[int, list[Event]],
    jumps: dict[int, int],
    offsets: dict[int, int],
    most: int,
) -> None:
    events: list[tuple[Event, int]] = [(HELLO, 0)]
    at, offset_ns = 10, 0
    for k, size in enumerate(sizes):
        at = max(0, at + jumps.get(k, 0))
        offset_ns = offsets.get(k, offset_ns)
        events += [(event, offset_ns) for event in between.get(k, ())]
        events.append((raw(range(at, at + size)), offset_ns))
        at += size
    before, gathering.MOST = gathering.MOST, most
    try:
        together = outcome(events, gathers=True)
    finally:
        gathering.MOST = before
    alone = outcome(events, gathers=False)
    assert together[:2] == alone[:2]
    assert msgspec.msgpack.encode(together[2]) == msgspec.msgpack.encode(alone[2])


def test_samples_of_seconds_with_messages_between_them_walk_together() -> None:
    pipeline = Pipeline(Source(), small_config(), watched=False)
    began: list[Event] = [HELLO, raw(range(10))]
    for event in began:
        assert list(pipeline.feed(event)), "what begins an epoch waits for nothing"
    gathered = pipeline._gathering
    assert gathered is not None
    for begin in range(10, 1010, 100):
        later: list[Event] = [STATUS, HELLO, raw(range(begin, begin + 100))]
        for event in later:
            assert not list(pipeline.feed(event))
    *others, last = [one.event for one in gathered.rest()]
    assert isinstance(last, RawBlock)
    assert last.sequence.tolist() == list(range(10, 1010))
    assert others == [STATUS, HELLO] * 10
