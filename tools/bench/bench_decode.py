"""Measures the decoders: the native one, the one in Python, and the library cobs.

All decode the same bytes, alternately in one run. The library cobs only decodes COBS.
"""

import statistics
from collections.abc import Callable
from functools import partial
from typing import Any

from cobs import cobs
from fltea.wire.block_reader import BlockReader, FrameReader, SampleColumns

from tools.bench.measured import cpu_seconds, in_turns
from tools.made_up_board import MadeUpBoard

FRAMES = 20_000
CHUNK = 4096
LARGE_CHUNK = 65536
REPETITIONS = 9
WORDS = {
    "native": f"COBS, CRC, version, fields as columns; {CHUNK:,} bytes a call",
    "native_large": f"the same; {LARGE_CHUNK:,} bytes a call",
    "python": f"the same, one object a frame; {CHUNK:,} bytes a call",
    "cobs": "COBS alone",
}


def native(chunks: list[bytes]) -> int:
    """Return the number of samples that the native reader decodes."""
    reader = BlockReader()
    blocks = (block for chunk in chunks for block in reader.feed(chunk))
    return sum(len(block.sequence) for block in blocks if isinstance(block, SampleColumns))


def python(chunks: list[bytes]) -> int:
    """Return the number of frames that the reader in Python decodes."""
    reader = FrameReader()
    return sum(len(reader.feed(chunk)) for chunk in chunks)


def bare(stream: bytes) -> int:
    """Return the number of blocks that the library cobs decodes."""
    return len([cobs.decode(block) for block in stream.split(b"\0") if block])


def measure() -> dict[str, Any]:
    """Return the frames per second of all decoders, and the time of a call with one frame [us].

    Figures are medians over the rounds; a ratio is the median of the ratios within a round.
    """
    board = MadeUpBoard()
    frames = [board.sample((k % 7, -k % 5, k % 3)).frame for k in range(FRAMES)]
    stream = b"".join(frames)
    small, large = _chunks(stream, CHUNK), _chunks(stream, LARGE_CHUNK)
    works: dict[str, Callable[[], int]] = {
        "native": partial(native, small),
        "native_large": partial(native, large),
        "python": partial(python, small),
        "cobs": partial(bare, stream),
        "native_single": partial(native, frames),
        "python_single": partial(python, frames),
    }
    rates = in_turns({name: partial(_rate, work) for name, work in works.items()}, REPETITIONS)
    figures: dict[str, Any] = {"frames": FRAMES, "repetitions": REPETITIONS}
    for name in WORDS:
        figures[f"{name}_frames_per_s"] = statistics.median(rates[name])
        figures[f"{name}_frames_per_s_min"] = min(rates[name])
        figures[f"{name}_frames_per_s_max"] = max(rates[name])
    for name in ("native", "python"):
        figures[f"{name}_us_per_call"] = 1e6 / statistics.median(rates[f"{name}_single"])
    for other in ("python", "cobs"):
        ratios = (a / b for a, b in zip(rates["native"], rates[other], strict=True))
        figures[f"native_over_{other}"] = statistics.median(ratios)
    return figures


def text(figures: dict[str, Any]) -> str:
    """Return the figures as lines for people."""
    lines = [f"decoding {FRAMES:,} SAMPLE frames, processor time, medians of {REPETITIONS} rounds"]
    for name, words in WORDS.items():
        median, low, high = (figures[f"{name}_frames_per_s{end}"] for end in ("", "_min", "_max"))
        lines.append(f"{name:<18}{median:>12,.0f} frames/s ({low:,.0f} to {high:,.0f}): {words}")
    lines += [
        f"native is {figures['native_over_python']:.1f} times as fast as Python and "
        f"{figures['native_over_cobs']:.1f} times as fast as bare cobs",
        f"a call with one frame: native {figures['native_us_per_call']:.2f} us, "
        f"Python {figures['python_us_per_call']:.2f} us",
    ]
    return "\n".join(lines)


def _chunks(stream: bytes, size: int) -> list[bytes]:
    return [stream[i : i + size] for i in range(0, len(stream), size)]


def _rate(decode: Callable[[], int]) -> float:
    found: list[int] = []
    seconds = cpu_seconds(lambda: found.append(decode()))
    if found != [FRAMES]:
        raise RuntimeError(f"{found} frames were decoded of {FRAMES}, so the measured speed is wrong")
    return FRAMES / seconds
