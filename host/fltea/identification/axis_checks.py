"""What in an axis that was looked at can mislead."""

from collections.abc import Iterator

import numpy as np

from fltea.identification.axis import AxisResult, Looked
from fltea.identification.data_checks import DataCheck, axis_data_checks
from fltea.identification.gaps import Gaps
from fltea.identification.load import Series
from fltea.identification.telegraph import Telegraph, telegraph_words
from fltea.identification.values import value_data_checks

TELEGRAPH = "telegraph"
"""The kind of data check."""


def checks_of(
    looked: Looked, series: Series, result: AxisResult, telegraph: Telegraph | None
) -> tuple[DataCheck, ...]:
    """Return what in an axis that was looked at can mislead.

    series: what was looked at, with the levels of `telegraph` in it, if there are any.
    """
    y, gaps = looked.y, looked.gaps
    if any(peak.repeats is not None for peak in result.peaks):
        # Glitches of a comb are told as such, and not as outliers too.
        ends = np.cumsum([len(one.y) for one in looked.stretches])
        missing = [one.missing for one in looked.stretches]
        y = np.concatenate([one.y for one in looked.stretches])
        gaps = Gaps(ends[:-1].astype(np.int64), np.array(missing[1:], dtype=np.int64))
    of_samples = axis_data_checks(
        y,
        looked.h,
        series.lsb,
        result.peaks,
        series.unit,
        gaps,
        longer="as long as can be" if result.verdict.has_order else "ten minutes or more",
    )
    values = tuple(value_data_checks(series.y, series.unit))
    if any(data_check.kind == "dead band" for data_check in values):
        # What is outside of the band stands out from the one value inside.
        of_samples = tuple(data_check for data_check in of_samples if data_check.kind != "outliers")
    return (*values, *_steps_between(telegraph, series.unit), *of_samples)


def _steps_between(telegraph: Telegraph | None, unit: str) -> Iterator[DataCheck]:
    """Yield what is told of levels between which an axis steps."""
    if telegraph is None:
        return
    yield DataCheck(
        TELEGRAPH,
        "warning",
        f"{telegraph_words(telegraph, unit)} The spectrum and its figures are of the noise about the levels. "
        f"Bias and heading have the levels in them, as a Gauss–Markov process of σ {telegraph.sigma:.2g} "
        f"{unit} and τ {telegraph.tau_s:.2g} s.",
        "It is a defect of the sensor or its supply, or another signal in this column: try another sensor.",
    )
