"""However bytes are read and samples grouped into blocks, the records are the same, byte for byte."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from fltea.records.block import Block
from fltea.records.events import Event, RawBlock
from fltea.records.records import Estimate, Sample
from fltea.settings.config import Config, load_config
from fltea.stream.pipeline import Pipeline
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.rig.blocks import cuts, in_blocks, ndjson, of, one_by_one, records_of
from tests.rig.device_stream_support import SMALL
from tests.rig.estimating_board import ESTIMATOR, Board, events, noise
from tests.rig.tiers import long
from tests.rig.wire_story import HAPPENINGS, Moment, Story, StorySource, stories, torn

RUNAWAY = {
    "estimator.R": 1e-4,
    "estimator.bias": "none",
    "estimator.guard": "off",
    "estimator.variant": "triple",
}
HELD = {"estimator.R": 1e-4, "estimator.guard": "consistent"}
SETTINGS: list[dict[str, Any]] = [
    {},
    {"output.every": 7},
    RUNAWAY,
    HELD,
    {"channels": ["gyro_z", "accel_x"], "accel.startup": 35, "accel.window": 50},
    {"estimator.estimate_on": "both"},
    {"live.period_s": 0.3},
    {"live.period_s": 0.2, "estimator.tuning": "live"},
    {"live.period_s": 0.5, "estimator.tuning": "live", "estimator.variant": "triple"},
]


def config(changes: dict[str, Any]) -> Config:
    return load_config(None, SMALL | changes)


def walk(chosen: Config, moments: list[Moment], together: Sequence[int] = (1,)) -> list[bytes]:
    source = StorySource(together)
    pipeline = Pipeline(source, chosen)
    found = [item for event in source.read(opened(moments)) for item in pipeline.feed(event)]
    return ndjson([*found, *pipeline.finish()])


def opened(moments: list[Moment]) -> list[Moment]:
    return [moments[0]._replace(data=None), *moments]


def check_any_reads(
    story: Story, places: list[float], together: Sequence[int], changes: dict[str, Any]
) -> list[bytes]:
    """Check that the bytes of a story (simulated seconds of a board) give the same records in other reads.

    The original reads are divided into smaller ones, several of them are joined, or all of them.
    """
    moments, chosen = story.moments(), config(changes)
    whole = walk(chosen, moments)
    assert walk(chosen, list(torn(moments, places))) == whole
    assert walk(chosen, moments, together) == whole
    assert walk(chosen, list(torn(moments, places)), together) == whole
    assert walk(chosen, moments, [len(moments)]) == whole
    return whole


@pytest.mark.long
@given(
    stories(),
    st.lists(st.floats(0, 1), max_size=4),
    st.lists(st.integers(1, 300), min_size=1, max_size=5),
    st.sampled_from(SETTINGS),
)
@settings(max_examples=40)
def test_bytes_of_the_same_moments_give_the_same_records_however_they_are_read(
    story: Story, places: list[float], together: list[int], changes: dict[str, Any]
) -> None:
    """The reads of a story (simulated seconds of a board) are cut at `places`. Then they are joined in groups
    of the sizes `together`. Hypothesis also draws cases without cuts, and cases in which nothing is joined.
    """
    moments, chosen = story.moments(), config(changes)
    whole = walk(chosen, moments)
    assert walk(chosen, list(torn(moments, places)), together) == whole
    assert walk(chosen, moments, [len(moments)]) == whole


@pytest.mark.parametrize("what", HAPPENINGS)
def test_each_thing_that_may_happen_is_the_same_however_it_is_read(what: str) -> None:
    story = Story(950_000_000, 260, ((130, what), (141, what)), (1, 16, 3))
    assert len(check_any_reads(story, [0.3, 0.31, 0.9], [2, 7, 40], {})) > 100


def test_a_last_block_whose_end_cannot_be_used_ends_where_it_ends() -> None:
    """The last samples are not accepted, since the device's time jumps before them. The last statistics have
    the time of the last sample nevertheless.
    """
    check_any_reads(Story(0, 201, ((199, "jump"),), (1,)), [], [3], {})


def blocks_of(story: Story) -> list[Event]:
    """Return the events with consecutive samples joined into one block, as in a recording."""
    source = StorySource()
    found: list[Event] = []
    for event in source.read(opened(story.moments())):
        before = found[-1] if found else None
        if isinstance(event, RawBlock) and isinstance(before, RawBlock):
            found[-1] = joined(before, event)
        else:
            found.append(event)
    return found


def joined(a: RawBlock, b: RawBlock) -> RawBlock:
    return RawBlock._make(np.concatenate(columns) for columns in zip(a, b, strict=True))


def walk_events(chosen: Config, found: Iterable[Event]) -> list[Any]:
    pipeline = Pipeline(StorySource(), chosen)
    return [*(item for event in found for item in pipeline.feed(event)), *pipeline.finish()]


@pytest.mark.parametrize("examples", [10, long(40)])
def test_samples_in_blocks_of_any_cut_give_the_same_records(examples: int) -> None:
    @given(stories(), st.sampled_from(SETTINGS), st.data())
    @settings(max_examples=examples)
    def holds(story: Story, changes: dict[str, Any], data: st.DataObject) -> None:
        chosen, found = config(changes), blocks_of(story)
        whole = ndjson(walk_events(chosen, found))
        assert ndjson(walk_events(chosen, one_by_one(found))) == whole
        cut: list[Event] = []
        for event in found:
            is_block = isinstance(event, RawBlock)
            cut += in_blocks(event, data.draw(cuts(len(event.sequence)))) if is_block else [event]
        assert ndjson(walk_events(chosen, cut)) == whole

    holds()


@pytest.mark.parametrize("who", ["device", "both"])
@pytest.mark.parametrize("stated", [ESTIMATOR, None])
def test_a_board_that_estimates_gives_the_same_records_in_any_cut(who: str, stated: object) -> None:
    """A board that estimates gives the same records in any division into blocks. So does a board that should
    estimate but never does, which is reported after five seconds.
    """
    found = list(events(Board(stated, late=3).run(noise(700))))
    if stated is None:
        found = [found[0], RawBlock._make(map(np.concatenate, zip(*of(RawBlock, found), strict=True)))]
    chosen = config({"estimator.estimate_on": who, "output.every": 3})
    whole = ndjson(walk_events(chosen, found))
    assert ndjson(walk_events(chosen, one_by_one(found))) == whole
    assert any(b"no_device_estimates" in line for line in whole) == (stated is None)


@pytest.mark.parametrize(("changes", "kind"), [(RUNAWAY, b"axis_runaway"), (HELD, b"axis_bound")])
def test_axes_that_are_lost_are_told_of_at_the_same_place_in_any_cut(
    changes: dict[str, Any], kind: bytes
) -> None:
    story = Story(123, 500, ((100, "gap"), (200, "knock"), (450, "gap")), (7, 30, 100))
    whole = check_any_reads(story, [0.4], [5, 1], changes)
    assert sum(kind in line for line in whole) == 3
    found = blocks_of(story)
    assert ndjson(walk_events(config(changes), found)) == ndjson(
        walk_events(config(changes), one_by_one(found))
    )


@given(st.integers(1, 40), st.sampled_from(SETTINGS), st.integers(1, 30), st.data())
@settings(max_examples=30)
def test_records_of_a_block_are_those_of_its_parts(
    n: int, changes: dict[str, Any], every: int, data: st.DataObject
) -> None:
    story = Story(0, 150, ((120, "constant"),), (50,))
    blocks = of(Block, walk_events(config(changes | {"output.every": 1}), blocks_of(story)))
    last = blocks[-1]
    first = data.draw(st.integers(0, len(last) - 1))
    block = last.rows(first, first + n)
    end = data.draw(st.integers(0, len(block)))
    parts = [part for part in (block.rows(0, end), block.rows(end, len(block))) if len(part)]
    all_of_it = list(block.records())
    assert all_of_it == records_of(parts)
    assert [one.seq for one in of(Sample, all_of_it)] == block.seq.tolist()
    assert list(block.records(estimates=False)) == of(Sample, all_of_it)
    assert list(block.records(samples=False)) == of(Estimate, all_of_it)
    thin = replace(block, every=every)
    assert list(thin.records()) == [one for one in all_of_it if one.seq % every == 0]
    assert thin.weight == len(list(thin.records()))
    assert thin.last_estimate() == next((one for one in reversed(of(Estimate, thin.records()))), None)
    assert list(thin.records()) == records_of(replace(part, every=every) for part in parts)
