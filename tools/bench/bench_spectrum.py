"""What the live spectrum and the Allan deviation cost alone: sums a sample, curves, fits of models."""

import statistics
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from fltea._native import AllanSums
from fltea.noise import spectra
from fltea.noise.allan_deviation import model_adev
from fltea.spectrum.allan_curve import live_allan
from fltea.spectrum.models import AR1, AR2, FULL, TWO_AR1, UP_TO_ONE, WHITE
from fltea.spectrum.octaves import LANE_BYTES, Octaves
from fltea.spectrum.periodogram import Binned, binned
from fltea.spectrum.profile import fractional_fit
from fltea.spectrum.whittle import fit

from tools.bench.measured import cpu_seconds, in_turns

H = 0.01
REPETITIONS = 9
LANES, ROWS, SINGLE_ROWS = 3, 200_000, 20_000
SAMPLES, MEMORY_SAMPLES = 1_000_000, 60_000.0
BINS = 130
MODELS = (WHITE, AR1, UP_TO_ONE, FULL, AR2, TWO_AR1)
CASES = ((0.3, -1.5, 3.0), (0.6, -3.0, 3.0), (0.8, -1.0, 0.3), (0.8, -10.0, 3.0))
"""α, f and s2/R of the spectra that are fitted."""


def measure() -> dict[str, Any]:
    """Bytes of memory, and of each work the processor time: the median and the largest of the rounds."""
    works = [*_octaves(), *_allan(), *_fits()]
    times = in_turns({name: partial(cpu_seconds, run) for name, _, _, run in works}, REPETITIONS)
    timed = [
        {
            "work": name,
            "unit": unit,
            "median": scale * statistics.median(times[name]),
            "largest": scale * max(times[name]),
        }
        for name, unit, scale, _ in works
    ]
    sums = AllanSums()
    sums.add(np.random.default_rng(1).standard_normal(SAMPLES))
    return {"works": timed, "lane_bytes": LANE_BYTES, "allan_bytes_saved": len(sums.save())}


def text(figures: dict[str, Any]) -> str:
    """Return the figures as lines for people."""
    head = f"Live spectrum and Allan deviation, processor time of {REPETITIONS} rounds: median (largest)"
    lines = [f"{r['work']:<52}{r['median']:>9.2f} ({r['largest']:.2f}) {r['unit']}" for r in figures["works"]]
    lane, saved = figures["lane_bytes"], figures["allan_bytes_saved"]
    sizes = f"bytes: a lane's spectrum {lane:,}, saved Allan sums {saved:,}"
    return "\n".join([head, *lines, sizes])


Work = tuple[str, str, float, Callable[[], object]]
"""Name, unit, how many of the unit a second is, and what is measured."""


def _octaves() -> list[Work]:
    y = np.random.default_rng(1).standard_normal((ROWS, LANES))
    octaves = Octaves(LANES)
    octaves.add(y)

    def add(rows: int, end: int) -> None:
        sums = Octaves(LANES)
        for begin in range(0, end, rows):
            sums.add(y[begin : begin + rows])

    def look() -> None:
        for lane in range(LANES):
            binned(octaves.periodogram(lane, H))

    look()  # the first one fills what is kept
    works: list[Work] = [
        (f"spectrum: a sample, {rows:,} rows a call", "ns", 1e9 / (end * LANES), partial(add, rows, end))
        for rows, end in ((1, SINGLE_ROWS), (10, ROWS), (100, ROWS), (ROWS, ROWS))
    ]
    return [*works, ("spectrum: a look, in bins", "us", 1e6 / LANES, look)]


def _allan() -> list[Work]:
    y = np.random.default_rng(1).standard_normal(SAMPLES)
    sums = AllanSums()
    sums.add(y)
    points, span = sums.points(), sums.span

    def model() -> object:
        return model_adev(lambda lam: 3 * spectra.fractional(lam, 0.8, -0.025) + 1, points[0])

    return [
        ("Allan: a sample (at most 10 ns)", "ns", 1e9 / SAMPLES, lambda: AllanSums().add(y)),
        ("Allan: a sample, forgetting", "ns", 1e9 / SAMPLES, lambda: AllanSums(MEMORY_SAMPLES).add(y)),
        ("Allan: a curve with intervals, N, B and K", "ms", 1e3, lambda: live_allan(*points, span, H)),
        ("Allan: the curve of the model", "ms", 1e3, model),
    ]


def _fits() -> list[Work]:
    axes = [_axis(*case, seed) for seed, case in enumerate(CASES)]
    found = [(axis, [fit(axis, model) for model in MODELS]) for axis in axes]

    def intervals() -> None:
        for axis, fits in found:
            fractional_fit(axis, next(one for one in fits if one.model is FULL), H)

    return [
        (f"fit of an axis: {len(MODELS)} models from the last answer", "ms", 1e3 / len(axes), lambda: [
            fit(axis, one.model, warm=one.theta + 0.02) for axis, fits in found for one in fits
        ]),
        (f"fit of an axis: {len(MODELS)} models from the grid", "ms", 1e3 / len(axes), lambda: [
            fit(axis, model) for axis in axes for model in MODELS
        ]),
        ("fit of an axis: intervals of 6 parameters", "ms", 1e3 / len(axes), intervals),
    ]  # fmt: skip


def _axis(alpha: float, f: float, ratio: float, seed: int) -> Binned:
    """Bins that grow with the frequency, as those of the live spectrum after ten minutes."""
    edges = np.geomspace(4e-4, np.pi, BINS + 1)
    lam = (edges[1:] + edges[:-1]) / 2
    counts = np.maximum(1.0, np.diff(edges) * 60_000 / (2 * np.pi))
    shape = ratio * spectra.fractional(lam, alpha, H**alpha * f) + 1
    power = shape * np.random.default_rng(seed).gamma(counts) / counts
    return Binned(lam, counts, power[np.newaxis])
