"""Compute linear and logarithmic scales of a chart, and the numbers at their ticks."""

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

MOST_TICKS, FEW_DECADES = 8, 2.2
MOST_LINEAR = 6
"""Ticks of a linear scale are so far apart that the scale is at most this many of their distances long."""
MOST_DECIMALS = 5


class Axis(NamedTuple):
    """An axis of a chart.

    `label`: what the axis shows, with the unit. `ends`: lower and upper limit; None: the limits of the
    curves, with some room around them.
    """

    label: str
    is_log: bool = False
    ends: tuple[float, float] | None = None


class Scale(NamedTuple):
    """A scale from `low` to `high`, drawn between two positions in pixels.

    For a logarithmic scale, `low` and `high` are logarithms.
    """

    low: float
    high: float
    begin: float
    end: float
    is_log: bool

    def __call__(self, value: float) -> float:
        """Return the position of a value in pixels."""
        number = math.log10(value) if self.is_log else value
        share = (number - self.low) / (self.high - self.low)
        return self.begin + share * (self.end - self.begin)

    def has(self, value: float) -> bool:
        """Whether the value has a position on the scale, even if that is beyond the ends."""
        return math.isfinite(value) and (value > 0 or not self.is_log)

    def ticks(self) -> list[tuple[float, str]]:
        """Return the values of the ticks, each with its text."""
        return _decades(self.low, self.high) if self.is_log else _steps(self.low, self.high)


def scale(axis: Axis, values: Iterable[float], begin: float, end: float) -> Scale | None:
    """Return the scale of an axis from `begin` to `end` (pixels); None if no value can be shown on it."""
    known = [v for v in values if math.isfinite(v) and (v > 0 or not axis.is_log)]
    if not known:
        return None
    ends = [math.log10(v) if axis.is_log else float(v) for v in axis.ends or (min(known), max(known))]
    low, high = ends if axis.ends and ends[0] < ends[1] else _room(ends, axis.is_log)
    return Scale(low, high, begin, end, axis.is_log)


def _room(ends: Sequence[float], is_log: bool) -> tuple[float, float]:
    """Return the ends with some room around them, even if both ends are equal."""
    low, high = ends
    room = 0.05 * (high - low)
    room = max(room, 0.1) if is_log else room or 0.05 * abs(low) or 0.1
    return low - room, high + room


def _decades(low: float, high: float) -> list[tuple[float, str]]:
    """Return ticks at the decades, and between them if there are few decades."""
    span = high - low
    steps = (1, 2, 3, 5, 7) if span < 1 else (1, 2, 5) if span < FEW_DECADES else (1,)
    powers = range(math.floor(low), math.ceil(high) + 1)
    found = [float(f"{step}e{power}") for power in powers for step in steps]
    shown = [value for value in found if low <= math.log10(value) <= high]
    return [(value, _number(value)) for value in shown[:: max(1, math.ceil(len(shown) / MOST_TICKS))]]


def _steps(low: float, high: float) -> list[tuple[float, str]]:
    """Return ticks at multiples of 1, 2 or 5 times a power of ten."""
    power = math.floor(math.log10((high - low) / MOST_LINEAR))
    step = next(
        one
        for one in (float(f"{m}e{p}") for p in (power, power + 1) for m in (1, 2, 5))
        if (high - low) / one <= MOST_LINEAR
    )
    decimals = max(0, -math.floor(math.log10(step) + 1e-9))
    found = [n * step for n in range(math.ceil(low / step), math.floor(high / step) + 1)]
    if decimals > MOST_DECIMALS:
        return [(value, f"{value:.3g}") for value in found]
    return [(value, f"{value + 0.0:,.{decimals}f}") for value in found]


def _number(value: float) -> str:
    return f"{value:,g}" if 1e-3 <= value <= 1e3 else f"{value:.0e}".replace("e-0", "e-").replace("e+0", "e")
