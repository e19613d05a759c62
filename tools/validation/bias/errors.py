"""Measure the error of the estimated bias.

The error is the difference between the estimated bias and the true mean rate of the next second. The program
also measures how often the error is within 2 σ.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from fltea.records.arrays import Array

from tools.validation.bias.noises import NOISES, H, drawn, lanes, mean_ahead
from tools.validation.bias.peers import PEERS
from tools.validation.live_way import AXES, live_way, sensors
from tools.validation.runner import Options, Row, Task
from tools.validation.tables import Table, grouped

SECTION = "errors"
AHEAD_S = 1.0
SPANS = {"10–60 s": (1_000, 6_000), "60–300 s": (6_000, 30_000)}


def tasks(options: Options) -> list[Task]:
    """Return one task for each noise and each simulated sensor of AXES axes."""
    return [
        Task(name, of_noise, (noise, first), 30_000)
        for noise in NOISES
        if options.wanted(name := f"{SECTION}: {noise}")
        for first in range(0, options.seeds, AXES)
    ]


def of_noise(noise: str, first: int) -> list[Row]:
    """Track the bias of one simulated sensor.

    Return one row for each span of time in SPANS, with the mean squares of the errors in this span.
    """
    n = max(end for _, end in SPANS.values())
    ahead = round(AHEAD_S / H)
    axes = lanes(SECTION, noise, range(first, first + AXES))
    y, x = drawn(axes, n + ahead)
    y, truth = y[:n], mean_ahead(x, ahead)
    live = live_way(y, H)
    found = {"fltea": live.bias}
    for peer, of in PEERS.items():
        found[peer] = np.concatenate([of(part) for part in sensors(y)], axis=1)
    return [
        {
            "section": SECTION,
            "noise": noise,
            "span": span,
            "axes": AXES,
            "squares": {peer: _mean_square((bias - truth)[begin:end]) for peer, bias in found.items()},
            "within": float((np.abs(live.bias - truth) <= 2 * live.bias_std)[begin:end].mean()),
        }
        for span, (begin, end) in SPANS.items()
    ]


def _mean_square(e: Array) -> float:
    return float((e**2).mean())


def tables(rows: Sequence[Row]) -> list[Table]:
    """Return two tables.

    The first has fltea's RMS errors, divided by those of the best other method (peer), and how often fltea's
    errors are within 2 σ. The second, which is only written to the file, has the RMS errors of all methods.
    """
    cells: list[Any] = []
    errors: list[Any] = []
    for noise, those in grouped(rows, lambda row: row["noise"]).items():
        ratios, shares, best = [], [], []
        for span, records in grouped(those, lambda row: row["span"]).items():
            rms = {
                peer: math.sqrt(float(np.mean([row["squares"][peer] for row in records])))
                for peer in records[0]["squares"]
            }
            own = rms["fltea"]
            peer = min(PEERS, key=lambda one: rms[one])
            ratios.append(f"{own / rms[peer]:.2f}")
            best.append(peer)
            shares.append(f"{100 * float(np.mean([row['within'] for row in records])):.0f} %")
            axes = sum(row["axes"] for row in records)
            errors.append((str(noise), str(span), str(axes), *(f"{one:.4f}" for one in rms.values())))
        cells.append((str(noise), *ratios, ", ".join(dict.fromkeys(best)), *shares))
    headings = (
        "noise",
        *(f"error, {span}" for span in SPANS),
        "best peer",
        *(f"within 2 σ, {span}" for span in SPANS),
    )
    title = "Bias of the next second: RMS error over that of the best peer"
    columns = ("noise", "span", "axes", *rows[0]["squares"])
    return [
        Table(title, headings, cells),
        Table("RMS error of the bias of the next second, deg/s", columns, errors, brief=False),
    ]
