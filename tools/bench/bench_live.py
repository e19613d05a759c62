"""Measures the live fit: the sums that the daemon keeps of the samples, and the fits of these sums.

The replay of an hour with and without the fit is measured by `--chain`.
"""

import statistics
from functools import partial
from typing import Any

import numpy as np
from fltea.estimator.lane_settings import LaneSettings
from fltea.estimator.lanes import Lanes
from fltea.settings.estimator import EstimatorConfig
from fltea.settings.live import LiveConfig
from fltea.spectrum.live_axes import LiveAxes
from fltea.spectrum.octaves import Octaves
from numpy.typing import NDArray

from tools.bench.measured import cpu_seconds, in_turns
from tools.validation.evaluate.cases import Case, H, samples
from tools.validation.tables import Table

Array = NDArray[np.float64]

AXES = ("gyro_x", "gyro_y", "gyro_z")
NOISE = Case(0.8, -1.0, 3.0)
SAMPLES = 60_000
AT_ONCE = {"10 rows a call": 10, "1,000 rows a call": 1_000}
NEXT = 100
"""Number of samples between two fits."""
ROUNDS = 5
GOALS = {"accumulators_ns": 100.0, "fit_ms": 2.0}


def measure() -> dict[str, Any]:
    """Return the processor times of the sums and of the fits, as medians over the rounds.

    `over_filters`: the time of the sums divided by that of the filters in the same round, also as a median.
    """
    y = samples(NOISE, len(AXES), SAMPLES)
    found: dict[str, Any] = {"rounds": ROUNDS, "accumulators": _accumulators(y), "fit": _fits(y)}
    return found | {"not_reached": not_reached(found)}


def not_reached(found: dict[str, Any]) -> list[str]:
    """Return a text for each goal that these figures miss."""
    ns = found["accumulators"]["1,000 rows a call"]["ns"]
    ms = found["fit"]["the next, a second later"]["ms"]
    missed = []
    if ns > GOALS["accumulators_ns"]:
        missed.append(f"{ns:.0f} ns a sample and axis, goal {GOALS['accumulators_ns']:g}")
    if ms > GOALS["fit_ms"]:
        missed.append(f"{ms:.2f} ms a fit and axis, goal {GOALS['fit_ms']:g}")
    return missed


def text(found: dict[str, Any]) -> str:
    """Return the figures as tables for people."""
    sums = [(name, f"{f['ns']:.0f}", f"{f['over_filters']:.2f}") for name, f in found["accumulators"].items()]
    of_fits = [(name, f"{f['ms']:.2f}", f"{f['ms'] / 10:.2f} %") for name, f in found["fit"].items()]
    tables = [
        Table(
            f"Processor time, medians of {ROUNDS} rounds in turns",
            ("accumulators, three axes", "ns a sample and axis", "times the filters"),
            sums,
        ),
        Table(f"A fit after {SAMPLES:,} samples", ("", "ms an axis", "of a core, once a second"), of_fits),
    ]
    missed = found["not_reached"]
    last = "Not reached: " + "; ".join(missed) + "." if missed else "All goals measured here are reached."
    return "\n".join([*(one.markdown() for one in tables), last])


def _accumulators(y: Array) -> dict[str, Any]:
    """Measure the time of the live fit's sums and that of the filters, alternately and on the same blocks."""
    settings = LaneSettings(EstimatorConfig(), H, y[:1000].var(axis=0))
    found = {}
    for name, rows in AT_ONCE.items():
        blocks = [y[begin : begin + rows] for begin in range(0, SAMPLES, rows)]

        def octaves(blocks: list[Array] = blocks) -> None:
            sums = Octaves(len(AXES))
            for block in blocks:
                sums.add(block)

        def filters(blocks: list[Array] = blocks) -> None:
            lanes = Lanes(len(AXES), settings)
            for block in blocks:
                lanes.run(block)

        works = {"octaves": partial(cpu_seconds, octaves), "filters": partial(cpu_seconds, filters)}
        pairs = list(zip(*in_turns(works, ROUNDS).values(), strict=True))
        found[name] = {
            "ns": statistics.median(1e9 * one / y.size for one, _ in pairs),
            "over_filters": statistics.median(one / other for one, other in pairs),
        }
    return found


def _fits(y: Array) -> dict[str, Any]:
    """Measure the time per axis of three fits: the very first, the next, and one with curves.

    The curves are those of spectrum and Allan deviation that the live page shows.
    """
    times: dict[str, list[float]] = {}
    for _ in range(ROUNDS):
        live = LiveAxes(AXES, H, LiveConfig(), "deg/s")
        live.add(y[: -2 * NEXT])
        for name, more, curves in (
            ("the first", y[:0], False),
            ("the next, a second later", y[-2 * NEXT : -NEXT], False),
            ("with curves", y[-NEXT:], True),
        ):
            if len(more):
                live.add(more)
            seconds = cpu_seconds(partial(live.fit, curves=curves))
            times.setdefault(name, []).append(seconds / len(AXES))
    return {name: {"ms": 1e3 * statistics.median(each)} for name, each in times.items()}
