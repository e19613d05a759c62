"""Samples with which nothing else happens: by the short way they come out as by the stages, to the bit."""

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
import pytest
from blocks import ndjson
from fltea.records.block import Block
from fltea.records.events import Event, RawBlock
from fltea.records.records import AnyRecord
from fltea.settings.config import load_config
from fltea.stream import pipeline as stream_pipeline
from fltea.stream.pipeline import Pipeline
from fltea.stream.steady import Steady
from host_support import hello
from hypothesis import given, settings
from hypothesis import strategies as st
from walk_support import SMALL, Source, raw
from wire_story import Story, StorySource, stories

N = 1200
SETTINGS: list[dict[str, Any]] = [
    {},
    {"live.on": False},
    {"estimator.startup": 470, "live.period_s": 0.7},
    {"output.every": 7, "output.corrected": True},
    {"channels": ["gyro_z", "accel_x"], "accel.startup": 35, "accel.window": 50},
    {"live.period_s": 0.3, "estimator.tuning": "live"},
    {"live.period_s": 0.3, "estimator.tuning": "live", "estimator.variant": "triple"},
    {"estimator.R": 1e-4, "estimator.bias": "none", "estimator.guard": "off", "estimator.variant": "triple"},
]


class Ways:
    """Counts the samples that go the short way, which may be closed."""

    def __init__(self, patch: pytest.MonkeyPatch) -> None:
        self.short, self._patch = 0, patch
        take = Steady.take

        def counted(steady: Steady, block: RawBlock, until_ns: int) -> Any:
            found = take(steady, block, until_ns)
            self.short += 0 if found is None else len(found.block)
            return found

        patch.setattr(Steady, "take", counted)

    def both(
        self, found: Iterable[Event], changes: dict[str, Any], *, watched: bool = True
    ) -> tuple[list[bytes], list[bytes]]:
        """Return the records of events as they come out by default, and with the short way closed."""
        events = list(found)
        by_default = _walk(events, changes, watched)
        with self._patch.context() as closed:
            closed.setattr(stream_pipeline, "MOST_STEADY", 0)
            return by_default, _walk(events, changes, watched)


@pytest.fixture
def ways(monkeypatch: pytest.MonkeyPatch) -> Ways:
    return Ways(monkeypatch)


def _walk(events: Iterable[Event], changes: dict[str, Any], watched: bool) -> list[bytes]:
    pipeline = Pipeline(StorySource(), load_config(None, SMALL | changes), watched=watched)
    found: list[AnyRecord | Block] = [item for event in events for item in pipeline.feed(event)]
    return ndjson([*found, *pipeline.finish()])


def _reads(sizes: Iterable[int]) -> Iterator[Event]:
    yield hello()
    begin = 0
    for size in sizes:
        yield raw(range(begin, begin + size))
        begin += size


@pytest.mark.parametrize("watched", [True, False])
@pytest.mark.parametrize("changes", SETTINGS)
def test_of_longer_blocks_the_short_way_takes_what_is_between_looks_and_seconds(
    ways: Ways, changes: dict[str, Any], watched: bool
) -> None:
    short, long = ways.both(_reads([130, 250, 20, 100, 256, 257, 187]), changes, watched=watched)
    assert short == long
    assert ways.short > 0.16 * N or not watched


@pytest.mark.parametrize("changes", SETTINGS)
def test_nearly_all_short_reads_go_the_short_way_and_say_the_same(
    ways: Ways, changes: dict[str, Any]
) -> None:
    short, long = ways.both(_reads([1, 2, 1, 3] * (N // 7)), changes)
    assert short == long
    assert ways.short > 0.75 * N


def test_whatever_happens_both_ways_say_the_same(ways: Ways) -> None:
    @given(stories(), st.sampled_from(SETTINGS))
    @settings(max_examples=40)
    def holds(story: Story, changes: dict[str, Any]) -> None:
        moments = story.moments()
        source = StorySource()
        short, long = ways.both(source.read([moments[0]._replace(data=None), *moments]), changes)
        assert short == long

    holds()
    assert ways.short > 0


@pytest.mark.parametrize("said", [{"gyro_lsb_per_dps": 65.5}, {"accel_lsb_per_g": 0.0}, {"rate_hz": 101.0}])
def test_a_hello_with_other_numbers_counts_for_the_samples_behind_it(
    ways: Ways, said: dict[str, Any]
) -> None:
    events = list(_reads([1] * 900))
    short, long = ways.both([*events[:640], hello(host_ns=6_390_000_000, **said), *events[640:]], {})
    assert short == long
    assert ways.short > 500


def test_columns_of_any_type_are_taken_and_what_no_sensor_says_is_left_to_the_stages(ways: Ways) -> None:
    events = list(_reads([2] * 600))
    for k in range(300, 420):
        block = events[k]
        assert isinstance(block, RawBlock)
        wide = np.asfortranarray(block.gyro) if k % 3 == 0 else block.gyro.astype(np.int16)
        events[k] = block._replace(gyro=wide, accel=None if k % 5 == 0 else block.accel)
    short, long = ways.both(events, {})
    assert short == long
    assert ways.short > 300


def test_numbers_beyond_all_measure_change_nothing() -> None:
    pipeline = Pipeline(Source(), load_config(None, SMALL))
    events = list(_reads([1] * 400))
    for event in events[:300]:
        list(pipeline.feed(event))
    before = pipeline.save()
    block = events[300]
    assert isinstance(block, RawBlock)
    with pytest.raises(ValueError, match="must be finite"):
        list(pipeline.feed(block._replace(gyro=np.full((1, 3), np.nan))))
    after = pipeline.save()
    assert before is not None
    assert after is not None
    assert (after.gyro, after.gyro_fit, after.gyro_track) == (before.gyro, before.gyro_fit, before.gyro_track)
