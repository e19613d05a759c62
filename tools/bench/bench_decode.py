"""Speed of the native decoder, as blocks and frame by frame, and of PyPI's bare COBS on the same bytes."""

import statistics
import time
from collections.abc import Callable
from typing import Any

from cobs import cobs
from fltea.wire import layout as wire
from fltea.wire.block_reader import BlockReader, FrameReader, SampleColumns
from fltea.wire.messages import encode

FRAMES = 20_000
CHUNK = 4096
LARGE_CHUNK = 65536
REPETITIONS = 9


def measure() -> dict[str, Any]:
    """Frames per second of all, in turns, and microseconds of a call that brings one frame.

    Processor time, which a busy machine changes least. Figures are medians of the rounds; a ratio is the
    median of the ratios within a round.
    """
    frames = [
        encode(wire.Sample(k % 7, -k % 5, k % 3, 0, 0, 16384, 1335, 0), k % 65536, k * 10_000)
        for k in range(FRAMES)
    ]
    stream = b"".join(frames)

    def native(chunks: list[bytes]) -> int:
        reader = BlockReader()
        blocks = (block for chunk in chunks for block in reader.feed(chunk))
        return sum(len(block.sequence) for block in blocks if isinstance(block, SampleColumns))

    def single(chunks: list[bytes]) -> int:
        reader = FrameReader()
        return sum(len(reader.feed(chunk)) for chunk in chunks)

    def bare() -> int:
        return len([cobs.decode(block) for block in stream.split(b"\0") if block])

    small, large = _chunks(stream, CHUNK), _chunks(stream, LARGE_CHUNK)
    contenders: dict[str, Callable[[], int]] = {
        "native": lambda: native(small),
        "native_large": lambda: native(large),
        "frames": lambda: single(small),
        "cobs": bare,
        "native_single": lambda: native(frames),
        "frames_single": lambda: single(frames),
    }
    rounds = [{name: _rate(run) for name, run in contenders.items()} for _ in range(REPETITIONS)]

    def median_ratio(name: str, other: str) -> float:
        return statistics.median(rates[name] / rates[other] for rates in rounds)

    figures: dict[str, Any] = {"frames": FRAMES, "repetitions": REPETITIONS}
    for name in ("native", "native_large", "frames", "cobs"):
        rates = [rates[name] for rates in rounds]
        figures[f"{name}_frames_per_s"] = statistics.median(rates)
        figures[f"{name}_frames_per_s_min"] = min(rates)
        figures[f"{name}_frames_per_s_max"] = max(rates)
    for name in ("native", "frames"):
        figures[f"{name}_us_per_call"] = statistics.median(1e6 / rates[f"{name}_single"] for rates in rounds)
    return figures | {
        "native_over_frames": median_ratio("native", "frames"),
        "native_over_cobs": median_ratio("native", "cobs"),
    }


def text(figures: dict[str, Any]) -> str:
    """Return the figures as lines for people."""

    def line(label: str, name: str, what: str) -> str:
        median, low, high = (figures[f"{name}_frames_per_s{end}"] for end in ("", "_min", "_max"))
        return f"{label:<18}{median:>12,.0f} frames/s ({low:,.0f} to {high:,.0f}): {what}"

    return "\n".join(
        [
            f"decoding {figures['frames']:,} SAMPLE frames, processor time, "
            f"medians of {figures['repetitions']} rounds",
            line("native", "native", f"COBS, CRC, version, fields as columns; {CHUNK:,} bytes a call"),
            line("native", "native_large", f"the same; {LARGE_CHUNK:,} bytes a call"),
            line("frames", "frames", f"the same, one object a frame; {CHUNK:,} bytes a call"),
            line("bare cobs", "cobs", "COBS alone"),
            f"as columns {figures['native_over_frames']:.1f} times as fast as frame by frame, and "
            f"{figures['native_over_cobs']:.1f} times as fast as bare cobs",
            f"a call that brings one frame: as columns {figures['native_us_per_call']:.2f} us, "
            f"as a frame {figures['frames_us_per_call']:.2f} us",
        ]
    )


def _chunks(stream: bytes, size: int) -> list[bytes]:
    return [stream[i : i + size] for i in range(0, len(stream), size)]


def _rate(decode: Callable[[], int]) -> float:
    start = time.process_time()
    decoded = decode()
    seconds = time.process_time() - start
    if decoded != FRAMES:
        raise RuntimeError(f"{decoded} frames decoded, {FRAMES} sent: the figure is void")
    return FRAMES / seconds
