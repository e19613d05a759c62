"""A noise parameter of a sensor with its 95 % interval, convertible to the units of data sheets and filters.

This module has the program's only list of these units. They are units of N (white noise, or angle and
velocity random walk), of B (bias instability, and the bias itself), of K (random walk of the bias) and of the
drift rate.
"""

import math
from typing import NamedTuple

import msgspec

from fltea.records.fit import Interval
from fltea.records.units import HOUR, SQRT_HOUR, STANDARD_GRAVITY_MS2

_GYRO = {
    "deg/s": 1.0,
    "mdps": 1e3,
    "rad/s": math.radians(1.0),
    "mrad/s": 1e3 * math.radians(1.0),
    "deg/h": HOUR,
}
_ACCEL = {
    "m/s²": 1.0,
    "g": 1 / STANDARD_GRAVITY_MS2,
    "mg": 1e3 / STANDARD_GRAVITY_MS2,
    "µg": 1e6 / STANDARD_GRAVITY_MS2,
}
"""Factors from m/s² to other units: 1 m/s² has this number of each unit. `_GYRO` has the factors from deg/s.
"""


class CoefficientUnits(NamedTuple):
    """The units of N, B and K."""

    N: str
    B: str
    K: str


class _Kind(NamedTuple):
    """A quantity: its name and its units.

    The number after a unit says how many of this unit equal 1 of the first unit.
    """

    what: str
    units: dict[str, float]


_KINDS = (
    _Kind(
        "N of a gyroscope",
        {
            **{f"{unit}/√Hz": factor for unit, factor in _GYRO.items()},
            "deg/√s": 1.0,
            "deg/√h": SQRT_HOUR,
            "rad/√s": _GYRO["rad/s"],
            "rad/√h": _GYRO["rad/s"] * SQRT_HOUR,
        },
    ),
    _Kind("bias and B of a gyroscope", _GYRO),
    _Kind(
        "K of a gyroscope",
        {
            **{f"{unit}/√s": factor for unit, factor in _GYRO.items()},
            **{f"{unit}/√h": factor * SQRT_HOUR for unit, factor in _GYRO.items()},
            "deg/s²/√Hz": 1.0,
            "rad/s²/√Hz": _GYRO["rad/s"],
        },
    ),
    _Kind(
        "N of an accelerometer",
        {
            **{f"{unit}/√Hz": factor for unit, factor in _ACCEL.items()},
            "m/s/√s": 1.0,
            "m/s/√h": SQRT_HOUR,
        },
    ),
    _Kind("bias and B of an accelerometer", _ACCEL),
    _Kind(
        "K of an accelerometer",
        {
            **{f"{unit}/√s": factor for unit, factor in _ACCEL.items()},
            **{f"{unit}/√h": factor * SQRT_HOUR for unit, factor in _ACCEL.items()},
            "m/s³/√Hz": 1.0,
        },
    ),
    _Kind("drift rate of a gyroscope", {"deg/s/s": 1.0, "deg/h/h": HOUR**2, "rad/s/s": _GYRO["rad/s"]}),
    _Kind("drift rate of an accelerometer", {f"{unit}/s": factor for unit, factor in _ACCEL.items()}),
)

_SIGNS = str.maketrans({"µ": "u", "μ": "u", "²": "2", "³": "3", "°": "deg", **dict.fromkeys(" ^()[]·*")})
_WORDS = (
    *(("sqrt", "√"), ("root", "√"), ("rt", "√"), ("hour", "h"), ("hr", "h"), ("second", "s"), ("sec", "s")),
    *(("degrees", "deg"), ("degree", "deg"), ("radians", "rad"), ("radian", "rad")),
    *(("dps", "deg/s"), ("/s/s", "/s2")),
)


def _plain(unit: str) -> str:
    """Return a unit in the normalised spelling by which units are compared."""
    mega = "M" * unit.startswith("M")  # M is kept, since in lower case it would mean milli in place of mega
    plain = mega + unit[len(mega) :].casefold().translate(_SIGNS)
    for word, meaning in _WORDS:
        plain = plain.replace(word, meaning)
    return plain


_OF_DATA_SHEETS = {"deg/s": CoefficientUnits("deg/√h", "deg/h", "deg/h/√h")}

_FACTORS = [{_plain(unit): factor for unit, factor in kind.units.items()} for kind in _KINDS]


def factor(unit: str, other: str) -> float:
    """Return the factor that converts a value in `unit` to `other`, a unit of the same quantity.

    Upper and lower case (except M, which is mega), blanks and brackets make no difference, and sqrt, root and
    rt mean √: deg/sqrt(h), deg/rt(h), deg/√h.

    Raises:
        ValueError: `unit` is unknown, or `other` is no unit of the same quantity; the text lists the units.
    """
    for kind, factors in zip(_KINDS, _FACTORS, strict=True):
        one = factors.get(_plain(unit))
        if one is None:
            continue
        if (wanted := factors.get(_plain(other))) is None:
            raise ValueError(f"the units of {kind.what} are {', '.join(kind.units)}; got {other!r}")
        return wanted / one
    known = "; ".join(f"of {kind.what} {', '.join(kind.units)}" for kind in _KINDS)
    raise ValueError(f"the units are {known}; got {unit!r}")


def coefficient_units(unit: str) -> CoefficientUnits:
    """Return the units that N, B and K have if they are computed from samples in `unit`."""
    return CoefficientUnits(f"{unit}/√Hz", unit, f"{unit}/√s")


def shown_units(unit: str) -> CoefficientUnits:
    """Return the units in which N, B and K of samples in `unit` are shown.

    For a gyroscope these are the units of data sheets. For another sensor they are those of
    `coefficient_units`.
    """
    return _OF_DATA_SHEETS.get(unit) or coefficient_units(unit)


class Quantity(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A value in `unit`, with the ends of its 95 % interval; `print` shows value, interval and unit."""

    value: float | None
    """The value; None if it is not known."""
    low: float | None
    """Lower end of the interval; None if the data do not determine it."""
    high: float | None
    """Upper end of the interval; None if the data do not determine it."""
    at_most: float | None
    """If the value is not known: its upper bound with 95 % probability; None if there is no bound."""
    unit: str
    """Unit of `value`, `low`, `high` and `at_most`."""

    def to(self, unit: str) -> "Quantity":
        """Return the quantity in another unit, as in `axis.N.to("rad/s/√Hz")`.

        The spelling "sqrt(Hz)" means √Hz.

        Raises:
            ValueError: `unit` is no unit of this quantity; the text lists its units.
        """
        if unit == self.unit:
            return self
        times = factor(self.unit, unit)
        value, low, high, at_most = (
            None if one is None else one * times for one in (self.value, self.low, self.high, self.at_most)
        )
        return Quantity(value, low, high, at_most, unit)

    @property
    def interval(self) -> Interval:
        """Value, low and high, without the unit."""
        return Interval(self.value, self.low, self.high)

    def __str__(self) -> str:
        value, interval = texts(self)
        unit = "" if self.value is None and self.at_most is None else self.unit
        return " ".join(filter(None, (value, unit, interval)))


def quantity_of(interval: Interval, unit: str, at_most: float | None = None) -> Quantity:
    """Make a `Quantity` of a value with its interval and of an upper bound. All are in `unit`."""
    return Quantity(interval.value, interval.low, interval.high, at_most, unit)


def without_unit(one: Quantity) -> str:
    """Return the value with its interval, or the bound, as text without the unit."""
    return " ".join(filter(None, texts(one)))


FEWEST_DIGITS, MOST_DIGITS = 3, 9
POWERS_OF_TEN_FROM = 1e6


def texts(one: Quantity) -> tuple[str, str]:
    """Return the value or its bound as a text without the unit, and the interval in brackets.

    All texts for people write N, B and K by this rule. The text of the interval is empty if neither end is
    known. If only one end is unknown, its place is left blank.
    """
    if one.value is None:
        return ("not known" if one.at_most is None else f"at most {number(one.at_most)}"), ""
    ends = [end for end in (one.low, one.high) if end is not None]
    if not ends:
        return number(one.value), ""
    half = (ends[1] - ends[0]) / 2 if len(ends) > 1 else abs(ends[0] - one.value)
    digits = _digits(one.value, half)
    low, high = ("" if end is None else number(end, digits) for end in (one.low, one.high))
    return number(one.value, digits), f"({f'{low} … {high}'.strip()})"


def number(value: float, digits: int = FEWEST_DIGITS) -> str:
    """Return a value as text with `digits` significant digits, and from a million on with a power of ten."""
    text = f"{value:.{digits}g}"
    return f"{float(text):.0f}" if "e+" in text and abs(value) < POWERS_OF_TEN_FROM else text


def _digits(value: float, half: float) -> int:
    """Return the number of significant digits of `value` for a text.

    The last digit of `value` has the same place as the second digit of `half`, the half-width of the
    interval: for 0.7549 ± 0.0043, the result is 4.
    """
    if value == 0 or half <= 0:
        return FEWEST_DIGITS
    digits = math.floor(math.log10(abs(value))) - math.floor(math.log10(half)) + 2
    return min(max(digits, FEWEST_DIGITS), MOST_DIGITS)
