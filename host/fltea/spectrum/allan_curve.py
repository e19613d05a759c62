"""Overlapping Allan deviation with 95 % intervals, computed from Allan variances.

The Allan variances come from sums over the samples, which other code computes. The intervals follow NIST SP
1065 (Riley, 2008), section 5.3: they are those of χ² with the degrees of freedom of one kind of noise. The
local slope of the curve indicates this kind of noise. `allan_coefficients` reads N, B and K from the curve.
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
from fltea.spectrum.candidate_models import CandidateModels, FittedModel

CONFIDENCE = 0.95
SHORTEST_RECORD = 100
"""An Allan deviation is computed only from at least this many samples."""
LONGEST_SHARE = 1 / 3
"""The longest averaging time of a live sensor's curve, divided by the length of the record."""
AROUND = 2.0
"""The local slope at an averaging time τ is fitted to the points from τ / AROUND to τ · AROUND."""


class Allan(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An Allan deviation curve in the unit of the samples (deg/s or m/s²), and N, B and K."""

    tau_s: tuple[float, ...]
    deviation: tuple[float, ...]
    low: tuple[float, ...]
    """`low` and `high`: ends of the 95 % intervals of the deviations."""
    high: tuple[float, ...]
    degrees_of_freedom: tuple[float, ...]
    differences: tuple[float, ...]
    """For each averaging time, the number of differences between neighbouring means that were averaged."""
    N: Coefficient
    """N in the unit of the samples per √Hz, such as (deg/s)/√Hz, which is deg/√s, for samples in deg/s."""
    B: Coefficient
    K: Coefficient
    """K in the unit of the samples divided by √s."""
    model: tuple[float, ...] = ()
    """Allan deviations of the noise model on which the verdict is based; empty if there is no model."""

    @classmethod
    def of(cls, found: Points, differences: ArrayLike, h: float, unit: str) -> "Allan":
        """Return the curve with the points `found`, and with N, B and K read from this curve alone.

        `differences` (k,): for each point, the number of differences between neighbouring means that were
        averaged. `h`: sampling period [s].
        """
        tau, deviation, low, high, degrees, _ = (tuple(one.tolist()) for one in found)
        count = tuple(np.asarray(differences, dtype=np.float64).tolist())
        return cls(tau, deviation, low, high, degrees, count, *coefficients(found, h, unit))

    def with_model(self, f: CandidateModels, stands: FittedModel, level: Level, unit: str) -> "Allan":
        """Return this curve with N, B and K by the noise model `stands`, and with the model's own curve.

        The model gives a better N and K than the curve. At short averaging times, the curve is bent by any
        filter that removes power. At long averaging times, it is bent by all other parts of the noise. The
        model, which is fitted to the spectrum, accounts for both. `level`: N and K of the model.
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
        """Return the curve in the form in which the output record `fit` contains it."""
        tau, deviation, low, high, model = (
            list(one) for one in (self.tau_s, self.deviation, self.low, self.high, self.model)
        )
        return FitAllan(tau, deviation, low, high, model, self.N.value, self.B.value, self.K.value)


def live_allan(
    factors: ArrayLike, avar: ArrayLike, terms: ArrayLike, samples: float, h: float, unit: str = "deg/s"
) -> Allan:
    """Return the curve that running sums give, for averaging times up to a third of the record.

    `factors` (k,): averaging times in samples, rising. `avar` (k,): Allan variances in the square of `unit`.
    `terms` (k,): effective number of differences that each variance averages, as `_native.AllanSums` counts
    them. `samples`: number of samples in the sums. `h`: sampling period [s].

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
    noise: FittedModel,
    N: float | None,
) -> FitAllan | None:
    """Return the curve for the output record `fit`, which also contains the curve of the model `noise`.

    The result is None while there are too few samples or the axis is constant.

    `sums`: averaging times in samples, Allan variances, and numbers of averaged differences, as `live_allan`
    takes them. `samples`: number of samples in these sums. `h`: sampling period [s]. `f`: the candidate
    models, of which `noise` is one. `N`: the angle random walk of `noise`. It replaces the one that is read
    from the curve, since other parts of the noise bend the curve.
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


def _of_model(tau_s: Sequence[float], noise: FittedModel, h: float) -> tuple[float, ...]:
    found = model_adev(lambda lam: noise.spectrum(lam, h), np.rint(np.array(tau_s) / h))
    return tuple(found.tolist())


def checked(samples: float, h: float) -> None:
    """Check that there are enough samples for a curve.

    Raises:
        ValueError: there are too few samples, or the sampling period `h` [s] is not positive.
    """
    if not (math.isfinite(h) and h > 0):
        raise ValueError(f"h is a sampling period in s and must be > 0, got {h}")
    if samples < SHORTEST_RECORD:
        raise ValueError(f"{samples:.0f} samples: an Allan deviation needs {SHORTEST_RECORD} or more")


def points(
    factors: ArrayLike, deviation: Array, h: float, dof: Callable[[NDArray[np.int64]], Array]
) -> Points:
    """Return the points of a curve of Allan deviations above 0, with 95 % intervals.

    `h`: sampling period [s].

    `factors`: averaging times in samples. `dof`: function that returns the degrees of freedom of the Allan
    variance at each point. Its argument says which noise was found at each point: 0 white noise, -1 1/f
    noise, -2 a random walk. (This is the exponent of the noise's power spectrum at the frequencies around
    1/τ.)
    """
    tau = np.asarray(factors, dtype=np.float64) * h
    slope = local_slopes(tau, deviation)
    # If the Allan deviation is ∝ τ^s, the noise's power spectrum is ∝ f^(-1 - 2 s). Noise whose spectrum
    # rises with the frequency f is treated here as white noise. Its Allan variances have more degrees of
    # freedom than those of white noise, so its interval becomes too wide, never too narrow.
    degrees = dof(np.clip(np.rint(-1 - 2 * slope), -2, 0).astype(np.int64))
    outside = (1 - CONFIDENCE) / 2
    low = deviation * np.sqrt(degrees / chi2_quantile(1 - outside, degrees))
    high = deviation * np.sqrt(degrees / chi2_quantile(outside, degrees))
    return Points(tau, deviation, low, high, degrees, slope)


def local_slopes(tau: Array, deviation: Array) -> Array:
    """Return, around each point, the slope of the deviation's logarithm over that of the averaging time τ."""
    x, z = np.log(tau), np.log(np.maximum(deviation, np.finfo(np.float64).tiny))
    near = np.abs(x[:, np.newaxis] - x) <= math.log(AROUND) * (1 + 1e-9)
    count = near.sum(axis=1)
    dx = np.where(near, x - (near @ x / count)[:, np.newaxis], 0.0)
    return np.asarray((dx @ z) / (dx**2).sum(axis=1))
