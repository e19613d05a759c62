"""Measure how much a turn of the sensor disturbs the estimated bias.

The sensor turns about z. The axes x and y measure a small proportion of the rate about z.
"""

import math
from collections.abc import Sequence
from typing import Any

import fltea
import numpy as np
from fltea.records.arrays import Array

from tools.validation.bias.noises import H, drawn, lanes
from tools.validation.bias.peers import PEERS
from tools.validation.bias.steps import settled_s
from tools.validation.live_way import AXES, GROWTH, LiveSensor
from tools.validation.runner import Options, Row, Task
from tools.validation.tables import Table, grouped, number

SECTION = "motion"
REST_S, TURN_S, AFTER_S = 120, 30, 60
RATE, LEAK = 10.0, 0.005
"""RATE: rate about z [deg/s]. LEAK: the proportion of this rate that x and y measure."""
WAYS = "live stage", "Live.add(at_rest=False)"
"""The two ways to track the bias: as `fltea run` does, or by the class `fltea.Live`. The first gets only the
rates, so it has to notice the turn itself. The second is told when the sensor is not at rest.
"""


def tasks(options: Options) -> list[Task]:
    """Return a task for each sensor."""
    return [
        Task(name, turned, (way, first), 21_000)
        for way in WAYS
        if options.wanted(name := f"{SECTION}: {way}")
        for first in range(0, options.seeds, AXES)
    ]


def turned(way: str, first: int) -> list[Row]:
    """Simulate the turn of one sensor; return one row for each axis."""
    begin, end = round(REST_S / H), round((REST_S + TURN_S) / H)
    n = end + round(AFTER_S / H)
    axes = lanes(SECTION, "white", range(first, first + AXES))
    y, x = drawn(axes, n)
    y[begin:end] += np.array([LEAK * RATE, LEAK * RATE, RATE])
    bias, std = _told(y, begin, end) if way == WAYS[1] else LiveSensor(AXES, H).run(y)[:2]
    e = np.abs(bias - x)
    peers = {peer: np.abs(of(y) - x) for peer, of in PEERS.items()} if way == WAYS[0] else {}
    return [
        {
            "section": SECTION,
            "way": way,
            "axis": "z" if axis == 2 else "x, y",
            "during": float((e / std)[begin:end, axis].max()),
            "after": float((e / std)[end:, axis].max()),
            "within_s": settled_s((e <= 2 * std)[end:, axis]),
            "turn": float(H * (y - bias)[begin:end, axis].sum()),
            "errors": {
                peer: [float(off[begin:end, axis].max()), float(off[end:, axis].max())]
                for peer, off in ({"fltea": e} | peers).items()
            },
        }
        for axis in range(AXES)
    ]


def _told(y: Array, begin: int, end: int) -> tuple[Array, Array]:
    """Return bias and σ of `fltea.Live`, which is told when the sensor turns and makes fits only at rest."""
    live = fltea.Live(round(1 / H), unit="deg/s")
    found, at, due = [], 0, round(1 / H)
    while at < len(y):
        until = min(next(limit for limit in (begin, end, len(y)) if limit > at), due)
        found.append(live.add(y[at:until], at_rest=not begin <= at < end))
        at = until
        if at == due:
            if not begin <= at <= end:
                live.fit(curves=False)
            due = at + max(round(1 / H), at // GROWTH)
    return np.concatenate([one.bias for one in found]), np.concatenate([one.bias_std for one in found])


def tables(rows: Sequence[Row]) -> list[Table]:
    """Return two tables.

    The first has fltea's largest errors divided by their σ, and the time until the error is within 2 σ again.
    The second has the largest errors of fltea and of other methods (peers) in deg/s.
    """
    cells: list[Any] = []
    errors: list[Any] = []
    for (way, axis), those in grouped(rows, lambda row: (row["way"], row["axis"])).items():
        times = [math.inf if row["within_s"] is None else row["within_s"] for row in those]
        never = f"> {AFTER_S}"
        cells.append(
            (
                f"{way}, {axis}",
                str(len(those)),
                *(f"{max(row[when] for row in those):.3g}" for when in ("during", "after")),
                *(f"{t:.1f}" if math.isfinite(t) else never for t in (_median(times), max(times))),
                number(float(np.mean([row["turn"] for row in those])), ".1f"),
            )
        )
        for peer in those[0]["errors"]:
            largest = np.max([row["errors"][peer] for row in those], axis=0)
            errors.append((f"{way}, {axis}", str(peer), *(f"{one:.4f}" for one in largest)))
    return [
        Table(
            f"Turn of {RATE:g} deg/s for {TURN_S} s about z: error over its σ, seconds to 2 σ, angle seen",
            ("way, axis", "axes", "during", "after", "median s", "worst s", "angle"),
            cells,
        ),
        Table("Largest error, deg/s", ("way, axis", "who", "during", "after"), errors),
    ]


def _median(times: Sequence[float]) -> float:
    return float(np.quantile(times, 0.5, method="higher"))
