"""Read N, B and K of IEEE Std 952 from a curve of Allan deviations σ(τ).

Each coefficient is read where the curve has a slope of its own:

    N  angle random walk   σ = N / √τ               slope -1/2, read at τ = 1 s
    B  bias instability    σ = B √(2 ln 2 / π)      slope 0, or the lowest point
    K  rate random walk    σ = K √(τ / 3)           slope +1/2, read at τ = 3 s

If no stretch of the curve has the slope of a coefficient, the coefficient's value is None, and its reason
says why.
"""

import math
from typing import Literal, NamedTuple

import msgspec
import numpy as np

from fltea.records.arrays import Array
from fltea.records.fit import Interval
from fltea.records.units import FLICKER, HOUR

FEWEST_DOF = 6.0
"""A point of the curve with fewer degrees of freedom than this is not used: its deviation is uncertain by
half its value.
"""
SPAN = 3.0
"""A coefficient is read from a range of points only if the range's last τ is at least this multiple of its
first τ.
"""
TOLERANCE = 0.1
K_TOLERANCE = 0.25
"""K is read where the slope of the curve differs from +1/2 by at most this. N and B have the smaller
TOLERANCE. The curve is uncertain at the long τ where K is read, and no other noise has a slope near +1/2.
"""
FEWEST_AVERAGED = 5
"""K and flat stretches are read only at averaging times τ of at least this many samples. At shorter τ, the
Allan deviation of a sampled random walk exceeds that of a continuous random walk by more than 1 %.
"""


Source = Literal["curve", "spectrum", "model", "tracker"]
"""Source of N, B or K. "curve": read from the Allan deviation. "spectrum": from a fit of white noise, 1/f
noise and a random walk to the spectrum. "model": from the noise model of the verdict. "tracker": from the
filter that tracks the bias and estimates the random walk of its offset.
"""


class Coefficient(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One of the coefficients N, B and K. If it is not known, `value` is None, and `reason` says why.

    `low` and `high` are the ends of the 95 % interval. If the coefficient is read from several points of a
    curve, the interval's relative width is that of the point with the largest weight.
    """

    value: float | None
    low: float | None = None
    high: float | None = None
    tau_from_s: float | None = None
    """The shortest averaging time of the points from which the coefficient was read [s]."""
    tau_to_s: float | None = None
    reason: str = ""
    of: Source = "curve"
    """The source from which the coefficient was read."""
    at_most: float | None = None
    """Upper bound of the coefficient with 95 % probability; None if no bound is known."""

    @property
    def interval(self) -> Interval:
        """Return the value with the ends of its 95 % interval."""
        return Interval(self.value, self.low, self.high)


class Coefficients(NamedTuple):
    """The coefficients N, B and K. For a curve in the unit u, N is in u·√s, B in u and K in u/√s."""

    N: Coefficient
    B: Coefficient
    K: Coefficient


class Points(NamedTuple):
    """The points of an Allan deviation curve, with τ rising."""

    tau_s: Array
    deviation: Array
    low: Array
    """`low` and `high`: ends of the 95 % intervals of the deviations."""
    high: Array
    degrees_of_freedom: Array
    slope: Array
    """Slope of log σ over log τ around each point; σ is the Allan deviation."""


def coefficients(points: Points, h: float, unit: str = "deg/s") -> Coefficients:
    """Read N, B and K from a curve of Allan deviations in `unit`. `h`: sampling period [s]."""
    curve = _Curve(points, h, unit)
    if not len(curve.tau):
        none = Coefficient(None, reason="no point of the curve is known well enough: record longer")
        return Coefficients(none, none, none)
    n = _angle_random_walk(curve)
    return Coefficients(n, _bias_instability(curve, n.value), _rate_random_walk(curve))


def not_known(why: str, at_most: float, unit: str) -> Coefficient:
    """Return a coefficient B whose value is not known.

    `why`: the reason. `at_most`: upper bound of B in the unit of the curve.
    """
    shown = f"{at_most * HOUR:.3g} deg/h" if unit == "deg/s" else f"{at_most:.3g} {unit}"
    return Coefficient(None, reason=f"{why}; B is at most {shown}: record longer", at_most=at_most)


def times(value: float | None, factor: float) -> float | None:
    """Return `value` times `factor`, or None if `value` is None."""
    return None if value is None else value * factor


class _Curve:
    """The points of the curve that are known well enough to be used, with the local slope at each."""

    def __init__(self, points: Points, h: float, unit: str) -> None:
        self.h, self.unit = h, unit
        # The first point with too few degrees of freedom is left out, and all points after it. The degrees of
        # freedom fall as τ rises, except for jumps where the kind of noise changes.
        poor = np.flatnonzero(points.degrees_of_freedom < FEWEST_DOF)
        use = slice(0, int(poor[0]) if poor.size else len(points.tau_s))
        self.tau, self.deviation, self.low, self.high, self.dof, self.slope = (one[use] for one in points)

    def stretch(self, slope: float, tolerance: float, from_s: float = 0.0) -> slice | None:
        """Return the longest range of points whose slope is `slope` within `tolerance`.

        Only averaging times from `from_s` on are used. The result is None if even the longest range is too
        short: its last τ is less than SPAN times its first τ.
        """
        inside = (np.abs(self.slope - slope) <= tolerance) & (self.tau >= from_s * (1 - 1e-9))
        edges = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]])))
        best, longest = None, SPAN
        for start, stop in edges.reshape(-1, 2).tolist():
            if (length := self.tau[stop - 1] / self.tau[start]) >= longest:
                best, longest = slice(start, stop), length
        return best

    def line(self, part: slice, slope: float, at_s: float) -> Coefficient:
        """Return the value at τ = `at_s` of a straight line through the points `part` of the curve.

        The line has the given `slope` in log σ over log τ. Its height is the mean of the points, weighted by
        their degrees of freedom.
        """
        log_line = np.log(self.deviation[part]) - slope * np.log(self.tau[part] / at_s)
        value = float(np.exp(np.average(log_line, weights=self.dof[part])))
        heaviest = self.point(part.start + int(self.dof[part].argmax()))
        scaled = _divided(heaviest, (heaviest.value or 1.0) / value)
        return msgspec.structs.replace(
            scaled, tau_from_s=float(self.tau[part.start]), tau_to_s=float(self.tau[part.stop - 1])
        )

    def point(self, i: int) -> Coefficient:
        """Return the Allan deviation at point `i` of the curve, with its interval and its averaging time."""
        tau = float(self.tau[i])
        return Coefficient(float(self.deviation[i]), float(self.low[i]), float(self.high[i]), tau, tau)


def _angle_random_walk(c: _Curve) -> Coefficient:
    part = c.stretch(-0.5, TOLERANCE)
    if part is None:
        return Coefficient(None, reason="the curve has no stretch of slope -1/2: the noise is nowhere white")
    return c.line(part, -0.5, 1.0)


def _bias_instability(c: _Curve, n: float | None) -> Coefficient:
    i = int(c.deviation.argmin())
    tau = float(c.tau[i])
    flat = c.stretch(0.0, TOLERANCE, FEWEST_AVERAGED * c.h)
    if flat is not None:
        floor = c.line(flat, 0.0, 1.0)
        # A curve can also be flat above its minimum, for example at the crest that a slow relaxation makes.
        # So B is read from a flat stretch only if the stretch contains the curve's lowest point, or lies at
        # most one standard deviation above this point.
        near = c.deviation[i] * (1 + 1 / math.sqrt(2 * c.dof[i]))
        if floor.value is not None and (flat.start <= i < flat.stop or floor.value <= near):
            most = float(c.high[i]) / FLICKER
            return msgspec.structs.replace(_divided(floor, FLICKER), at_most=most)
    most = float(c.high[i]) / FLICKER
    if i == len(c.tau) - 1:
        return not_known(f"the curve still falls at its end, τ = {tau:.3g} s", most, c.unit)
    if n is None or c.low[i] <= n / math.sqrt(tau):
        why = f"at its lowest, τ = {tau:.3g} s, the curve is still that of white noise"
        return not_known(why, most, c.unit)
    return msgspec.structs.replace(_divided(c.point(i), FLICKER), at_most=most)


def _rate_random_walk(c: _Curve) -> Coefficient:
    part = c.stretch(0.5, K_TOLERANCE, FEWEST_AVERAGED * c.h)
    if part is None:
        return Coefficient(
            None,
            reason=f"the curve does not rise with slope +1/2 up to τ = {c.tau[-1]:.3g} s; a rate random walk "
            "shows in records of hours",
        )
    return c.line(part, 0.5, 3.0)


def _divided(c: Coefficient, by: float) -> Coefficient:
    return msgspec.structs.replace(
        c, value=times(c.value, 1 / by), low=times(c.low, 1 / by), high=times(c.high, 1 / by)
    )
