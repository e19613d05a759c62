"""Compare exact fits with Whittle's fits of whole records and with live fits, on the same short series."""

import math

import numpy as np
from fltea.records.arrays import Array
from numpy.typing import NDArray

from tools.validation.evaluate import cases, fits
from tools.validation.evaluate.cases import Case, H
from tools.validation.evaluate.exact_fit import ExactSeries
from tools.validation.runner import Row

SAMPLES = 3_000
"""Number of samples of a series. It is small, because the computing time grows with its square."""
CASES: tuple[Case, ...] = (
    Case(0.4, -1.0, 3.0),
    Case(0.6, -3.0, 0.3),
    Case(0.6, -3.0, 30.0),
    Case(0.8, -1.0, 0.3),
    Case(0.8, -10.0, 3.0),
)
"""Noises of the grid whose α can be estimated from 3,000 samples."""


def judge(case: Case, seeds: int, samples: int = SAMPLES) -> list[Row]:
    """Fit every series three times.

    The first fit uses the exact likelihood, the second Whittle's likelihood of the whole record. The third is
    the live fit: Whittle's likelihood of the sums that the daemon keeps in place of the record.

    A series counts for the errors of α and for the intervals that contain the true α only if both of
    Whittle's fits give an order.
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
    """Return the root mean square of the errors; None if there are no errors."""
    return round(math.sqrt(float(np.mean(error**2))), 6) if len(error) else None


def share(flags: NDArray[np.bool_]) -> float | None:
    """Return the proportion of the elements of `flags` that are true; None if there are no elements."""
    return round(float(np.mean(flags)), 6) if len(flags) else None
