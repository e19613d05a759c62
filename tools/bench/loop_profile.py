"""Where each microsecond of a live device goes, between its bytes and its lines: `make bench ARGS=--loop`.

A device of white noise in virtual time, its first ten minutes, read as `link.latency` has it: one sample at
once (0 ms), or two (20 ms). The bytes go through what `fltea run` does with those of a port, all in one
thread, though looks of the fit have one of their own there. A timer of processor time looks which file of
fltea is at work. What the program takes beyond that is its waking up, its threads and its queues.
"""

import os
import signal
import time
from collections import Counter
from collections.abc import Callable, Iterator
from io import FileIO
from itertools import islice
from pathlib import Path
from types import FrameType
from typing import Any, TypeVar

import fltea
import numpy as np
from fltea.records.events import Chunk, Opened
from fltea.settings.config import load_config
from fltea.sinks.ndjson import NdjsonSink
from fltea.stream.fit_worker import FitWorker
from fltea.stream.pipeline import Pipeline

from tools.bench.feeder import PERIOD_NS, frames
from tools.fed_source import FedSource
from tools.validation.tables import Table

T = TypeVar("T")

SAMPLES, WARM_UP = 60_000, 6_000
LOOK_S = 0.0005
PACKAGE = str(Path(fltea.__file__).parent) + os.sep
PARTS = {
    "bytes to columns": ("wire", "sources"),
    "the native device: number, time, units, tracker, sums, filters": ("stream/decode",),
    "blocks of samples": ("stream/sensors", "stream/tracking", "stream/channels", "records/block"),
    "fits that count": (
        "estimator",
        "spectrum",
        "stream/live",
        "stream/fit_times",
        "stream/beside",
        "stream/tuning",
    ),
    "lines": ("sinks",),
}
"""Files by what they do; the longest name of a folder or file counts."""

OTHER, BESIDE = "pipeline and statistics", "looks of the fit, beside the walk"


def part_of(file: str) -> str:
    """Return what a file of the package does."""
    names = [(len(one), part) for part, files in PARTS.items() for one in files if file.startswith(one)]
    return max(names, default=(0, OTHER))[1]


class Apart(FitWorker):
    """Makes looks of the fit where their result is asked for, as it is usual, and says when one is made."""

    making = False

    def begin(self, work: Callable[[], T]) -> Callable[[], T]:
        """Begin some work."""

        def made() -> T:
            self.making = True
            try:
                return work()
            finally:
                self.making = False

        return made


class Looks:
    """Counts which part was at work whenever so much processor time has passed."""

    def __init__(self, apart: Apart) -> None:
        self.seen: Counter[str] = Counter()
        self._apart = apart

    def __call__(self, number: int, frame: FrameType | None) -> None:
        """Find the innermost file of the package."""
        while frame is not None and not frame.f_code.co_filename.startswith(PACKAGE):
            frame = frame.f_back
        file = OTHER if frame is None else frame.f_code.co_filename[len(PACKAGE) :]
        self.seen[BESIDE if self._apart.making else part_of(file)] += 1


def _reads(at_once: int) -> Iterator[Chunk]:
    noise = np.random.default_rng(1).normal(0, 3, (SAMPLES, 3)).round().astype(int)
    sent = frames(0, noise.tolist())
    for end in range(at_once, SAMPLES + 1, at_once):
        yield Chunk(b"".join(islice(sent, at_once)), end * PERIOD_NS)


def measure() -> dict[str, Any]:
    """By samples a read: microseconds of a read, and of its parts."""
    return {f"{at_once}": _measure(at_once) for at_once in (1, 2)}


def _measure(at_once: int) -> dict[str, Any]:
    source, apart = FedSource("profile", prompt=False), Apart()
    looks = Looks(apart)
    pipeline = Pipeline(source, load_config(None, {"source": "serial:profile"}), fit_worker=apart)
    reads = list(_reads(at_once))
    with FileIO(os.devnull, "wb") as stream:
        sink = NdjsonSink(stream, samples=False)

        def walk(reads: list[Chunk]) -> None:
            for chunk in reads:
                for event in source.wire.feed(chunk, chunk.host_ns):
                    for item in pipeline.feed(event):
                        sink.write(item)
                sink.flush()

        list(source.wire.feed(Opened(0), 0))
        walk(reads[: WARM_UP // at_once])
        before = signal.signal(signal.SIGPROF, looks)
        signal.setitimer(signal.ITIMER_PROF, LOOK_S, LOOK_S)
        begin_s = time.process_time()
        walk(reads[WARM_UP // at_once :])
        cpu_s = time.process_time() - begin_s
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)
    us = 1e6 * cpu_s / (len(reads) - WARM_UP // at_once)
    total = sum(looks.seen.values())
    shares = {part: us * looks.seen[part] / total for part in (*PARTS, OTHER, BESIDE)}
    return {"us_a_read": us, "times_looked": total, "parts_us": shares}


def text(found: dict[str, Any]) -> str:
    """The parts as a table."""
    columns = list(found.values())
    rows = [(part, *(f"{one['parts_us'][part]:.1f}" for one in columns)) for part in (*PARTS, OTHER, BESIDE)]
    rows.append(("all", *(f"{one['us_a_read']:.1f}" for one in columns)))
    title = "A live device from bytes to lines, µs of processor time a read"
    return Table(title, ("", *(f"{n} samples a read" for n in found)), rows).markdown()
