"""The figures of an axis by which sensors are compared, each with its 95 % interval (pure)."""

import math
from typing import NamedTuple

from fltea.fleet.messages import Allan, AxisFit, Interval

WITH_ORDER = ("fractional", "fractional or relaxations", "undecided")
"""Verdicts that leave room for an order."""

FLOOR = math.sqrt(2 * math.log(2) / math.pi)
"""Floor of the Allan deviation over B (IEEE Std 952)."""


class Quantity(NamedTuple):
    """What sensors are compared by. log: by ratios, not by differences. unit: behind the axis's own."""

    name: str
    meaning: str
    log: bool
    unit: str


QUANTITIES = (
    Quantity("N", "angle random walk", True, "·√s"),
    Quantity("B", "bias instability", True, ""),
    Quantity("K", "rate random walk", True, "/√s"),
    Quantity("density", "density of the white noise", True, "/√Hz"),
    Quantity("alpha", "order α", False, ""),
    Quantity("f", "parameter f", False, "s^-α"),
)


class Figure(NamedTuple):
    """A value with the ends of its interval."""

    value: float
    low: float
    high: float


def figures_of(fit: AxisFit, rate_hz: float | None, before: dict[str, Figure]) -> dict[str, Figure]:
    """What a fit says; an Allan deviation does not come with each, so the last one counts."""
    found = {name: before[name] for name in "NBK" if name in before and fit.allan is None}
    if fit.allan is not None:
        found |= _of_allan(fit.allan)
    density = _figure(fit.R)
    if density is not None and rate_hz is not None and rate_hz > 0 and density.low > 0:
        sound = _sound(*(math.sqrt(2 * value / rate_hz) for value in density))
        if sound is not None:
            found["density"] = sound
    if fit.verdict in WITH_ORDER:
        for name, interval in (("alpha", fit.alpha), ("f", fit.f)):
            figure = _figure(interval)
            if figure is not None:
                found[name] = figure
    return found


def _figure(interval: Interval) -> Figure | None:
    value, low, high = interval.value, interval.low, interval.high
    if value is None or low is None or high is None:
        return None
    return _sound(value, low, high)


def _sound(value: float, low: float, high: float) -> Figure | None:
    if not all(map(math.isfinite, (value, low, high))) or not low <= value <= high or low == high:
        return None
    return Figure(value, low, high)


def _of_allan(allan: Allan) -> dict[str, Figure]:
    """N, B and K with the relative interval of the point of the curve that they were read off."""
    points = list(zip(allan.tau_s, allan.adev, allan.low, allan.high, strict=False))
    points = [point for point in points if min(point) > 0 and all(map(math.isfinite, point))]
    found = {}
    for name, value in (("N", allan.N), ("B", allan.B), ("K", allan.K)):
        if value is None or not points or not 0 < value < math.inf:
            continue
        away = [abs(math.log(point[1] / (value * _slope(name, point[0])))) for point in points]
        _, deviation, low, high = points[away.index(min(away))]
        figure = _sound(value, value * low / deviation, value * high / deviation)
        if figure is not None:
            found[name] = figure
    return found


def _slope(name: str, tau_s: float) -> float:
    """The Allan deviation of a unit of N, B or K."""
    return {"N": 1 / math.sqrt(tau_s), "B": FLOOR, "K": math.sqrt(tau_s / 3)}[name]
