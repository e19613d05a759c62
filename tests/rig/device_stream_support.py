"""Simulate samples, and feed them into a pipeline whose windows fill quickly."""

from collections.abc import Iterable, Iterator

import numpy as np
from fltea.records.block import Block
from fltea.records.events import Event, RawBlock, RawSample, block_of
from fltea.records.records import AnyRecord
from fltea.records.stats import LinkStats
from fltea.settings.config import Config, load_config
from fltea.stream.fit_worker import FitWorker
from fltea.stream.pipeline import Pipeline
from fltea.stream.snapshot import DeviceState

from tests.rig.host_support import hello

SMALL = {"estimator.window": 50, "estimator.startup": 20, "link.max_gap": 60}
PLAIN = SMALL | {"live.on": False}
NO_FILTERS = PLAIN | {"estimator.startup": 10**6}
COUNTS = np.rint(np.random.default_rng(5).normal((3, -40, 0), 8, (1300, 3))).astype(int).tolist()


class Source:
    """A source whose events a test feeds into the pipeline directly."""

    live = False
    has_clock = True

    def __init__(self, *, prompt: bool = False, unix_offset_ns: int = 0) -> None:
        self.prompt, self.unix_offset_ns = prompt, unix_offset_ns

    def events(self) -> Iterator[Event]:
        return iter(())

    def link_stats(self) -> LinkStats:
        return LinkStats(frames=7)

    def close(self) -> None: ...


def small_config(**changes: object) -> Config:
    """Return settings with windows that fill quickly.

    An argument such as `estimator__R` changes the setting estimator.R.
    """
    return load_config(None, SMALL | {name.replace("__", "."): value for name, value in changes.items()})


def raw(numbers: Iterable[int]) -> RawBlock:
    return block_of(
        [RawSample(k, k * 10_000, k * 10_000_000, tuple(COUNTS[k]), (k % 9, 5, 16384), 0.0) for k in numbers]
    )


def reads(sizes: Iterable[int]) -> Iterator[Event]:
    """Yield a HELLO, then consecutive samples in blocks of these sizes."""
    yield hello()
    begin = 0
    for size in sizes:
        yield raw(range(begin, begin + size))
        begin += size


def run_pipeline(
    found: Iterable[Event],
    state: DeviceState | None = None,
    *,
    prompt: bool = True,
    watched: bool = True,
    fit_worker: FitWorker | None = None,
    number: int = 0,
    **set_: object,
) -> tuple[list[AnyRecord | Block], Pipeline]:
    source, config = Source(prompt=prompt), small_config(**set_)
    pipeline = Pipeline(source, config, state=state, fit_worker=fit_worker, number=number, watched=watched)
    return [item for event in found for item in pipeline.feed(event)], pipeline
