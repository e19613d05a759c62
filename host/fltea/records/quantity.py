"""A figure of a sensor's noise with its 95 % interval, in any unit that data sheets and filters have it in.

This is the one list of these units: N (white noise, or angle and velocity random walk), B (bias instability,
and the bias itself) and K (random walk of the bias).
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
"""How many of each unit one deg/s, or one m/s², is."""


class _Kind(NamedTuple):
    """What is measured, and how many of each of its units are one of the first."""

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
)

_SIGNS = str.maketrans({"µ": "u", "μ": "u", "²": "2", "³": "3", "°": "deg", **dict.fromkeys(" ^()[]·*")})
_WORDS = (("sqrt", "√"), ("rt", "√"), ("hour", "h"), ("hr", "h"), ("dps", "deg/s"), ("/s/s", "/s2"))


def _plain(unit: str) -> str:
    """Return a unit in the one spelling by which units are compared."""
    mega = "M" * unit.startswith("M")  # which is no milli
    found = mega + unit[len(mega) :].casefold().translate(_SIGNS)
    for word, meaning in _WORDS:
        found = found.replace(word, meaning)
    return found


_FACTORS = [{_plain(unit): factor for unit, factor in kind.units.items()} for kind in _KINDS]


def factor(unit: str, other: str) -> float:
    """Return how many of `other` one of `unit` is; both are units of the same thing.

    Capitals (but M, which is mega), blanks and brackets make no difference, and sqrt and rt are √:
    deg/sqrt(h), deg/rt(h), deg/√h.

    Raises:
        ValueError: `unit` is none, or `other` is none of the same thing; the text lists those that are.
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


class Quantity(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A figure in `unit`, with the ends of its 95 % interval; `print` shows all of it."""

    value: float | None
    """None where it is not known."""
    low: float | None
    """Lower end of the interval; None where the data do not tell."""
    high: float | None
    """Upper end of the interval; None where the data do not tell."""
    at_most: float | None
    """Where the value is not known: it is smaller with 95 % probability; None where there is no bound."""
    unit: str
    """The unit of all these."""

    def to(self, unit: str) -> "Quantity":
        """Return the same in another unit: `axis.N.to("rad/s/√Hz")`, or in letters, "rad/s/sqrt(Hz)".

        Raises:
            ValueError: it is no unit of this figure; the text lists those that are.
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
        if self.value is None:
            return "not known" if self.at_most is None else f"at most {_number(self.at_most, 3)} {self.unit}"
        if self.low is None or self.high is None:
            return f"{_number(self.value, 3)} {self.unit}"
        digits = _digits(self.value, (self.high - self.low) / 2)
        value, low, high = (_number(one, digits) for one in (self.value, self.low, self.high))
        return f"{value} {self.unit} ({low} … {high})"


FEWEST_DIGITS, MOST_DIGITS = 3, 9
POWERS_OF_TEN_FROM = 1e6


def _number(value: float, digits: int) -> str:
    """Return a value with so many significant digits, without a power of ten for thousands."""
    text = f"{value:.{digits}g}"
    return f"{float(text):.0f}" if "e+" in text and abs(value) < POWERS_OF_TEN_FROM else text


def _digits(value: float, half: float) -> int:
    """Return how many digits of a value are shown, so that half of its interval has two."""
    if value == 0 or half <= 0:
        return FEWEST_DIGITS
    found = math.floor(math.log10(abs(value))) - math.floor(math.log10(half)) + 2
    return min(max(found, FEWEST_DIGITS), MOST_DIGITS)
