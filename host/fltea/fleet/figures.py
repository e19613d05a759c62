"""The noise parameters of an axis with their 95 % intervals, which are compared between sensors."""

import math
from typing import NamedTuple

from fltea.fleet.messages import Allan, AxisFit, Interval, Tracker
from fltea.noise.spectra import HIGHEST_ORDER
from fltea.records.plus_minus import NORMAL_95
from fltea.records.units import FLICKER
from fltea.records.verdict_kinds import WITH_ORDER

HIGHEST_FITTED = HIGHEST_ORDER - 1e-3
"""An α above this limit counts as being at the upper end of the range in which α is fitted."""

ALPHA_KNOWN = 0.05
"""Sensors are compared by α only if α's interval has at most this half-width, which is the default of
`live.target`.
"""

MOST_POINTS = 200
"""Largest number of points of an Allan curve that is read. A daemon sends about forty points."""


LINES = {"N": (-0.5, 0.0), "B": (0.0, math.log(FLICKER)), "K": (0.5, -0.5 * math.log(3))}
"""Straight lines of N, B and K in a log-log Allan plot.

For each: the slope of the line, and the logarithm of the line's Allan deviation at 1 s. The latter is for a
value of 1; for a value v of N, B or K, add log v.
"""


class Quantity(NamedTuple):
    """A noise parameter by which sensors are compared.

    `log`: values are compared by their ratios, not by their differences.
    `unit`: text that is appended to the unit of the axis.
    """

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
"""Quantities that are shown. The bias is shown but not compared, since it differs from sensor to sensor and
changes with each power-up.
"""


class Figure(NamedTuple):
    """A value with the ends of its 95 % interval."""

    value: float
    low: float
    high: float


class Point(NamedTuple):
    """One point of an Allan deviation curve."""

    tau_s: float
    adev: float
    low: float
    high: float


def bias_of(tracker: Tracker) -> Figure | None:
    """Return the bias that the tracker estimates, with its interval; None if the bias is not known."""
    bias, std = tracker.bias, tracker.bias_std
    if bias is None or std is None:
        return None
    return _sound(bias, bias - NORMAL_95 * std, bias + NORMAL_95 * std)


def order_of(fit: AxisFit) -> dict[str, Figure]:
    """Return α and f of a fit for display. Their intervals may be too wide for comparisons."""
    if fit.verdict not in WITH_ORDER:
        return {}
    figures = {"alpha": _figure(fit.alpha), "f": _figure(fit.f)}
    return {name: figure for name, figure in figures.items() if figure is not None}


def figures_of(fit: AxisFit, rate_hz: float | None, before: dict[str, Figure]) -> dict[str, Figure]:
    """Return the parameters of a fit that are compared between sensors.

    `before`: parameters of the previous fit. If the new fit has no Allan deviation, N, B and K are taken from
    `before`.
    """
    figures = {name: before[name] for name in "NBK" if name in before and fit.allan is None}
    if fit.allan is not None:
        figures |= _of_allan(fit.allan)
    density = _density(fit, rate_hz)
    if density is not None:
        figures["density"] = density
    if "N" in figures:
        # N follows from the density of the white noise. If the density is not known, N is not known either.
        del figures["N"]
        if density is not None:
            figures["N"] = Figure(*(value / math.sqrt(2) for value in density))
    if fit.verdict in WITH_ORDER:
        figures |= _of_order(_figure(fit.alpha), _figure(fit.f))
    return figures


def _of_order(alpha: Figure | None, f: Figure | None) -> dict[str, Figure]:
    """Return α and f if α's interval is narrow enough: half-width at most `ALPHA_KNOWN`.

    If the interval is wider, α is known so badly that the likelihood may have two maxima. The interval may
    contain only the wrong maximum: in about one of a hundred such fits, α was wrong by twenty of its standard
    deviations. α or f is also left out if its interval reaches the end of the range in which it is fitted.
    The interval ends there, so it is too narrow.
    """
    if alpha is None or alpha.high - alpha.low > 2 * ALPHA_KNOWN:
        return {}
    known = {"alpha": alpha} if alpha.low > 0 and alpha.high < HIGHEST_FITTED else {}
    return known | {"f": f} if f is not None and f.high < 0 else known


def _density(fit: AxisFit, rate_hz: float | None) -> Figure | None:
    """Return the one-sided density of the white noise, √(2 R / rate), where R is the noise variance."""
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
    """Return N, B and K, each with an interval taken from a point of the Allan curve.

    If the interval of the point is 0.9 to 1.2 of its value, that of the figure is 0.9 to 1.2 of the figure.
    N is an average over all points whose intervals contain the line of N. So it gets the narrowest of these
    intervals. B and K come from long averaging times, where points are correlated and an average is hardly
    more certain than one point. So they get the interval of the point nearest to their line.
    """
    curve = zip(allan.tau_s[:MOST_POINTS], allan.adev, allan.low, allan.high, strict=False)
    points = [Point(*values) for values in curve if min(values) > 0 and max(values) < math.inf]
    log_tau = [math.log(point.tau_s) for point in points]
    log_adev = [math.log(point.adev) for point in points]
    figures = {}
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
            figures[name] = figure
    return figures
