"""The figures of an axis by which sensors are compared, each with its 95 % interval (pure)."""

import math
from typing import NamedTuple

import numpy as np

from fltea.fleet.messages import Allan, AxisFit, Interval
from fltea.noise.spectra import HIGHEST_ORDER
from fltea.spectrum.allan_coefficients import SPAN, TOLERANCE
from fltea.spectrum.allan_curve import local_slopes

WITH_ORDER = ("fractional", "fractional or relaxations", "undecided")
"""Verdicts that leave room for an order."""

FLOOR = math.sqrt(2 * math.log(2) / math.pi)
"""Floor of the Allan deviation over B (IEEE Std 952)."""

HIGHEST_FITTED = HIGHEST_ORDER - 1e-3
"""Orders above are at the end of what is fitted."""

SAME_N = 0.1
"""As a ratio less one: lines through one stretch differ by less, those through two by more."""

MOST_POINTS = 200
"""Of a curve; a daemon sends some forty."""


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


class Point(NamedTuple):
    """Of an Allan deviation."""

    tau_s: float
    adev: float
    low: float
    high: float


def figures_of(fit: AxisFit, rate_hz: float | None, before: dict[str, Figure]) -> dict[str, Figure]:
    """What a fit says; an Allan deviation does not come with each, so the last one counts."""
    found = {name: before[name] for name in "NBK" if name in before and fit.allan is None}
    if fit.allan is not None:
        found |= _of_allan(fit.allan, filtered=fit.verdict == "low-pass")
    density = _density(fit, rate_hz, found.get("N"))
    if density is not None:
        found["density"] = density
    if fit.verdict in WITH_ORDER:
        # An interval that ends where the parameter's range does is cut off there: its width says too little.
        alpha, f = _figure(fit.alpha), _figure(fit.f)
        if alpha is not None and alpha.low > 0 and alpha.high < HIGHEST_FITTED:
            found["alpha"] = alpha
        if f is not None and f.high < 0:
            found["f"] = f
    return found


def _density(fit: AxisFit, rate_hz: float | None, N: Figure | None) -> Figure | None:
    """Of white noise, one-sided: √(2 R / rate) of the fit.

    Where all of the noise is white the fit has no interval of R, as its state may be white too; but N is
    √(R / rate), and its interval is known.
    """
    if fit.R.low is None:
        return None if N is None else _sound(*(math.sqrt(2) * value for value in N))
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


def _of_allan(allan: Allan, *, filtered: bool) -> dict[str, Figure]:
    """N, B and K with the relative interval of a point of the curve.

    N is a mean that is known about as well as the best known point of its line. B and K are not: the points
    of long averaging times go up and down together. So theirs is of the point next to the line. filtered: N
    was not read off the curve, which is bent.
    """
    curve = zip(allan.tau_s[:MOST_POINTS], allan.adev, allan.low, allan.high, strict=False)
    points = [Point(*one) for one in curve if min(one) > 0 and all(map(math.isfinite, one))]
    found = {}
    for name, value in (("N", allan.N), ("B", allan.B), ("K", allan.K)):
        if value is None or not points or not 0 < value < math.inf:
            continue
        if name == "N" and not filtered and not _is_of_first_stretch(value, points):
            continue
        log_line = [math.log(value) + math.log(_slope(name, point.tau_s)) for point in points]
        away = [abs(math.log(point.adev) - here) for point, here in zip(points, log_line, strict=True)]
        point = points[away.index(min(away))]
        if name == "N":
            pairs = zip(points, log_line, strict=True)
            on_line = [p for p, here in pairs if math.log(p.low) <= here <= math.log(p.high)]
            point = min(on_line, key=lambda p: p.high / p.low, default=point)
        figure = _sound(value, value * point.low / point.adev, value * point.high / point.adev)
        if figure is not None:
            found[name] = figure
    return found


def _is_of_first_stretch(N: float, points: list[Point]) -> bool:
    """Whether N was read off the first stretch of slope -1/2, if there is any.

    A curve may have two of about the same length, with another N each. Chance tells then which of them is the
    longer, so that sensors of one noise would be twice and more apart.
    """
    if points[0].adev * math.sqrt(points[0].tau_s) * (1 + SAME_N) >= N:
        return True  # as nearly all are, and cheaply told
    tau, adev = (np.array(column) for column in list(zip(*points, strict=True))[:2])
    with np.errstate(all="ignore"):  # a point without neighbours has no slope; a stranger's may be any number
        inside = np.abs(local_slopes(tau, adev) + 0.5) <= TOLERANCE
        edges = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]])))
        for start, stop in edges.reshape(-1, 2).tolist():
            if tau[stop - 1] >= SPAN * tau[start]:
                part = slice(start, stop)
                first = np.average(np.log(adev[part]) + np.log(tau[part]) / 2, weights=1 / tau[part])
                return bool(abs(math.log(N) - first) <= SAME_N)
    return True


def _slope(name: str, tau_s: float) -> float:
    """The Allan deviation of a unit of N, B or K."""
    return {"N": 1 / math.sqrt(tau_s), "B": FLOOR, "K": math.sqrt(tau_s / 3)}[name]
