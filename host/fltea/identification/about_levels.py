"""Analyse one axis after its motion, and the levels between which it jumps, were taken out.

Some sensors step between a few fixed levels (telegraph noise). These levels are subtracted before the
spectrum is analysed.
"""

from typing import NamedTuple

import msgspec

from fltea.identification.axis import AxisAnalysis, IdentifyOptions, analyse
from fltea.identification.left_out import LeftOut, without
from fltea.identification.load import Series
from fltea.identification.motion import likely_motion
from fltea.identification.telegraph import Telegraph, jump_words, telegraph_words, without_levels
from fltea.identification.values import few_values
from fltea.records.fit import VerdictKind
from fltea.spectrum.questions import Verdict

NO_MEMORY: tuple[VerdictKind, ...] = "white", "undecided", "line", "line or resonance", "resonance"
"""If an axis jumps between levels (telegraph noise) and the rest of its noise has one of these verdicts, the
axis gets the verdict "relaxations" instead.

The spectrum of the jumps is that of a relaxation (a first-order Gauss-Markov process).
"""


class SeriesAnalysis(NamedTuple):
    """The spectral analysis of one axis, and the samples behind it."""

    analysis: AxisAnalysis
    """The analysis of the samples after the levels of the telegraph noise were subtracted."""
    series: Series
    """The samples that were analysed, still with the levels of the telegraph noise."""
    left_out: LeftOut
    telegraph: Telegraph | None


def analyse_series(
    series: Series, h: float, options: IdentifyOptions, left_out: LeftOut | None
) -> SeriesAnalysis:
    """Analyse the spectrum of an axis and decide on its verdict.

    Args:
        series: the samples of the axis.
        h: sampling period [s].
        options: how to identify.
        left_out: steps and motion to leave out. None: the tracker, which finds them, has not run yet; then
            samples that look like motion are left out.

    Raises:
        ValueError: the axis is too short, is constant, or has only a few distinct values.
    """
    rest, telegraph = without_levels(series, h)
    out = likely_motion(rest) if left_out is None else left_out
    whole = without(series, out)
    rest = _analysed_part(rest, whole, telegraph, out)
    try:
        analysis = analyse(rest.y, h, options, rest.gaps)
    except ValueError as error:
        if few := few_values(series.y, series.unit):
            raise ValueError(f"{few.text} {few.remedy}") from error
        if jumps := jump_words(series.y, series.unit):
            raise ValueError(f"{jumps} {error}") from error
        raise
    if telegraph is not None:
        analysis = analysis._replace(verdict=_with_levels(analysis.verdict, telegraph, series.unit))
    return SeriesAnalysis(analysis, whole, out, telegraph)


def samples_analysed(series: Series, h: float, left_out: LeftOut) -> Series:
    """Return the samples without the motion and steps in `left_out`. `h`: sampling period [s]."""
    rest, telegraph = without_levels(series, h)
    return _analysed_part(rest, without(series, left_out), telegraph, left_out)


def _analysed_part(rest: Series, whole: Series, telegraph: Telegraph | None, out: LeftOut) -> Series:
    """Return the samples to analyse, without motion and telegraph levels, and with a break at each step.

    Args:
        rest: all samples, from which the levels were subtracted.
        whole: the samples with their levels, from which the motion was already left out.
        telegraph: the telegraph levels, if there are any.
        out: motion to leave out, and steps of the bias.
    """
    if telegraph is None:
        return whole
    return without(rest, LeftOut((*out.moved, *telegraph.passages), out.steps))


def _with_levels(verdict: Verdict, telegraph: Telegraph, unit: str) -> Verdict:
    """Return the verdict with a description of the telegraph levels that were subtracted from the samples."""
    what = f"{telegraph_words(telegraph, unit)} About the levels: {verdict.what}"
    then = (
        f"In a navigation filter the levels are a Gauss–Markov process of σ {telegraph.sigma:.2g} {unit} and "
        f"correlation time {telegraph.tau_s:.2g} s."
    )
    kind: VerdictKind = "relaxations" if verdict.kind in NO_MEMORY else verdict.kind
    return msgspec.structs.replace(verdict, kind=kind).saying(what=what, next=then)
