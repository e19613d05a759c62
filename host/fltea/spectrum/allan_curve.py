"""Overlapping Allan deviation with its 95 % intervals, of variances that were summed elsewhere (pure).

Intervals are those of NIST SP 1065 (Riley, 2008), 5.3: chi-squared, with the degrees of freedom of the kind
of noise that the local slope of the curve tells. What is read from it: `allan_coefficients`.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fltea.noise.distributions import chi2_quantile
from fltea.records.arrays import Array
from fltea.spectrum.allan_coefficients import Coefficient, Points, coefficients
from fltea.spectrum.allan_dof import degrees_of_freedom

CONFIDENCE = 0.95
SHORTEST_RECORD = 100
"""Samples."""
LONGEST_SHARE = 1 / 3
"""Longest averaging time of the live curve over the record."""
AROUND = 2.0
"""A local slope is fitted to the points within this factor of τ."""


class AllanCurve(NamedTuple):
    """Points of a curve in the unit of the samples, and what is read from it."""

    tau_s: Array
    adev: Array
    low: Array
    """95 % interval."""
    high: Array
    degrees_of_freedom: Array
    factors: Array
    """τ in samples."""
    N: Coefficient
    """N, per √s."""
    B: Coefficient
    K: Coefficient
    """K, per s and √s."""


def live_allan(
    factors: ArrayLike, avar: ArrayLike, terms: ArrayLike, samples: float, h: float, unit: str = "deg/s"
) -> AllanCurve:
    """Return the curve of running sums, as far as a third of the record.

    factors, avar, terms (k,): averaging times in samples, rising; Allan variances in the square of `unit`;
    terms that were averaged (effective number), as `_native.AllanSums` has them. samples: that they are of.
    h in s.

    Raises:
        ValueError: there are fewer than SHORTEST_RECORD samples, the axis is constant, or h is not positive.
    """
    m, variance, n = (np.asarray(one, dtype=np.float64) for one in (factors, avar, terms))
    checked(samples, h)
    use = m <= samples * LONGEST_SHARE
    m, variance, n = m[use], variance[use], n[use]
    if len(m) < 2:
        raise ValueError("no stretch without a break is long enough for an Allan deviation")
    if not variance.all():
        raise ValueError("the axis is constant: there is no noise to analyse")
    found = points(m, np.sqrt(variance), h, lambda power: degrees_of_freedom(power, m, n))
    return AllanCurve(*found[:5], m, *coefficients(found, h, unit))


def checked(samples: float, h: float) -> None:
    """Check that there can be a curve of so many samples.

    Raises:
        ValueError: there are too few, or the sampling period of h s is not positive.
    """
    if not (math.isfinite(h) and h > 0):
        raise ValueError(f"h is a sampling period in s and must be > 0, got {h}")
    if samples < SHORTEST_RECORD:
        raise ValueError(f"{samples:.0f} samples: an Allan deviation needs {SHORTEST_RECORD} or more")


def points(
    factors: ArrayLike, deviation: Array, h: float, dof: Callable[[NDArray[np.int64]], Array]
) -> Points:
    """Return the deviations above 0 at averaging times of so many samples, with 95 % intervals; h in s.

    dof: gives the degrees of freedom of every point by the power of the frequency of its noise, 0 to -2.
    """
    tau = np.asarray(factors, dtype=np.float64) * h
    slope = local_slopes(tau, deviation)
    # A power law of τ with slope μ/2 is noise with a spectrum of the power -1 - μ. Noise steeper than white
    # to the blue has more degrees of freedom than white, so white is on the safe side.
    degrees = dof(np.clip(np.rint(-1 - 2 * slope), -2, 0).astype(np.int64))
    outside = (1 - CONFIDENCE) / 2
    low = deviation * np.sqrt(degrees / chi2_quantile(1 - outside, degrees))
    high = deviation * np.sqrt(degrees / chi2_quantile(outside, degrees))
    return Points(tau, deviation, low, high, degrees, slope)


def local_slopes(tau: Array, deviation: Array) -> Array:
    """Return the slope of log σ against log τ around each point."""
    x, z = np.log(tau), np.log(np.maximum(deviation, np.finfo(np.float64).tiny))
    near = np.abs(x[:, np.newaxis] - x) <= math.log(AROUND) * (1 + 1e-9)
    count = near.sum(axis=1)
    dx = np.where(near, x - (near @ x / count)[:, np.newaxis], 0.0)
    return np.asarray((dx @ z) / (dx**2).sum(axis=1))
