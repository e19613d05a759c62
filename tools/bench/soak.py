"""Streams days of a device's data in minutes.

The test shows whether the memory stays constant, and whether all losses are counted.

`make bench ARGS='--soak [--hours 24] [--seed 1]'`. A device sends samples, HELLO and STATUS in virtual time.
On the way to the host, frames are lost, bits flip, and the port is silent for a while. Now and then the board
is reset. The bytes pass through the same functions as in `fltea run`, into NDJSON. Then the numbers at both
ends are compared: in each boot, every sequence number from the first to the last that the host used must have
been delivered or counted as lost.
"""

import gc
import io
import os
import random
import sys
import time
from collections.abc import Iterator
from typing import Any

import psutil
from fltea.records.block import Block
from fltea.records.events import Chunk, Opened
from fltea.records.records import Epoch, Gap, Stats
from fltea.service.ending import Ending
from fltea.service.hub import Hub
from fltea.settings.config import load_config
from fltea.sinks.ndjson import NdjsonSink
from fltea.stream.pipeline import Pipeline

from tools.bench.feeder import hello_of
from tools.fed_source import FedSource
from tools.made_up_board import STATUS, MadeUpBoard, frames

PERIOD_US = 10_000
HOUR = 360_000
LOSS, FLIP, SILENCE, RESET = 1e-3, 1e-3, 1e-5, 1 / (2 * HOUR)
"""Probabilities per sample: a frame is lost, a bit flips, a silence begins, the board is reset."""

LONGEST_SILENCE = 3000


class Sent:
    """What the device sent: the number of sampling instants of each boot, and the number of faults."""

    def __init__(self) -> None:
        self.boots: dict[int, int] = {}
        self.frames_lost = self.bits_flipped = self.silences = 0


def stream(samples: int, seed: int, sent: Sent) -> Iterator[tuple[bytes, int]]:
    """Yield bytes with their monotonic time of arrival [ns]. The device's clock is 40 ppm too fast."""
    rng = random.Random(seed)
    device = MadeUpBoard(hello_of(1), status=STATUS, pace=1 + 40e-6)
    boot = silent = 0
    for n in range(samples):
        if n == 0 or rng.random() < RESET:
            boot += 1
            device.restart(boot_id=boot)
        data = frames(device.tick([round(rng.gauss(0, 3)) for _ in range(3)]))
        sent.boots[boot] = device.instant
        if silent:
            silent -= 1
            continue
        if rng.random() < SILENCE:
            silent = rng.randrange(LONGEST_SILENCE)
            sent.silences += 1
            continue
        if rng.random() < LOSS:
            sent.frames_lost += 1
            continue
        if rng.random() < FLIP:
            sent.bits_flipped += 1
            at = rng.randrange(len(data))
            data = data[:at] + bytes([data[at] ^ 1 << rng.randrange(8)]) + data[at + 1 :]
        yield data, n * PERIOD_US * 1000 + rng.randrange(2_000_000)


class Seen:
    """What the host reports.

    `epochs`: for each epoch (a run of samples without restart) its boot, the sequence numbers of its first
    and last sample, and its counts. `stats`: the newest statistics.
    """

    def __init__(self) -> None:
        self.epochs: list[dict[str, int]] = []
        self.stats: Stats | None = None

    def add(self, record: Any) -> None:
        """Include a record in the counts."""
        match record:
            case Epoch():
                self.epochs.append(
                    {"boot": record.boot_id or 0, "first": record.seq, "delivered": 0, "lost": 0}
                )
            case Block():
                self.epochs[-1]["delivered"] += len(record)
                self.epochs[-1]["last"] = int(record.seq[-1])
            case Gap():
                # A gap belongs to the epoch (run of samples) before it: the host reports the gap first, and
                # then the epoch that may begin after the gap.
                self.epochs[-1]["lost"] += record.missing
            case Stats():
                self.stats = record


def rss_mb() -> float:
    """Return the present memory of this process [MB]."""
    gc.collect()
    return float(psutil.Process().memory_info().rss / 2**20)


def measure(hours: float = 24.0, seed: int = 1) -> dict[str, Any]:
    """Stream `hours` of data; return the figures, including the memory at each hour."""
    sent, seen, source = Sent(), Seen(), FedSource("soak", prompt=False)
    pipeline = Pipeline(source, load_config(None, {"source": "serial:soak"}))
    hub = Hub(lambda error: None)
    sink = io.FileIO(os.open(os.devnull, os.O_WRONLY), "wb")
    hub.add(NdjsonSink(sink, samples=False))
    memory, begin_s = [], time.process_time()
    list(source.wire.feed(Opened(0), 0))
    hour_ns, next_ns = HOUR * PERIOD_US * 1000, 0
    for data, host_ns in stream(int(hours * HOUR), seed, sent):
        if host_ns >= next_ns:
            memory.append(rss_mb())
            next_ns += hour_ns
            print(f"hour {len(memory) - 1}: {memory[-1]:.1f} MB", file=sys.stderr, flush=True)
        for event in source.wire.feed(Chunk(data, host_ns), host_ns):
            records = list(pipeline.feed(event))
            for record in records:
                seen.add(record)
            hub.publish("soak", records, wait=True)
    seen.add(pipeline.stats())
    Ending(lambda: False, lambda: 0, print).wait(hub.close())
    sink.close()
    memory.append(rss_mb())
    assert seen.stats is not None
    return {
        "hours": hours,
        "cpu_s": time.process_time() - begin_s,
        "memory_mb": memory,
        "growth_mb_after_first_hour": memory[-1] - memory[min(1, len(memory) - 1)],
        "boots": len(sent.boots),
        "sent": sum(sent.boots.values()),
        "frames_lost": sent.frames_lost,
        "bits_flipped": sent.bits_flipped,
        "silences": sent.silences,
        "delivered": seen.stats.sample_counts.delivered,
        "lost": seen.stats.sample_counts.lost,
        "gaps": seen.stats.sample_counts.gaps,
        "before_hello": seen.stats.sample_counts.before_hello,
        "bad_frames": seen.stats.link.bad_frames,
        "epochs": len(seen.epochs),
        "uncounted": uncounted(seen),
    }


def uncounted(seen: Seen) -> int:
    """Return how many samples are not accounted for.

    Such a sample is between the first and the last sample of a boot that the host used, but was neither
    delivered nor counted as lost.
    """
    missing = 0
    for boot in {epoch["boot"] for epoch in seen.epochs}:
        epochs = [epoch for epoch in seen.epochs if epoch["boot"] == boot and "last" in epoch]
        due = epochs[-1]["last"] - epochs[0]["first"] + 1
        missing += abs(due - sum(epoch["delivered"] + epoch["lost"] for epoch in epochs))
    return missing


def text(figures: dict[str, Any]) -> str:
    """Return the figures as lines for people."""
    return "\n".join(f"{name:28} {value}" for name, value in figures.items())
