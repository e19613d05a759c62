"""Describe an axis's unit and present bias in words, for the page and the terminal."""

from fltea.records.plus_minus import plus_minus
from fltea.records.records import AxisEstimate
from fltea.records.sensor_kind import kind_of
from fltea.sinks.changes import MOVES


def bias_words(estimate: AxisEstimate | None, unit: str) -> str:
    """Return the text for an axis's present bias, and for whether the sensor moves; "" if it is unknown."""
    if estimate is None or estimate.bias is None:
        return ""
    moving = f", {MOVES}" if estimate.moving else ""
    return f"bias {plus_minus(estimate.bias, estimate.bias_std)} {unit}{moving}".replace("-", "\u2212")


def unit_of(axis: str) -> str:
    """Return the unit of an axis's samples."""
    return kind_of(axis).text_unit
