"""Format N of the fitted model, and B and K of the noise, in the units of data sheets."""

from fltea.records.fit import FitAllan, Interval
from fltea.records.quantity import coefficient_units, quantity_of

NOT_SEEN = "not known"

NAMES = {
    True: {"N": "angle random walk", "B": "bias instability", "K": "rate random walk"},
    False: {"N": "velocity random walk", "B": "bias instability", "K": "acceleration random walk"},
}
"""Names of the coefficients for a gyroscope (True), and for an accelerometer (False)."""

UNITS = {
    True: {"N": ("(deg/s)/√Hz", "deg/√h"), "B": ("deg/s", "deg/h"), "K": ("(deg/s)/√s", "(deg/h)/√h")},
    False: {"N": ("µg/√Hz", "(m/s)/√h"), "B": ("m/s²", "µg"), "K": ("(m/s²)/√s", "µg/√h")},
}
"""The two units in which each coefficient is shown."""
OF_FIT = {True: coefficient_units("deg/s"), False: coefficient_units("m/s²")}
"""The units that the coefficients have in a fit."""


def density(N: float, gyroscope: bool) -> str:
    """Return N in the unit of a gyroscope's or an accelerometer's data sheet."""
    return f"N = {_in(UNITS[gyroscope]['N'][int(gyroscope)], N, 'N', gyroscope)}"


def coefficients(a: FitAllan, gyroscope: bool) -> list[list[str]]:
    """Return for each coefficient its letter and name, and its value in two units or that it is not known."""
    rows = []
    for letter, value in (("N", a.N), ("B", a.B), ("K", a.K)):
        text = NOT_SEEN
        if value is not None:
            text = " = ".join(_in(unit, value, letter, gyroscope) for unit in UNITS[gyroscope][letter])
        rows.append([f"{letter}, {NAMES[gyroscope][letter]}", text])
    return rows


def _in(unit: str, value: float, letter: str, gyroscope: bool) -> str:
    return str(quantity_of(Interval(value), getattr(OF_FIT[gyroscope], letter)).to(unit))
