"""Cost of the running spectrum: a sample of a lane in blocks of some sizes, and a look at the spectrum."""

import statistics
import time
from typing import Any

import numpy as np
from fltea.spectrum.octaves import LANE_BYTES, Octaves
from fltea.spectrum.periodogram import binned

LANES = 3
ROWS = 200_000
BLOCKS = (1, 10, 100, ROWS)
"""Rows a call; of one row a call only the first tenth is measured."""
REPETITIONS = 5
H = 0.01


def measure() -> dict[str, Any]:
    """Nanoseconds of processor time a sample and lane, and microseconds a look; medians of the rounds."""
    y = np.random.default_rng(1).standard_normal((ROWS, LANES))
    figures: dict[str, Any] = {"lanes": LANES, "rows": ROWS, "repetitions": REPETITIONS, "bytes": LANE_BYTES}
    rounds = [{rows: _sample_ns(y, rows) for rows in BLOCKS} for _ in range(REPETITIONS)]
    for rows in BLOCKS:
        figures[f"ns_per_sample_{rows}"] = statistics.median(found[rows] for found in rounds)
    octaves = Octaves(LANES)
    octaves.add(y)
    looks = [_look_us(octaves) for _ in range(REPETITIONS + 1)][1:]  # the first one fills what is kept
    return figures | {"us_per_look": statistics.median(looks)}


def text(figures: dict[str, Any]) -> str:
    """Return the figures as lines for people."""
    costs = ", ".join(f"{figures[f'ns_per_sample_{rows}']:.0f} ns at {rows:,}" for rows in BLOCKS)
    return "\n".join(
        [
            f"running spectrum, {figures['lanes']} lanes, {figures['rows']:,} samples, processor time, "
            f"medians of {figures['repetitions']} rounds",
            f"a sample of a lane, by rows a call: {costs}",
            f"a lane's spectrum in bins: {figures['us_per_look']:.0f} us; memory of a lane: "
            f"{figures['bytes']:,} bytes",
        ]
    )


def _sample_ns(y: np.ndarray[Any, np.dtype[np.float64]], rows: int) -> float:
    end = len(y) // 10 if rows == 1 else len(y)
    octaves = Octaves(LANES)
    start = time.process_time()
    for begin in range(0, end, rows):
        octaves.add(y[begin : begin + rows])
    return (time.process_time() - start) * 1e9 / (end * LANES)


def _look_us(octaves: Octaves) -> float:
    start = time.process_time()
    for lane in range(LANES):
        binned(octaves.periodogram(lane, H))
    return (time.process_time() - start) * 1e6 / LANES
