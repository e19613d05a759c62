"""Write a value with "±" and the half-width of its 95 % interval; all texts for people use these functions.

Fields of records, and parameters, whose names end in `_std` are standard deviations, σ. People read "±" as
"the value is within these limits", so the number after "±" is 1.96 σ in all texts for people.
"""

import math

from fltea.records.units import MOST_DEG

NORMAL_95 = 1.96
"""Half-width of a 95 % interval of a normal variable, in standard deviations. The firmware uses the same
number.
"""
LARGE = 1e6
"""Smallest number that is written with a power of ten. A diverging filter can give such numbers."""
MOST_PLACES = 9


def plus_minus(value: float | None, std: float | None) -> str:
    """Return "value ± half-width", with two digits of the half-width of the 95 % interval.

    `value`: the value; None gives a dash.
    `std`: standard deviation of the value; None if it is not known.
    """
    if value is None:
        return "–"
    if std is None or not std > 0:
        return fixed(value, 3) + (" ± 0" if std == 0 else "")
    half = NORMAL_95 * std
    if max(abs(value), half) >= LARGE:
        return f"{fixed(value, 3)} ± {fixed(half, 3)}"
    places = min(max(0, 1 - math.floor(math.log10(half))), MOST_PLACES)
    return f"{fixed(value, places)} ± {fixed(half, places)}"


def angle_within(std: float) -> str:
    """Return "±" with the half-width of an angle's 95 % interval, or say that the heading is unknown.

    `std`: standard deviation of the angle [deg].
    """
    return "no heading left" if std > MOST_DEG else within(std, "°")


def within(std: float, unit: str = "") -> str:
    """Return "±" with the half-width of a 95 % interval, to two digits, followed by `unit`."""
    return f"± {float(f'{NORMAL_95 * std:.2g}'):g}{unit}"


def fixed(value: float, digits: int) -> str:
    """Return a number with `digits` decimal places, such as 0.75, and from `LARGE` on with a power of ten."""
    return f"{value:.{digits}f}" if abs(value) < LARGE else f"{value:.{digits}e}"
