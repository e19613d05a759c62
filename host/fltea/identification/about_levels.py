"""The beginning of a look at an axis: its levels, if it steps between some, and its motion are taken out."""

from typing import NamedTuple

import msgspec

from fltea.identification.axis import IdentifyOptions, Looked, look
from fltea.identification.left_out import LeftOut, without
from fltea.identification.load import Series
from fltea.identification.motion import likely_motion
from fltea.identification.telegraph import Telegraph, jump_words, telegraph_words, without_levels
from fltea.identification.values import few_values
from fltea.records.fit import VerdictKind
from fltea.spectrum.verdict import Verdict

NO_MEMORY: tuple[VerdictKind, ...] = "white", "undecided", "line", "line or resonance", "resonance"
"""Verdicts about which the levels have the say: their spectrum is that of a relaxation."""


class AxisLook(NamedTuple):
    """A look at an axis."""

    looked: Looked
    """Of the samples less their levels."""
    series: Series
    """The same samples with the levels."""
    left_out: LeftOut
    telegraph: Telegraph | None


def look_at(series: Series, h: float, options: IdentifyOptions, left_out: LeftOut | None) -> AxisLook:
    """Look at an axis; h: sampling period in s.

    left_out: steps and motion; None: what seems to be motion before there is a model.

    Raises:
        ValueError: it is too short, constant, or has a few values only.
    """
    rest, telegraph = without_levels(series, h)
    out = likely_motion(rest) if left_out is None else left_out
    whole = without(series, out)
    rest = _looked_at(rest, whole, telegraph, out)
    try:
        looked = look(rest.y, h, options, rest.gaps)
    except ValueError as error:
        if few := few_values(series.y, series.unit):
            raise ValueError(f"{few.text} {few.remedy}") from error
        if jumps := jump_words(series.y, series.unit):
            raise ValueError(f"{jumps} {error}") from error
        raise
    if telegraph is not None:
        looked = looked._replace(verdict=_with_levels(looked.verdict, telegraph, series.unit))
    return AxisLook(looked, whole, out, telegraph)


def samples_looked_at(series: Series, h: float, left_out: LeftOut) -> Series:
    """Return the samples of which a look is that leaves this out; h: sampling period in s."""
    rest, telegraph = without_levels(series, h)
    return _looked_at(rest, without(series, left_out), telegraph, left_out)


def _looked_at(rest: Series, whole: Series, telegraph: Telegraph | None, out: LeftOut) -> Series:
    """Return samples less their levels, if they have some, and less what is left out; whole: with levels."""
    if telegraph is None:
        return whole
    return without(rest, LeftOut((*out.moved, *telegraph.passages), out.steps))


def _with_levels(verdict: Verdict, telegraph: Telegraph, unit: str) -> Verdict:
    """Return the verdict on samples about levels with the levels in it."""
    what = f"{telegraph_words(telegraph, unit)} About the levels: {verdict.what}"
    then = (
        f"In a navigation filter the levels are a Gauss–Markov process of σ {telegraph.sigma:.2g} {unit} and "
        f"correlation time {telegraph.tau_s:.2g} s."
    )
    kind: VerdictKind = "relaxations" if verdict.kind in NO_MEMORY else verdict.kind
    return msgspec.structs.replace(verdict, kind=kind).saying(what=what, next=then)
