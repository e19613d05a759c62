"""The figures of an axis, each with its 95 % interval, and by which of them sensors are compared (pure)."""

import math
from typing import NamedTuple

from fltea.fleet.messages import Allan, AxisFit, Interval, Tracker
from fltea.noise.spectra import HIGHEST_ORDER
from fltea.records.plus_minus import NORMAL_95
from fltea.records.units import FLICKER

WITH_ORDER = ("fractional", "fractional or relaxations", "undecided")
"""Verdicts that leave room for an order."""

HIGHEST_FITTED = HIGHEST_ORDER - 1e-3
"""Orders above are at the end of what is fitted."""

ALPHA_KNOWN = 0.05
"""Half the width of its interval, as `live.target` has it."""

MOST_POINTS = 200
"""Of a curve; a daemon sends some forty."""


LINES = {"N": (-0.5, 0.0), "B": (0.0, math.log(FLICKER)), "K": (0.5, -0.5 * math.log(3))}
"""Slope and logarithm of the Allan deviation at 1 s of a unit of each."""


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
SHOWN = (Quantity("bias", "bias now: offset and state of the noise", False, ""), *QUANTITIES)
"""Nobody is judged by the bias: each sensor has an offset of its own, and another one after it was off."""


class Figure(NamedTuple):
    """A value with the ends of its interval."""

    value: float
    low: float
    high: float


class Point(NamedTuple):
    """A point of an Allan deviation."""

    tau_s: float
    adev: float
    low: float
    high: float


def bias_of(tracker: Tracker) -> Figure | None:
    """Return the bias, to be shown."""
    bias, std = tracker.bias, tracker.bias_std
    if bias is None or std is None:
        return None
    return _sound(bias, bias - NORMAL_95 * std, bias + NORMAL_95 * std)


def order_of(fit: AxisFit) -> dict[str, Figure]:
    """α and f as the fit has them, to be shown whether or not they can be compared yet."""
    if fit.verdict not in WITH_ORDER:
        return {}
    found = {"alpha": _figure(fit.alpha), "f": _figure(fit.f)}
    return {name: figure for name, figure in found.items() if figure is not None}


def figures_of(fit: AxisFit, rate_hz: float | None, before: dict[str, Figure]) -> dict[str, Figure]:
    """What sensors are compared by; an Allan deviation does not come with each, so the last one counts."""
    found = {name: before[name] for name in "NBK" if name in before and fit.allan is None}
    if fit.allan is not None:
        found |= _of_allan(fit.allan)
    density = _density(fit, rate_hz)
    if density is not None:
        found["density"] = density
    if "N" in found:
        # Of the same white noise: where its share is not known, neither is what the angle walks by.
        del found["N"]
        if density is not None:
            found["N"] = Figure(*(value / math.sqrt(2) for value in density))
    if fit.verdict in WITH_ORDER:
        found |= _of_order(_figure(fit.alpha), _figure(fit.f))
    return found


def _of_order(alpha: Figure | None, f: Figure | None) -> dict[str, Figure]:
    """α and f, once α is known as well as a daemon aims at.

    Before that the likelihood may have two maxima, and an interval the wrong one alone: in one of a hundred
    fits α is then twenty of its deviations off. An interval that ends where the range of its parameter does
    is cut off there, and its width says too little.
    """
    if alpha is None or alpha.high - alpha.low > 2 * ALPHA_KNOWN:
        return {}
    found = {"alpha": alpha} if alpha.low > 0 and alpha.high < HIGHEST_FITTED else {}
    return found | {"f": f} if f is not None and f.high < 0 else found


def _density(fit: AxisFit, rate_hz: float | None) -> Figure | None:
    """Of white noise, one-sided: √(2 R / rate) of the fit."""
    R = _figure(fit.R)
    if R is None or rate_hz is None or rate_hz <= 0 or R.low <= 0:
        return None
    return _sound(*(math.sqrt(2 * value / rate_hz) for value in R))


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
    """N, B and K with the relative interval of a point of the curve.

    N is a mean that is known about as well as the best known point of its line. B and K are not: the points
    of long averaging times go up and down together. So theirs is of the point next to the line.
    """
    curve = zip(allan.tau_s[:MOST_POINTS], allan.adev, allan.low, allan.high, strict=False)
    points = [Point(*one) for one in curve if min(one) > 0 and max(one) < math.inf]
    log_tau = [math.log(point.tau_s) for point in points]
    log_adev = [math.log(point.adev) for point in points]
    found = {}
    for name, value in (("N", allan.N), ("B", allan.B), ("K", allan.K)):
        if value is None or not points or not 0 < value < math.inf:
            continue
        slope, log_unit = LINES[name]
        here = math.log(value) + log_unit
        log_line = [here + slope * x for x in log_tau]
        away = [abs(y - line) for y, line in zip(log_adev, log_line, strict=True)]
        point = points[away.index(min(away))]
        if name == "N":
            pairs = zip(points, log_line, strict=True)
            on_line = [p for p, line in pairs if math.log(p.low) <= line <= math.log(p.high)]
            point = min(on_line, key=lambda p: p.high / p.low, default=point)
        figure = _sound(value, value * point.low / point.adev, value * point.high / point.adev)
        if figure is not None:
            found[name] = figure
    return found
