"""Overlapping Allan deviation with its 95 % intervals, of variances that were summed elsewhere (pure).

Intervals are those of NIST SP 1065 (Riley, 2008), 5.3: chi-squared, with the degrees of freedom of the kind
of noise that the local slope of the curve tells. What is read from it: `allan_coefficients`.
"""

import math
from collections.abc import Callable, Sequence

import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray

from fltea.noise.allan_deviation import model_adev
from fltea.noise.distributions import chi2_quantile
from fltea.records.arrays import Array
from fltea.records.fit import FitAllan, Level
from fltea.spectrum.allan_coefficients import Coefficient, Points, coefficients
from fltea.spectrum.allan_dof import degrees_of_freedom
from fltea.spectrum.bias_instability import bias_instability
from fltea.spectrum.candidate_models import CandidateModels, Sentence

CONFIDENCE = 0.95
SHORTEST_RECORD = 100
"""Samples."""
LONGEST_SHARE = 1 / 3
"""Longest averaging time of the live curve over the record."""
AROUND = 2.0
"""A local slope is fitted to the points within this factor of τ."""


class Allan(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A curve, and what is read from it, in the unit of the samples (deg/s, m/s²)."""

    tau_s: tuple[float, ...]
    deviation: tuple[float, ...]
    low: tuple[float, ...]
    """95 % interval."""
    high: tuple[float, ...]
    degrees_of_freedom: tuple[float, ...]
    differences: tuple[float, ...]
    """The number of differences of neighbouring means that were averaged."""
    N: Coefficient
    """N in the unit per √s, which is the same as the unit over √Hz."""
    B: Coefficient
    K: Coefficient
    """The unit per √s."""
    model: tuple[float, ...] = ()
    """Allan deviation of the model that stands for the noise; empty if there is none beside the curve."""

    @classmethod
    def of(cls, found: Points, differences: ArrayLike, h: float, unit: str) -> "Allan":
        """Return the curve of these points, which were sampled every h s, with N, B and K of the curve alone.

        differences: how many were averaged for each, (k,).
        """
        tau, deviation, low, high, degrees, _ = (tuple(one.tolist()) for one in found)
        count = tuple(np.asarray(differences, dtype=np.float64).tolist())
        return cls(tau, deviation, low, high, degrees, count, *coefficients(found, h, unit))

    def with_model(self, f: CandidateModels, stands: Sentence, level: Level, unit: str) -> "Allan":
        """Return the curve beside the model that stands for the noise: with N and K of that model, and B.

        Short averaging times of the curve are bent where a filter takes power away, and long ones by all else
        there is; the fit of the spectrum knows of both.
        """
        N, K = level.N, level.K
        no_walk = "" if K.value is not None else "no part of the noise is a random walk"
        return msgspec.structs.replace(
            self,
            N=Coefficient(N.value, N.low, N.high, reason=level.reason.replace("unit", unit), of="model"),
            B=bias_instability(self.B, f, stands, unit),
            K=Coefficient(K.value, K.low, K.high, reason=no_walk, of="model"),
            model=_of_model(self.tau_s, stands, f.h),
        )

    @property
    def of_fit(self) -> FitAllan:
        """The curve as the record `fit` has it."""
        tau, deviation, low, high, model = (
            list(one) for one in (self.tau_s, self.deviation, self.low, self.high, self.model)
        )
        return FitAllan(tau, deviation, low, high, model, self.N.value, self.B.value, self.K.value)


def live_allan(
    factors: ArrayLike, avar: ArrayLike, terms: ArrayLike, samples: float, h: float, unit: str = "deg/s"
) -> Allan:
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
    return Allan.of(found, n, h, unit)


def fit_allan(
    sums: tuple[Sequence[float] | Array, ...],
    samples: float,
    h: float,
    unit: str,
    f: CandidateModels,
    noise: Sentence,
    N: float | None,
) -> FitAllan | None:
    """Return the curve as the record `fit` has it, beside that of the model `noise`, which is one of `f`.

    None while there are too few samples or the axis is constant. sums: averaging times in samples, Allan
    variances, terms, as of `live_allan`; of so many samples, with a sampling period of h s. N: of `noise`,
    since the curve is bent by all else there is.
    """
    factors, avar, terms = sums
    try:
        found = live_allan(factors, avar, terms, samples, h, unit)
    except ValueError:
        return None
    return msgspec.structs.replace(
        found,
        N=msgspec.structs.replace(found.N, value=N),
        B=bias_instability(found.B, f, noise, unit),
        model=_of_model(found.tau_s, noise, h),
    ).of_fit


def _of_model(tau_s: Sequence[float], noise: Sentence, h: float) -> tuple[float, ...]:
    found = model_adev(lambda lam: noise.spectrum(lam, h), np.rint(np.array(tau_s) / h))
    return tuple(found.tolist())


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
