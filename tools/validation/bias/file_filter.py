"""Measure how good a plain Kalman filter is that only knows what `fltea identify --gauss-markov` wrote."""

import json
import math
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from fltea.records.arrays import Array
from fltea.records.errors import FlteaError

from tools.validation.bias.headings import REST, TIMES_S, turned
from tools.validation.bias.kalman import Model, Plain
from tools.validation.bias.noises import MODELLED, H, drawn, lanes
from tools.validation.live_way import AXES
from tools.validation.runner import Options, Row, Task
from tools.validation.tables import Table, grouped, number

SECTION = "filter from the file"
WAYS = "with its bias", "run over the recording"
"""The two ways to start the filter: with the bias from the file, or without any bias. In the second way the
filter first runs over the whole recording.
"""
FUTURES, QUICK_FUTURES = 50, 10
UNKNOWN = 10.0
"""Standard deviation of the bias [deg/s] if the file states none."""


def tasks(options: Options) -> list[Task]:
    """Return one task for each noise and each simulated sensor of AXES axes."""
    futures = QUICK_FUTURES if options.quick else FUTURES
    return [
        Task(name, navigate, (noise, first, futures), REST)
        for noise in MODELLED
        if options.wanted(name := f"{SECTION}: {noise}")
        for first in range(0, options.seeds, AXES)
    ]


def navigate(noise: str, first: int, futures: int) -> list[Row]:
    """Identify a simulated recording, and predict headings with the filter from `fltea identify`'s file.

    Return one row for each axis.

    A row's `squares` has an entry for each of WAYS, the ways to start the filter: the mean of (heading error
    / σ)² at each of TIMES_S. The entry is None if the file lacks figures that this way needs.
    """
    axes = lanes(SECTION, noise, range(first, first + AXES))
    y, _ = drawn(axes, REST)
    rows: list[Row] = []
    for place, (axis, entry) in enumerate(zip(axes, identified(y), strict=True)):
        angles = turned(axis, SECTION, noise, first + place, futures)
        found = _by_way(model_of(entry), y[:, place], angles)
        rows.append(
            {
                "section": SECTION,
                "noise": noise,
                "axis": first + place,
                "model": entry["model"],
                "squares": dict(zip(WAYS, found, strict=True)),
            }
        )
    return rows


def _by_way(model: Model | None, y: Array, angles: Array) -> list[list[float] | None]:
    if model is None:
        return [None, None]
    known = None if model.bias_std >= UNKNOWN else squares(Plain(model, H), angles)
    plain = Plain(model._replace(bias=0.0, bias_std=UNKNOWN), H)
    plain.run(y)
    return [known, squares(plain, angles)]


def identified(y: Array) -> list[dict[str, Any]]:
    """Return the entry of each axis in the file that `fltea identify --gauss-markov` writes.

    Raises:
        FlteaError: the program failed.
    """
    with TemporaryDirectory() as folder:
        recording, file = Path(folder, "rest.npy"), Path(folder, "model.json")
        np.save(recording, y)
        command = f"identify {recording} --rate 100 --units deg/s --shuffles 0 --jobs 1 --gauss-markov {file}"
        done = subprocess.run(
            [sys.executable, "-m", "fltea", *command.split()],
            cwd=folder, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False,
        )  # fmt: skip
        if done.returncode:
            raise FlteaError(f"fltea identify --gauss-markov failed: {done.stderr}")
        return list(json.loads(file.read_text())["axes"].values())


def model_of(entry: Mapping[str, Any]) -> Model | None:
    """Return the filter model of an axis in the file; None if the axis has no white noise.

    `entry`: what the file has for the axis. It may have a key `filter`, with the figures and the bias.
    Without this key, `entry` itself has the figures, and there is no bias.
    """
    figures = entry.get("filter", entry)
    N = _value(figures["N"])
    if N is None:
        return None
    states = tuple(
        (_value(one["sigma"]) or 0.0, _value(one["tau_s"]) or 1.0) for one in figures["gauss_markov"]
    )
    bias, std = _value(figures.get("bias")), _value(figures.get("bias_std"))
    return Model(N, _value(figures["K"]) or 0.0, states, bias or 0.0, UNKNOWN if std is None else std)


def _value(figure: Any) -> float | None:
    """Return the value of a figure, which is a number or an object with a value and an interval."""
    value: float | None = figure["value"] if isinstance(figure, dict) else figure
    return value


def squares(plain: Plain, angles: Array) -> list[float]:
    """Return the mean of (heading error / σ)² at each of TIMES_S.

    `angles`: true angles, of shape (futures, times). A future is one simulated continuation of the recording.
    """
    found = []
    for k, t_s in enumerate(TIMES_S):
        angle, std = plain.heading(round(t_s / H))
        found.append(float((((angles[:, k] - angle) / std) ** 2).mean()))
    return found


def tables(rows: Sequence[Row]) -> list[Table]:
    """Return one table for each way to start the filter.

    Each table has the RMS of (heading error / σ) for each noise and time.
    """
    return [_table(rows, way) for way in WAYS]


def _table(rows: Sequence[Row], way: str) -> Table:
    cells = []
    for noise, those in grouped(rows, lambda row: row["noise"]).items():
        known = [found for row in those if (found := row["squares"][way]) is not None]
        means = np.mean(known, axis=0) if known else [math.nan] * len(TIMES_S)
        cells.append((str(noise), str(len(known)), *(number(math.sqrt(mean), ".2f") for mean in means)))
    headings = ("noise", "axes", *(f"{t} s" for t in TIMES_S))
    return Table(f"Filter from the file, {way}: RMS heading error over its σ", headings, cells)
