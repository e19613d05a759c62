"""Format N, B and K of an axis's noise in the units of data sheets."""

from fltea.records.fit import FitAllan, Interval
from fltea.records.quantity import coefficient_units, quantity_of

NOT_SEEN = "not known"

NAMES = {
    True: {"N": "angle random walk", "B": "bias instability", "K": "rate random walk"},
    False: {"N": "velocity random walk", "B": "bias instability", "K": "acceleration random walk"},
}
"""Names of the coefficients N, B and K for a gyroscope (True) and for an accelerometer (False)."""

UNITS = {
    True: {"N": ("(deg/s)/√Hz", "deg/√h"), "B": ("deg/s", "deg/h"), "K": ("(deg/s)/√s", "(deg/h)/√h")},
    False: {"N": ("µg/√Hz", "(m/s)/√h"), "B": ("m/s²", "µg"), "K": ("(m/s²)/√s", "µg/√h")},
}
"""The two units in which each coefficient is shown, for a gyroscope (True) and for an accelerometer (False).
"""
OF_FIT = {True: coefficient_units("deg/s"), False: coefficient_units("m/s²")}
"""The units in which a fit gives N, B and K, for a gyroscope (True) and for an accelerometer (False)."""


def density(N: float, gyroscope: bool) -> str:
    """Return N as text in the unit of data sheets of gyroscopes or of accelerometers."""
    return f"N = {_in(UNITS[gyroscope]['N'][int(gyroscope)], N, 'N', gyroscope)}"


def coefficients(a: FitAllan, gyroscope: bool) -> list[list[str]]:
    """Return one row for each of N, B and K.

    A row has the letter with the name, and the value in two units or "not known".
    """
    rows = []
    for letter, value in (("N", a.N), ("B", a.B), ("K", a.K)):
        text = NOT_SEEN
        if value is not None:
            text = " = ".join(_in(unit, value, letter, gyroscope) for unit in UNITS[gyroscope][letter])
        rows.append([f"{letter}, {NAMES[gyroscope][letter]}", text])
    return rows


def _in(unit: str, value: float, letter: str, gyroscope: bool) -> str:
    return str(quantity_of(Interval(value), getattr(OF_FIT[gyroscope], letter)).to(unit))
