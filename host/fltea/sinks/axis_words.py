"""Describe an axis's unit and present bias in words, for the page and the terminal."""

from fltea.records.estimate import AxisEstimate
from fltea.records.plus_minus import plus_minus
from fltea.records.sensor_kind import kind_of
from fltea.sinks.changes import MOVES


def bias_words(estimate: AxisEstimate | None, unit: str) -> str:
    """Return an axis's present bias as text, with a note if the sensor moves; "" if there is no bias."""
    if estimate is None or estimate.bias is None:
        return ""
    moving = f", {MOVES}" if estimate.moving else ""
    return f"bias {plus_minus(estimate.bias, estimate.bias_std)} {unit}{moving}".replace("-", "\u2212")


def unit_of(axis: str) -> str:
    """Return the unit of an axis's samples."""
    return kind_of(axis).text_unit
