"""Find the step to which samples were rounded, and whether it comes from the decimals written in a file."""

import math

import numpy as np

from fltea.records.arrays import Array
from fltea.records.quantity import factor

LONG = 1 << 20
"""If there are more samples than this, medians and commonest values are computed from a selection of evenly
spaced samples.
"""
SAME_STEP = 1e-3
"""A step counts as a power of ten if its relative difference from the nearest power of ten is at most this.
"""
WRITTEN_IN = {"deg/s": ("deg/s", "rad/s", "deg/h"), "m/s²": ("m/s²", "g")}
"""For each unit of fltea, the units in which files write the same quantity.

Milli-units are not listed, as they give the same result.
"""


def thin(y: Array) -> Array:
    """Return all samples, or every k-th one if there are more than LONG."""
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
    """Return the rounding step in the file's unit, as "0.01 rad/s", if it is a power of ten; else "".

    `quantum`: the rounding step in `unit`. The counts of no known sensor are a power of ten. So such a
    rounding step means that decimals were cut off.
    """
    for name in WRITTEN_IN.get(unit, ()) or (unit,):
        written = quantum * factor(unit, name) if name != unit else quantum
        power = round(math.log10(written))
        if abs(written / 10.0**power - 1) < SAME_STEP:
            return f"{10.0**power:g} {name}"
    return ""
