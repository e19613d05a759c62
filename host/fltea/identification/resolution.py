"""Find the steps to which samples were rounded, and whether the decimals of a file made them."""

import math

import numpy as np

from fltea.records.arrays import Array
from fltea.records.quantity import factor

LONG = 1 << 20
"""Number of samples above which medians and commonest values come from a part, evenly spaced."""
SAME_STEP = 1e-3
"""Largest relative difference from a power of ten at which a step counts as one."""
WRITTEN_IN = {"deg/s": ("deg/s", "rad/s", "deg/h"), "m/s²": ("m/s²", "g")}
"""Units in which files write each of our units.

Milli-units give the same result.
"""


def thin(y: Array) -> Array:
    """Return all samples, or every k-th if there are more than LONG; enough to show what is typical."""
    return y[:: -(-len(y) // LONG)] if len(y) > LONG else y


def step(y: Array) -> float | None:
    """Return the step to which values were rounded, or None if they were not rounded."""
    values = np.unique(thin(y))
    if len(values) < 2:
        return None
    gaps = np.diff(values)
    least = float(gaps[gaps > 1e-9 * np.ptp(values)].min())
    return least if (np.abs(gaps / least - np.rint(gaps / least)) < 0.05).all() else None


def decimals(quantum: float, unit: str) -> str:
    """Return the step as the file writes it, such as "0.01 rad/s", if it is a power of ten there; else "".

    `quantum`: the step in `unit`. No sensor's count is known to be a power of ten, so decimals were cut off.
    """
    for name in WRITTEN_IN.get(unit, ()) or (unit,):
        written = quantum * factor(unit, name) if name != unit else quantum
        power = round(math.log10(written))
        if abs(written / 10.0**power - 1) < SAME_STEP:
            return f"{10.0**power:g} {name}"
    return ""
