"""Shows where the processor time of a live device goes, from bytes to JSON lines: `make bench ARGS=--loop`.

A device with white noise runs for ten minutes of virtual time, and this is done twice. Each read has one
sample, as with a `link.latency` of 0 ms, or two, as with 20 ms. The bytes pass through the same functions as
in `fltea run`, but all in one thread; `fltea run` refits in a thread of its own. A timer interrupts the
program after equal amounts of processor time. Each time, the file of fltea whose code is running is recorded.
The real program also needs time for wake-ups, threads and queues.
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

from tools.bench.feeder import PERIOD_NS, board, sent_by
from tools.fed_source import FedSource
from tools.validation.tables import Table

T = TypeVar("T")

SAMPLES, WARM_UP = 60_000, 6_000
SAMPLE_S = 0.0005
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
        "stream/fit_worker",
        "stream/tuning",
    ),
    "lines": ("sinks",),
}
"""For each task, the beginnings of the names of the files that do it. If several beginnings match a file's
name, the longest decides.
"""

OTHER, BESIDE = "pipeline and statistics", "refits, which have a thread of their own"


def part_of(file: str) -> str:
    """Return the name of the task to which a file of the package belongs."""
    names = [(len(one), part) for part, files in PARTS.items() for one in files if file.startswith(one)]
    return max(names, default=(0, OTHER))[1]


class InlineWorker(FitWorker):
    """Makes a refit in this thread when its result is requested; the daemon has another thread for it.

    `making` is true while a refit is made.
    """

    making = False

    def begin(self, work: Callable[[], T]) -> Callable[[], T]:
        """Return a function that calls `work`, which makes the refit."""

        def made() -> T:
            self.making = True
            try:
                return work()
            finally:
                self.making = False

        return made


class Profiler:
    """Handles the signal of the timer of processor time: counts which task was running at each signal."""

    def __init__(self, worker: InlineWorker) -> None:
        self.seen: Counter[str] = Counter()
        self._worker = worker

    def __call__(self, number: int, frame: FrameType | None) -> None:
        """Count one interrupt for the running task: the refit, or that of the innermost function of fltea."""
        while frame is not None and not frame.f_code.co_filename.startswith(PACKAGE):
            frame = frame.f_back
        file = OTHER if frame is None else frame.f_code.co_filename[len(PACKAGE) :]
        self.seen[BESIDE if self._worker.making else part_of(file)] += 1


def _reads(at_once: int) -> Iterator[Chunk]:
    noise = np.random.default_rng(1).normal(0, 3, (SAMPLES, 3)).round().astype(int)
    sent = sent_by(board(0), noise.tolist())
    for end in range(at_once, SAMPLES + 1, at_once):
        yield Chunk(b"".join(islice(sent, at_once)), end * PERIOD_NS)


def measure() -> dict[str, Any]:
    """Return microseconds per read for each task, for one and for two samples in each read."""
    return {f"{at_once}": _measure(at_once) for at_once in (1, 2)}


def _measure(at_once: int) -> dict[str, Any]:
    source, worker = FedSource("profile", prompt=False), InlineWorker()
    profiler = Profiler(worker)
    pipeline = Pipeline(source, load_config(None, {"source": "serial:profile"}), fit_worker=worker)
    reads = list(_reads(at_once))
    with FileIO(os.devnull, "wb") as stream:
        sink = NdjsonSink(stream, samples=False)

        def process(reads: list[Chunk]) -> None:
            for chunk in reads:
                for event in source.wire.feed(chunk, chunk.host_ns):
                    for item in pipeline.feed(event):
                        sink.write(item)
                sink.flush()

        list(source.wire.feed(Opened(0), 0))
        process(reads[: WARM_UP // at_once])
        before = signal.signal(signal.SIGPROF, profiler)
        signal.setitimer(signal.ITIMER_PROF, SAMPLE_S, SAMPLE_S)
        begin_s = time.process_time()
        process(reads[WARM_UP // at_once :])
        cpu_s = time.process_time() - begin_s
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)
    us = 1e6 * cpu_s / (len(reads) - WARM_UP // at_once)
    total = sum(profiler.seen.values())
    shares = {part: us * profiler.seen[part] / total for part in (*PARTS, OTHER, BESIDE)}
    return {"us_a_read": us, "times_looked": total, "parts_us": shares}


def text(found: dict[str, Any]) -> str:
    """Return the times of the tasks as a table."""
    columns = list(found.values())
    rows = [(part, *(f"{one['parts_us'][part]:.1f}" for one in columns)) for part in (*PARTS, OTHER, BESIDE)]
    rows.append(("all", *(f"{one['us_a_read']:.1f}" for one in columns)))
    title = "A live device from bytes to lines, µs of processor time a read"
    return Table(title, ("", *(f"{n} samples a read" for n in found)), rows).markdown()
