"""The exact likelihood beside Whittle's, of the whole record and live, on the same short series."""

import math

import numpy as np
from fltea.records.arrays import Array
from numpy.typing import NDArray

from tools.validation.evaluate import cases, fits
from tools.validation.evaluate.cases import Case, H
from tools.validation.evaluate.exact_fit import ExactSeries
from tools.validation.runner import Row

SAMPLES = 3_000
"""The cost grows with the square."""
CASES: tuple[Case, ...] = (
    Case(0.4, -1.0, 3.0),
    Case(0.6, -3.0, 0.3),
    Case(0.6, -3.0, 30.0),
    Case(0.8, -1.0, 0.3),
    Case(0.8, -10.0, 3.0),
)
"""Of the grid, where 3,000 samples say something of α."""


def judge(case: Case, seeds: int, samples: int = SAMPLES) -> list[Row]:
    """Fit every series three times.

    Errors of α and shares of its intervals that hold it are of series of which both publish an order.
    """
    y, truth = cases.samples(case, seeds, samples), fits.truths(case)
    whole = fits.whole_reading(y, H, truth)
    (live,) = fits.live_readings(y, H, (samples,), truth)
    exact, covered = np.empty(seeds), np.zeros(seeds, dtype=bool)
    for i in range(seeds):
        series = ExactSeries(y[:, i], H)
        covered[i], found = series.covers(truth["alpha"], series.fit())
        exact[i] = found.alpha
    both = whole.published & live.published
    row = {"kind": "referee", **case.columns, "samples": samples, "series": int(both.sum())}
    for name, alpha, holds in (
        ("exact", exact, covered),
        ("whole", whole.estimates["alpha"], whole.covered["alpha"]),
        ("live", live.estimates["alpha"], live.covered["alpha"]),
    ):
        row |= {f"{name}_rmse": rms(alpha[both] - truth["alpha"]), f"{name}_coverage": share(holds[both])}
    return [row]


def rms(error: Array) -> float | None:
    """Root mean square; None of nothing."""
    return round(math.sqrt(float(np.mean(error**2))), 6) if len(error) else None


def share(flags: NDArray[np.bool_]) -> float | None:
    """Of those that are set; None of nothing."""
    return round(float(np.mean(flags)), 6) if len(flags) else None
