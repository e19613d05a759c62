"""Speed of the host's decoder beside PyPI's bare COBS decoding of the same bytes, side by side in one run."""

import statistics
import time
from collections.abc import Callable
from typing import Any

from cobs import cobs
from fltea.wire import layout as wire
from fltea.wire.messages import FrameReader, encode

FRAMES = 20_000
CHUNK = 4096
REPETITIONS = 9


def measure() -> dict[str, Any]:
    """Frames per second of both, alternating; `ratio` is the median of the ratios of neighbouring runs."""
    stream = b"".join(
        encode(wire.Sample(k % 7, -k % 5, k % 3, 0, 0, 16384, 1335, 0), k % 65536, k * 10_000)
        for k in range(FRAMES)
    )
    chunks = [stream[i : i + CHUNK] for i in range(0, len(stream), CHUNK)]

    def ours() -> int:
        reader = FrameReader()
        return sum(len(reader.feed(chunk)) for chunk in chunks)

    def bare() -> int:
        return len([cobs.decode(block) for block in stream.split(b"\0") if block])

    rates = [(_rate(ours), _rate(bare)) for _ in range(REPETITIONS)]
    return {
        "frames": FRAMES,
        "repetitions": REPETITIONS,
        "fltea_frames_per_s": statistics.median(r[0] for r in rates),
        "fltea_frames_per_s_min": min(r[0] for r in rates),
        "fltea_frames_per_s_max": max(r[0] for r in rates),
        "cobs_frames_per_s": statistics.median(r[1] for r in rates),
        "ratio": statistics.median(bare / ours for ours, bare in rates),
    }


def _rate(decode: Callable[[], int]) -> float:
    start = time.perf_counter()
    decoded = decode()
    seconds = time.perf_counter() - start
    if decoded != FRAMES:
        raise RuntimeError(f"{decoded} frames decoded, {FRAMES} sent: the figure is void")
    return FRAMES / seconds
