"""Overlapping Allan deviation of one axis, and what is read from it: N, B and K.

The deviation σ(τ) and its degrees of freedom are those of allantools (Riley, NIST SP 1065, 2008; Greenhall
and Riley 2004). The coefficients are those of IEEE Std 952, read where the curve has their slope:

    N  angle random walk   σ = N / √τ               slope -1/2, read at τ = 1 s
    B  bias instability    σ = B √(2 ln 2 / π)      slope 0, or the lowest point
    K  rate random walk    σ = K √(τ / 3)           slope +1/2, read at τ = 3 s

A coefficient whose slope the curve does not have is None, with the reason.
"""

import math
from typing import Any

import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray

from fltea.settings.extras import load

Array = NDArray[np.float64]

CONFIDENCE = 0.95
PER_DECADE = 10
"""Averaging times."""
LONGEST_SHARE = 0.25
"""Longest averaging time over the record."""
SHORTEST_RECORD = 100
"""Samples."""
FEWEST_DOF = 6.0
"""Degrees of freedom below which nothing is read from a point: it is uncertain by half its value."""
AROUND = 2.0
"""A local slope is fitted to the points within this factor of τ."""
SPAN = 3.0
"""A stretch has to be at least this long: its last τ over its first."""
TOLERANCE = 0.1
K_TOLERANCE = 0.25
"""Of local slopes; K is read where the curve is uncertain, and the next slopes, 0 and 1, are twice as far."""
FEWEST_AVERAGED = 5
"""Samples, for K: below, the sum of steps is more than 1 % above the line of a continuous random walk."""
FLICKER = math.sqrt(2 * math.log(2) / math.pi)
"""σ / B at the floor, 0.664."""
BLOCK = 1 << 13
"""Samples that are looked at at a time."""
SQRT_HOUR = 60.0
HOUR = 3600.0


class Coefficient(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One of N, B and K: None where the curve does not show it, and `reason` says why.

    low and high are the ends of the 95 % interval of the point that counts most.
    """

    value: float | None
    low: float | None = None
    high: float | None = None
    tau_from_s: float | None = None
    """where it was read"""
    tau_to_s: float | None = None
    reason: str = ""


class Allan(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The curve, and its coefficients."""

    tau_s: tuple[float, ...]
    deviation_dps: tuple[float, ...]
    low_dps: tuple[float, ...]
    """95 % interval"""
    high_dps: tuple[float, ...]
    degrees_of_freedom: tuple[float, ...]
    N_deg_per_sqrt_s: Coefficient
    B_dps: Coefficient
    K_dps_per_sqrt_s: Coefficient

    @property
    def N_deg_per_sqrt_h(self) -> float | None:
        """N in the unit of data sheets."""
        return _times(self.N_deg_per_sqrt_s.value, SQRT_HOUR)

    @property
    def B_deg_per_h(self) -> float | None:
        """B in the unit of data sheets."""
        return _times(self.B_dps.value, HOUR)

    @property
    def K_deg_per_h_per_sqrt_h(self) -> float | None:
        """K in the unit of data sheets."""
        return _times(self.K_dps_per_sqrt_s.value, HOUR * SQRT_HOUR)


def allan(y_dps: ArrayLike, h: float) -> Allan:
    """Allan deviation of one axis (n,) in deg/s without missing samples, at a sampling period of h s.

    Raises:
        ValueError: y is not finite, constant or shorter than SHORTEST_RECORD, or h is not positive.
        UsageError: allantools is not installed.
    """
    y = np.ascontiguousarray(y_dps, dtype=np.float64)
    if y.ndim != 1 or not np.isfinite(y).all():
        raise ValueError("y must be finite numbers, of shape (n,)")
    if not (math.isfinite(h) and h > 0):
        raise ValueError(f"h is a sampling period in s and must be > 0, got {h}")
    if len(y) < SHORTEST_RECORD:
        raise ValueError(f"{len(y)} samples: an Allan deviation needs {SHORTEST_RECORD} or more")
    if np.ptp(y) == 0:
        raise ValueError("the axis is constant: there is no noise to analyse")
    at = _allantools()
    factors = averaging_factors(len(y))
    deviation = overlapping(y, factors)
    tau = np.asarray(factors * h, dtype=np.float64)
    slope = local_slopes(tau, deviation)
    # A power law of τ with slope μ/2 is noise with a spectrum of the power -1 - μ. Noise steeper than white
    # to the blue has more degrees of freedom than white, so white is on the safe side.
    power = np.clip(np.rint(-1 - 2 * slope), -2, 0).astype(int)
    dof = np.array(
        [
            at.edf_greenhall(alpha=int(a), d=2, m=int(m), N=len(y) + 1, overlapping=True)
            for a, m in zip(power, factors, strict=True)
        ]
    )
    bounds = [
        at.confidence_interval(d, edf, CONFIDENCE) for d, edf in zip(deviation.tolist(), dof, strict=True)
    ]
    low, high = np.array(bounds).T
    curve = _Curve(h, tau, deviation, low, high, dof, slope)
    n = _angle_random_walk(curve)
    return Allan(
        tau_s=tuple(tau.tolist()),
        deviation_dps=tuple(deviation.tolist()),
        low_dps=tuple(low.tolist()),
        high_dps=tuple(high.tolist()),
        degrees_of_freedom=tuple(dof.tolist()),
        N_deg_per_sqrt_s=n,
        B_dps=_bias_instability(curve, n.value),
        K_dps_per_sqrt_s=_rate_random_walk(curve),
    )


def averaging_factors(samples: int) -> NDArray[np.int64]:
    """Samples that are averaged for each point of the curve, PER_DECADE a decade."""
    longest = max(int(samples * LONGEST_SHARE), 1)
    count = 1 + math.ceil(PER_DECADE * math.log10(longest))
    return np.unique(np.rint(np.geomspace(1, longest, count)).astype(np.int64))


def overlapping(y: Array, factors: NDArray[np.int64]) -> Array:
    """Overlapping Allan deviation of y (n,) for each factor, in the unit of y: that of allantools' `oadev`.

    Blocks stay in the cache and memory is one array more, also for a day at 100 Hz.
    """
    phase = np.empty(len(y) + 1)
    phase[0] = 0.0
    np.subtract(y, y.mean(), out=phase[1:])
    np.cumsum(phase, out=phase)
    found = np.empty(len(factors))
    for i, m in enumerate(factors.tolist()):
        squares, n = 0.0, len(phase) - 2 * m
        for begin in range(0, n, BLOCK):
            end = min(begin + BLOCK, n)
            steps = phase[begin + 2 * m : end + 2 * m] - 2 * phase[begin + m : end + m] + phase[begin:end]
            squares += float(steps @ steps)
        found[i] = math.sqrt(squares / (2 * n)) / m
    return found


def local_slopes(tau: Array, deviation: Array) -> Array:
    """Slope of log σ against log τ around each point."""
    x, z = np.log(tau), np.log(np.maximum(deviation, np.finfo(np.float64).tiny))
    near = np.abs(x[:, np.newaxis] - x) <= math.log(AROUND) * (1 + 1e-9)
    count = near.sum(axis=1)
    dx = np.where(near, x - (near @ x / count)[:, np.newaxis], 0.0)
    return np.asarray((dx @ z) / (dx**2).sum(axis=1))


class _Curve:
    """Points in use, and where the slope is what."""

    def __init__(
        self, h: float, tau: Array, deviation: Array, low: Array, high: Array, dof: Array, slope: Array
    ) -> None:
        self.h = h
        # The degrees of freedom fall with τ but for the jumps where the kind of noise changes.
        poor = np.flatnonzero(dof < FEWEST_DOF)
        use = slice(0, int(poor[0]) if poor.size else len(tau))
        self.tau, self.deviation = tau[use], deviation[use]
        self.low, self.high = low[use], high[use]
        self.dof, self.slope = dof[use], slope[use]

    def stretch(self, slope: float, tolerance: float, from_s: float = 0.0) -> slice | None:
        """The longest stretch with this slope that is long enough, of those from a τ on."""
        inside = (np.abs(self.slope - slope) <= tolerance) & (self.tau >= from_s * (1 - 1e-9))
        edges = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]])))
        best, longest = None, SPAN
        for start, stop in edges.reshape(-1, 2).tolist():
            if (length := self.tau[stop - 1] / self.tau[start]) >= longest:
                best, longest = slice(start, stop), length
        return best

    def line(self, part: slice, slope: float, at_s: float) -> Coefficient:
        """The line of this slope through a stretch, weighted by degrees of freedom, read at a τ."""
        log_line = np.log(self.deviation[part]) - slope * np.log(self.tau[part] / at_s)
        value = float(np.exp(np.average(log_line, weights=self.dof[part])))
        heaviest = self.point(part.start + int(self.dof[part].argmax()))
        scaled = _divided(heaviest, (heaviest.value or 1.0) / value)
        return msgspec.structs.replace(
            scaled, tau_from_s=float(self.tau[part.start]), tau_to_s=float(self.tau[part.stop - 1])
        )

    def point(self, i: int) -> Coefficient:
        """One point as it is."""
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
        # There are higher flats too: the crest of a slow relaxation.
        if floor.value is not None and floor.value <= c.high[i]:
            return _divided(floor, FLICKER)
    at_most = f"B is at most {c.high[i] / FLICKER * HOUR:.3g} deg/h"
    if i == len(c.tau) - 1:
        return Coefficient(
            None, reason=f"the curve still falls at its end, τ = {tau:.3g} s; {at_most}: record longer"
        )
    if n is None or c.low[i] <= n / math.sqrt(tau):
        return Coefficient(
            None, reason=f"at its lowest, τ = {tau:.3g} s, the curve is still that of white noise; {at_most}"
        )
    return _divided(c.point(i), FLICKER)


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
        c, value=_times(c.value, 1 / by), low=_times(c.low, 1 / by), high=_times(c.high, 1 / by)
    )


def _times(value: float | None, factor: float) -> float | None:
    return None if value is None else value * factor


def _allantools() -> Any:
    """Imported late: it brings all of scipy."""
    return load("allantools", "allantools", "identify", "the Allan deviation needs")
