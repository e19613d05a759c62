"""The steps in which samples were rounded, and whether a file's decimals made them (pure)."""

import math

import numpy as np

from fltea.records.arrays import Array
from fltea.records.units import STANDARD_GRAVITY_MS2

LONG = 1 << 20
"""Samples from which on medians and commonest values are those of a part, spread evenly."""
SAME_STEP = 1e-3
"""The relative difference up to which a step is taken for a power of ten."""
WRITTEN_IN = {
    "deg/s": {"deg/s": 1.0, "rad/s": math.degrees(1.0), "deg/h": 1 / 3600},
    "m/s²": {"m/s²": 1.0, "g": STANDARD_GRAVITY_MS2},
}
"""For each of our units those that files are in, and what one is in ours; with milli they are the same."""


def thin(y: Array) -> Array:
    """Return all samples, or every k-th of more than LONG, which show well enough what is typical."""
    return y[:: -(-len(y) // LONG)] if len(y) > LONG else y


def step(y: Array) -> float | None:
    """Return the quantum of values that were rounded, or None."""
    values = np.unique(thin(y))
    if len(values) < 2:
        return None
    gaps = np.diff(values)
    least = float(gaps[gaps > 1e-9 * np.ptp(values)].min())
    return least if (np.abs(gaps / least - np.rint(gaps / least)) < 0.05).all() else None


def decimals(quantum: float, unit: str) -> str:
    """Return the step as the file writes it, such as "0.01 rad/s", if it is a power of ten there; else "".

    quantum: in `unit`. No sensor's count is known to be one, so it tells of decimals that were left out.
    """
    for name, size in WRITTEN_IN.get(unit, {unit: 1.0}).items():
        power = round(math.log10(quantum / size))
        if abs(quantum / size / 10.0**power - 1) < SAME_STEP:
            return f"{10.0**power:g} {name}"
    return ""
