"""Collect the data checks that need the result of an axis's spectral analysis."""

from collections.abc import Iterator

import numpy as np

from fltea.identification.axis import AxisAnalysis, AxisResult
from fltea.identification.data_checks import DataCheck, axis_data_checks
from fltea.identification.gaps import Gaps
from fltea.identification.load import Series
from fltea.identification.telegraph import Telegraph, telegraph_words
from fltea.identification.values import value_data_checks

TELEGRAPH = "telegraph"
"""The kind of the data check on noise that jumps between levels."""


def checks_of(
    analysis: AxisAnalysis, series: Series, result: AxisResult, telegraph: Telegraph | None
) -> tuple[DataCheck, ...]:
    """Return the data checks of an analysed axis.

    `series`: the samples that were analysed; if the axis has telegraph noise, still with its levels.
    `telegraph`: these levels.
    """
    y, gaps = analysis.y, analysis.gaps
    if any(peak.repeats is not None for peak in result.peaks):
        # Glitches that recur in each period are already reported as a comb of spectral lines. So outliers are
        # searched for in the samples without the glitches.
        ends = np.cumsum([len(one.y) for one in analysis.stretches])
        missing = [one.missing for one in analysis.stretches]
        y = np.concatenate([one.y for one in analysis.stretches])
        gaps = Gaps(ends[:-1].astype(np.int64), np.array(missing[1:], dtype=np.int64))
    of_samples = axis_data_checks(
        y,
        analysis.h,
        series.lsb,
        result.peaks,
        series.unit,
        gaps,
        longer="as long as can be" if result.verdict.has_order else "ten minutes or more",
    )
    values = tuple(value_data_checks(series.y, series.unit))
    if any(data_check.kind == "dead band" for data_check in values):
        # A sensor with a dead band repeats one value while the rate is inside the band. Any sample outside
        # would then seem to be an outlier.
        of_samples = tuple(data_check for data_check in of_samples if data_check.kind != "outliers")
    return (*values, *_steps_between(telegraph, series.unit), *of_samples)


def _steps_between(telegraph: Telegraph | None, unit: str) -> Iterator[DataCheck]:
    """Yield the data check on levels between which an axis steps."""
    if telegraph is None:
        return
    yield DataCheck(
        TELEGRAPH,
        "warning",
        f"{telegraph_words(telegraph, unit)} The spectrum and its figures describe the noise about the "
        f"levels. Bias and heading include the levels, as a Gauss–Markov process of σ {telegraph.sigma:.2g} "
        f"{unit} and τ {telegraph.tau_s:.2g} s.",
        "It is a defect of the sensor or its supply, or another signal in this column: try another sensor.",
    )
