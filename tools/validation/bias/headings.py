"""Measure how often the heading is within the 95 % interval (band) that a recording at rest predicts for it.

For this, each simulated recording is continued many times, each time independently.
"""

import math
from collections.abc import Sequence
from functools import cache

import numpy as np
from fltea.estimator.tracker import Tracker
from fltea.identification.axis import IdentifyOptions, analyse
from fltea.identification.forecast_judge import fitted_system, judged
from fltea.identification.shared_walk import shared_walk
from fltea.noise.heading import ahead, rested
from fltea.noise.linear_system import System
from fltea.records.arrays import Array
from fltea.records.plus_minus import NORMAL_95

from tools.validation.bias.kalman import Model, Plain
from tools.validation.bias.noises import SIGMA, TEN, H, Lane, generator, lanes
from tools.validation.live_way import AXES
from tools.validation.runner import Options, Row, Task
from tools.validation.tables import Table, grouped

SECTION = "headings"
REST = 60_000
"""Number of samples of the recording at rest: ten minutes."""
TIMES_S = (10, 60, 300)
FUTURES, QUICK_FUTURES = 100, 20


def tasks(options: Options) -> list[Task]:
    """Return one task for each noise and each simulated sensor of AXES axes."""
    futures = QUICK_FUTURES if options.quick else FUTURES
    return [
        Task(name, forecast, (noise, first, futures), REST)
        for noise in TEN
        if options.wanted(name := f"{SECTION}: {noise}")
        for first in range(0, options.seeds, AXES)
    ]


def forecast(noise: str, first: int, futures: int) -> list[Row]:
    """Predict the headings of a sensor's axes after a recording at rest.

    Each recording is continued `futures` times at random. Return one row for each axis, with the errors of
    the prediction over all these continuations.
    """
    rows: list[Row] = []
    axes = lanes(SECTION, noise, range(first, first + AXES))
    ys = [axis.take(REST)[0] for axis in axes]
    for number, (axis, y, told) in enumerate(zip(axes, ys, headings_told(ys), strict=True), first):
        seen = turned(axis, SECTION, noise, number, futures)
        best = best_stds(noise)
        rows.append(
            {
                "section": SECTION,
                "noise": noise,
                "axis": number,
                "fails": judge_fails(y),
                "times": [
                    {
                        "t_s": t_s,
                        "inside": float((np.abs(seen[:, k] - mean) <= NORMAL_95 * std).mean()),
                        "square": float(((seen[:, k] - mean) ** 2).mean()),
                        "std": std,
                        "best": best[k] if best else None,
                    }
                    for k, (t_s, (mean, std)) in enumerate(zip(TIMES_S, told, strict=True))
                ],
            }
        )
    return rows


def turned(axis: Lane, section: str, noise: str, number: int, futures: int) -> Array:
    """Return the angles at each of TIMES_S of independent continuations of the recording.

    The array has the shape (futures, times).
    """
    ends = np.array([round(t_s / H) for t_s in TIMES_S])
    rng = generator(f"{section}, futures", noise, number)
    return np.array([H * np.cumsum(axis.fork(rng).take(ends[-1])[0])[ends - 1] for _ in range(futures)])


def headings_told(ys: Sequence[Array]) -> list[list[tuple[float, float]]]:
    """Return each axis's headings after TIMES_S with their σ, as `identify --forecast` predicts them."""
    own = {}
    for number, y in enumerate(ys):
        parts = analyse(y, H, IdentifyOptions(shuffles=0)).figures.model.parts(H)
        own[f"gyro_{number}"] = fitted_system(parts, y, H)
    return [_told(one.system, y) for one, y in zip(shared_walk(own, H).values(), ys, strict=True)]


def _told(system: System, y: Array) -> list[tuple[float, float]]:
    tracker = Tracker([None])
    tracker.set(0, system)
    tracker.run(y[:, np.newaxis])
    (origin, x), P = tracker.x(0), rested(system, len(y))
    at = [ahead(system, H, t_s) for t_s in TIMES_S]
    return [(t_s * origin + float(one.row @ x), one.std(P)) for t_s, one in zip(TIMES_S, at, strict=True)]


def judge_fails(y: Array) -> bool:
    """Return whether a model of the recording's first half predicts the second half badly.

    This is so if the errors of predicted headings or biases do not fit their σ.
    """
    half = y[: len(y) // 2]
    parts = analyse(half, H, IdentifyOptions(shuffles=0)).figures.model.parts(H)
    found = judged(fitted_system(parts, half, H), y, len(half), H)
    return any(one.fails for one in found.heading) or any(one.fails for one in found.bias)


@cache
def best_stds(noise: str) -> tuple[float, ...]:
    """Return the σ of the heading at each of TIMES_S by a Kalman filter that knows the noise.

    The result is empty if no plain Kalman filter is optimal for the noise.
    """
    known = TEN[noise].known
    if known is None:
        return ()
    step, relaxations = known
    best = Plain(Model(SIGMA * math.sqrt(H), step / math.sqrt(H), relaxations, 0.0, 10.0), H)
    best.run(np.zeros(REST))
    return tuple(best.heading(round(t_s / H))[1] for t_s in TIMES_S)


def tables(rows: Sequence[Row]) -> list[Table]:
    """Return a table of how often headings are within their bands (95 % intervals).

    The table also has the bands' widths, divided by the best possible ones (if these are not known, by the
    errors), and the number of axes on which `judge_fails` is true.
    """
    cells = []
    for noise, those in grouped(rows, lambda row: row["noise"]).items():
        by_time = [[row["times"][k] for row in those] for k in range(len(TIMES_S))]
        inside = [f"{100 * np.mean([one['inside'] for one in times]):.0f} %" for times in by_time]
        widths = []
        for times in by_time:
            # The σ of the prediction is divided by the σ that a filter with the true model has. If that is
            # not known, it is divided by the RMS error, which does not show whether the σ could be smaller.
            said = math.sqrt(float(np.mean([one["std"] ** 2 for one in times])))
            seen = math.sqrt(float(np.mean([one["square"] for one in times])))
            best = times[0]["best"]
            widths.append(f"{said / best:.2f}" if best else f"({said / seen:.2f})")
        fails = sum(row["fails"] for row in those)
        cells.append((str(noise), *inside, *widths, f"{fails} of {len(those)}"))
    headings = (
        "noise",
        *(f"inside, {t} s" for t in TIMES_S),
        *(f"width, {t} s" for t in TIMES_S),
        "judge fails",
    )
    title = (
        "Headings in the band of 95 %; its width over the best possible (in brackets: over the error seen)"
    )
    return [Table(title, headings, cells)]
