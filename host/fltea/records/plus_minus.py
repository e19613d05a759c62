"""The only place that writes "±" before a deviation: what stands behind it is half of a 95 % interval.

Fields of records, and parameters, whose names end in `_std` are standard deviations, σ. People read "±" as
"it is within": so wherever text is for people, 1.96 σ stands behind it.
"""

import math

from fltea.records.units import MOST_DEG

NORMAL_95 = 1.96
"""Half of a 95 % interval of a normal variable, in standard deviations; boards have the same."""
LARGE = 1e6
"""From here on, powers of ten: what a diverging filter can give."""
MOST_PLACES = 9


def plus_minus(value: float | None, std: float | None) -> str:
    """Return a value ± half of its 95 % interval, to two digits of that; a dash for none.

    std: the standard deviation of the value; None if it is not known.
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
    """Return within what an angle in deg is, with a probability of 95 %, if it is known at all."""
    return "no heading left" if std > MOST_DEG else within(std, "°")


def within(std: float, unit: str = "") -> str:
    """Return ± half of a 95 % interval, to two digits. unit: what follows it."""
    return f"± {float(f'{NORMAL_95 * std:.2g}'):g}{unit}"


def fixed(value: float, digits: int) -> str:
    """Return a number in fixed point, or with a power of ten if it is large."""
    return f"{value:.{digits}f}" if abs(value) < LARGE else f"{value:.{digits}e}"
