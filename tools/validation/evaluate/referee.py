"""The exact likelihood beside Whittle's, of the whole record and live, on the same short series."""

import math

import msgspec
import numpy as np
from numpy.typing import NDArray

from tools.validation.evaluate import cases, fits
from tools.validation.evaluate.cases import Case, H
from tools.validation.evaluate.exact_fit import ExactSeries
from tools.validation.runner import Row, as_row

Array = NDArray[np.float64]

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


class Referee(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Root mean square errors of α on the series of one noise in which both fits reject white noise."""

    case: Case
    samples: int
    series: int
    exact_rmse: float | None
    whole_rmse: float | None
    live_rmse: float | None
    exact_coverage: float | None
    """of 95 % intervals"""
    whole_coverage: float | None
    live_coverage: float | None


def judge(case: Case, seeds: int, samples: int = SAMPLES) -> list[Row]:
    """Fit every series three times."""
    y, truth = cases.samples(case, seeds, samples), fits.truths(case)
    whole = fits.whole_reading(y, H, truth)
    (live,) = fits.live_readings(y, H, (samples,), truth)
    exact, covered = np.empty(seeds), np.zeros(seeds, dtype=bool)
    for i in range(seeds):
        series = ExactSeries(y[:, i], H)
        covered[i], found = series.covers(truth["alpha"], series.fit())
        exact[i] = found.alpha
    both = whole.rejected & live.rejected
    judged = Referee(
        case,
        samples,
        int(both.sum()),
        *(
            rms(one[both] - truth["alpha"])
            for one in (exact, whole.estimates["alpha"], live.estimates["alpha"])
        ),
        *(share(one[both]) for one in (covered, whole.covered["alpha"], live.covered["alpha"])),
    )
    return [as_row("referee", judged)]


def rms(error: Array) -> float | None:
    """Root mean square; None of nothing."""
    return round(math.sqrt(float(np.mean(error**2))), 6) if len(error) else None


def share(flags: NDArray[np.bool_]) -> float | None:
    """Of those that are set; None of nothing."""
    return round(float(np.mean(flags)), 6) if len(flags) else None
