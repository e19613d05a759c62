"""Measures the time of the live spectrum and the live Allan deviation.

The figures are the time to add a sample, the time to compute the curves that the live page shows, and the
time of refits (fits as the record grows).
"""

import statistics
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from fltea._native import AllanSums
from fltea.noise import spectra
from fltea.noise.allan_deviation import model_adev
from fltea.settings.live import LiveConfig
from fltea.spectrum.allan_curve import live_allan
from fltea.spectrum.candidate_models import CandidateModels
from fltea.spectrum.evidence import ANYTIME_LEVEL
from fltea.spectrum.live_axes import AxisRefit, LiveAxes
from fltea.spectrum.octaves import LANE_BYTES, Octaves
from fltea.spectrum.order_fit import order_fit
from fltea.spectrum.periodogram import binned
from fltea.spectrum.spectral import examine
from numpy.typing import NDArray

from tools.bench.measured import cpu_seconds, in_turns
from tools.validation.gallery.noises import NOISES as GALLERY
from tools.validation.gallery.parts import Part

H = 0.01
REPETITIONS = 9
LANES, ROWS, SINGLE_ROWS = 3, 200_000, 20_000
SAMPLES, MEMORY_SAMPLES = 1_000_000, 60_000.0
LENGTHS = (3_000, 60_000, 1_000_000)
USUAL = LENGTHS[1]
NOISES = {
    name: GALLERY[name].parts
    for name in ("white", "state 0.8, -1, 3", "1/f, 1 Hz", "3 relaxations", "3 relaxations, angle")
}


def measure() -> dict[str, Any]:
    """Return the median and the largest processor time of each measured task over the rounds.

    Also return the size of an axis's live spectrum, and that of a saved live Allan deviation [bytes].
    """
    works = [*_octaves(), *_allan(), *_models(), *_last_refits()]
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
    return {
        "works": timed,
        "refits_ms": _medians(timed),
        "lane_bytes": LANE_BYTES,
        "allan_bytes_saved": len(sums.save()),
    }


def _medians(timed: list[dict[str, Any]]) -> dict[str, float]:
    """Return, for each kind of refit and length of the record, the median time over the noises."""
    last_refit: dict[str, list[float]] = {}
    for one in timed:
        kind, _, noise = one["work"].partition(": ")
        if noise in NOISES:
            last_refit.setdefault(kind, []).append(one["median"])
    return {kind: round(statistics.median(each), 2) for kind, each in last_refit.items()}


def text(figures: dict[str, Any]) -> str:
    """Return the figures as lines for people."""
    head = f"Live spectrum and Allan deviation, processor time of {REPETITIONS} rounds: median (largest)"
    lines = [f"{r['work']:<52}{r['median']:>9.2f} ({r['largest']:.2f}) {r['unit']}" for r in figures["works"]]
    lane, saved = figures["lane_bytes"], figures["allan_bytes_saved"]
    sizes = f"bytes: a lane's spectrum {lane:,}, saved Allan sums {saved:,}"
    refits = ", ".join(f"{kind} {ms:.2f}" for kind, ms in figures["refits_ms"].items())
    return "\n".join([head, *lines, f"median of the noises, ms: {refits}", sizes])


Work = tuple[str, str, float, Callable[[], object]]
"""A measured task: its name, the unit of its time, the factor from seconds to that unit, and its function."""


def _octaves() -> list[Work]:
    y = np.random.default_rng(1).standard_normal((ROWS, LANES))
    octaves = Octaves(LANES)
    octaves.add(y)

    def add(rows: int, end: int) -> None:
        sums = Octaves(LANES)
        for begin in range(0, end, rows):
            sums.add(y[begin : begin + rows])

    def compute() -> None:
        for lane in range(LANES):
            binned(octaves.periodogram(lane, H))

    compute()  # The first call is not measured, since it allocates memory that later calls reuse.
    works: list[Work] = [
        (f"spectrum: a sample, {rows:,} rows a call", "ns", 1e9 / (end * LANES), partial(add, rows, end))
        for rows, end in ((1, SINGLE_ROWS), (10, ROWS), (100, ROWS), (ROWS, ROWS))
    ]
    return [*works, ("spectrum: a periodogram in bins", "us", 1e6 / LANES, compute)]


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


def _models() -> list[Work]:
    """Return the tasks of a refit that run in native code.

    One call does a task for every noise. The time of the call is divided by the number of noises.
    """
    found = []
    for parts in NOISES.values():
        sums = Octaves(1)
        sums.add(_drawn(parts, USUAL))
        lines = sums.periodogram(0, H)
        found.append(examine(lines, USUAL * H, USUAL, level=ANYTIME_LEVEL).evidence.candidates)
    each = 1e3 / len(found)
    return [
        ("models of an axis: a model search", "ms", each, lambda: [
            CandidateModels(one.data, H, USUAL) for one in found
        ]),
        ("models of an axis: fitted again", "ms", each, lambda: [
            CandidateModels(one.data, H, USUAL, one.fits) for one in found
        ]),
        ("models of an axis: intervals of the order", "ms", each, lambda: [
            order_fit(one, one.order) for one in found if one.order is not None
        ]),
    ]  # fmt: skip


def _last_refits() -> list[Work]:
    """Return tasks that refit an axis without new samples, once without and once with a model search."""

    def made(axes: LiveAxes, *, fresh: bool) -> AxisRefit:
        return axes.refits(curves=False, fresh=fresh)["x"]()

    works: list[Work] = []
    for samples in LENGTHS:
        for name, parts in NOISES.items():
            axis = LiveAxes(("x",), H, LiveConfig(), "deg/s")
            axis.add(_drawn(parts, samples))
            axis.fit(curves=False)
            again, search = (partial(made, axis, fresh=fresh) for fresh in (False, True))
            works.append((f"refit, {samples:,} samples: {name}", "ms", 1e3, again))
            works.append((f"model search, {samples:,} samples: {name}", "ms", 1e3, search))
    return works


def _drawn(parts: tuple[Part, ...], samples: int) -> NDArray[np.float64]:
    rng = np.random.default_rng(samples)
    return np.asarray(sum(part.draw(samples, 1 / H, rng) for part in parts))[:, np.newaxis]
