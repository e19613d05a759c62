"""Describe the noise of an axis in one sentence, for the page and for the table in a terminal."""

from fltea.records.estimate import AxisEstimate
from fltea.records.plus_minus import angle_within
from fltea.records.records import AXES, Stats
from fltea.records.units import HEADING_AFTER_S, MOST_DEG
from fltea.sinks.axis_words import bias_words, unit_of
from fltea.sinks.page.answer import Answer, answer, sentence
from fltea.sinks.page.data_sheet import density
from fltea.sinks.page.fits import Curves, Fits


def answer_of(fits: Fits, stats: Stats | None, name: str) -> Answer:
    """Return the description of an axis's newest fit, in words."""
    off, told = stats is not None and stats.fit_period_s is None, fits.time_to_tell.get(name)
    return answer(fits.axes.get(name), told.left_s if told else None, off=off)


def axis_sentence(
    found: Answer, fits: Fits, stats: Stats | None, newest: AxisEstimate | None, name: str
) -> tuple[str, str]:
    """Return one sentence about an axis's noise and bias, as two texts: its first words, and the rest."""
    return sentence(found, _level(fits, stats, name), bias_words(newest, unit_of(name)))


def _level(fits: Fits, stats: Stats | None, name: str) -> str:
    """Return a text with N, if it is known.

    For an axis of a gyroscope, the text also has the error of the heading a minute after a rest.
    """
    allan = fits.curves.get(name, Curves()).allan
    known = density(allan.N, name in AXES) if allan is not None and allan.N is not None else ""
    std = heading(stats, name).get(HEADING_AFTER_S) if name in AXES else None
    ahead = "" if std is None or std > MOST_DEG else f"heading {angle_within(std)} after {HEADING_AFTER_S} s"
    return ", ".join(part for part in (known, ahead) if part)


def heading(stats: Stats | None, axis: str) -> dict[int, float]:
    """Return the standard deviation of the heading's error [deg], by the time since a rest [s].

    The result is empty if no model of the noise is known.
    """
    found = stats.axes.get(axis) if stats else None
    return found.tracker.heading_std if found and found.tracker else {}
