"""Measure how long it takes to know a bias again after it has stepped, in white noise."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from fltea.records.arrays import Array, Mask

from tools.validation.bias.noises import SIGMA, H, drawn, generator, lanes
from tools.validation.bias.peers import PEERS
from tools.validation.live_way import AXES, LiveSensor
from tools.validation.runner import Options, Row, Task
from tools.validation.tables import Table, grouped

SECTION = "steps"
SIZES, AT_S = (1.0, 0.3), (120, 3600)
"""SIZES: sizes of the steps [standard deviations of the noise in one sample]. AT_S: times of the steps,
counted from the first sample [s].
"""
WATCHED_S, QUICK_WATCHED_S = 1200, 300
WITHIN, STAYS_S = 0.2, 2.0
"""The bias counts as known again when its error stays below WITHIN times the size of the step for STAYS_S
seconds. STAYS_S is needed because a mean of few samples may come near the true bias by chance, but does not
stay there.
"""
SAMPLES_TO_SEE = 30
"""A test that raises one false alarm a week needs, on average, at least this number times (σ/δ)² samples to
find a step of the size δ, where σ is the standard deviation of the noise (Lorden, 1971).
"""


def tasks(options: Options) -> list[Task]:
    """Return one task for each step and each simulated sensor of AXES axes."""
    watched_s = QUICK_WATCHED_S if options.quick else WATCHED_S
    return [
        Task(name, stepped, (size, at_s, first, watched_s), (at_s + watched_s) * 100)
        for at_s in AT_S
        for size in SIZES
        if options.wanted(name := f"{SECTION}: {size:g} σ at {at_s} s")
        for first in range(0, options.seeds, AXES)
    ]


def stepped(size: float, at_s: int, first: int, watched_s: int) -> list[Row]:
    """Let the bias of each axis of a sensor step.

    Return one row for each axis, with the time [s] after which each estimate knows the bias again.
    """
    name = f"{size:g} σ at {at_s} s"
    n, at = round((at_s + watched_s) / H), round(at_s / H)
    axes = lanes(SECTION, "white", range(first, first + AXES))
    y, x = drawn(axes, n)
    step = size * SIGMA * generator(SECTION, name, first).choice([-1.0, 1.0], AXES)
    y[at:] += step
    sensor = LiveSensor(AXES, H)
    sensor.run(y[:at])
    found = {"fltea": sensor.run(y[at:]).bias} | {peer: of(y)[at:] for peer, of in PEERS.items()}
    off = {peer: np.abs(bias - x[at:] - step) <= WITHIN * np.abs(step) for peer, bias in found.items()}
    return [
        {
            "section": SECTION,
            "step": name,
            "bound_s": SAMPLES_TO_SEE * H / size**2,
            "axis": first + axis,
            "watched_s": watched_s,
            "times_s": {peer: settled_s(near[:, axis]) for peer, near in off.items()},
        }
        for axis in range(AXES)
    ]


def settled_s(near: Mask) -> float | None:
    """Return the time after which an estimate stays near the true value for STAYS_S [s].

    None if the estimate never stays near it.
    """
    n = round(STAYS_S / H)
    far = np.append(0, np.cumsum(~near))
    stays = np.flatnonzero(far[n:] == far[:-n])
    return float(stays[0] * H) if len(stays) else None


def tables(rows: Sequence[Row]) -> list[Table]:
    """Return a table with the median and the longest time that each estimate needs after a step."""
    cells = []
    for name, those in grouped(rows, lambda row: row["step"]).items():
        first = those[0]
        cells.append(
            (
                str(name),
                str(len(those)),
                f"{first['bound_s']:.1f}",
                *(_times([row["times_s"][peer] for row in those], first) for peer in first["times_s"]),
            )
        )
    headings = ("step", "axes", "bound", *(rows[0]["times_s"]))
    return [Table("Seconds until 20 % of a step are left: median, worst", headings, cells)]


def _times(times: Sequence[float | None], first: Any) -> str:
    never = f"> {first['watched_s']}"
    known: Array = np.array([math.inf if t is None else t for t in times])
    middle, worst = np.quantile(known, [0.5, 1.0], method="higher")
    return ", ".join(f"{t:.1f}" if math.isfinite(t) else never for t in (middle, worst))
