"""N of the fitted model, B and K of the noise, in the units of data sheets (pure)."""

from fltea.records.fit import FitAllan
from fltea.records.units import HOUR, SQRT_HOUR, STANDARD_GRAVITY_MS2

NOT_SEEN = "not known"

NAMES = {
    True: {"N": "angle random walk", "B": "bias instability", "K": "rate random walk"},
    False: {"N": "velocity random walk", "B": "bias instability", "K": "acceleration random walk"},
}
"""Of a gyroscope, and of an accelerometer."""

Unit = tuple[float, str]
UNITS: dict[bool, dict[str, tuple[Unit, Unit]]] = {
    True: {
        "N": ((1.0, "(deg/s)/√Hz"), (SQRT_HOUR, "deg/√h")),
        "B": ((1.0, "deg/s"), (HOUR, "deg/h")),
        "K": ((1.0, "(deg/s)/√s"), (HOUR * SQRT_HOUR, "(deg/h)/√h")),
    },
    False: {
        "N": ((1e6 / STANDARD_GRAVITY_MS2, "µg/√Hz"), (SQRT_HOUR, "(m/s)/√h")),
        "B": ((1.0, "m/s²"), (1e6 / STANDARD_GRAVITY_MS2, "µg")),
        "K": ((1.0, "(m/s²)/√s"), (SQRT_HOUR * 1e6 / STANDARD_GRAVITY_MS2, "µg/√h")),
    },
}


def density(N: float, gyroscope: bool) -> str:
    """N as a data sheet of a gyroscope or an accelerometer has it."""
    factor, unit = UNITS[gyroscope]["N"][int(gyroscope)]
    return f"N = {N * factor:.3g} {unit}"


def coefficients(a: FitAllan, gyroscope: bool) -> list[list[str]]:
    """Letter with its name, and the value in two units or that it is not seen."""
    rows = []
    for letter, value in (("N", a.N), ("B", a.B), ("K", a.K)):
        (first, first_unit), (second, second_unit) = UNITS[gyroscope][letter]
        text = NOT_SEEN
        if value is not None:
            text = f"{value * first:.3g} {first_unit} = {value * second:.3g} {second_unit}"
        rows.append([f"{letter}, {NAMES[gyroscope][letter]}", text])
    return rows
