"""Check whether the model reproduces the sensor: compare Allan deviations of the model and of the data.

The model's Allan deviation, and its spread for records of the same length, follow from the model's spectrum.
Nothing is simulated.
"""

import math

import msgspec
import numpy as np
from numpy.typing import NDArray

from fltea.identification.noise_model import AxisModel, Lorentzian, check_possible, model_spectrum
from fltea.noise.allan_deviation import model_adev
from fltea.noise.allan_spread import Line, allan_degrees
from fltea.noise.distributions import chi2_log_std, chi2_quantile
from fltea.records.arrays import Array
from fltea.spectrum.allan_curve import Allan

CLOSE = 0.1
"""A relative error of the model's Allan deviation up to this is always accepted.

The model's parameters are not known any better than this.
"""
SPREADS = 4.0
"""The ratio of the model's Allan deviation to that of the data varies over records of the model's noise. The
model is accepted at an averaging time if the median ratio is off from 1 by at most this many of its standard
deviations. The number is large, since about forty points are compared.
"""
NARROW = 0.2
"""A resonance whose width is less than this fraction of its frequency rings for long, so it counts as a
spectral line.
"""


class Reproduction(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Ratio of the model's Allan deviation to the Allan deviation of the data, at each averaging time.

    `from_s`, `to_s`: the longest range over which the model reproduces the sensor; None if there is none.
    """

    tau_s: tuple[float, ...]
    ratio: tuple[float, ...]
    """The Allan deviation of a record of the model's noise, divided by that of the data: median over records.

    These records are as long as the data.
    """
    low: tuple[float, ...]
    """The Allan deviation of a record of the model's noise, divided by that of the data: 5 % quantile over
    records.
    """
    high: tuple[float, ...]
    """The Allan deviation of a record of the model's noise, divided by that of the data: 95 % quantile over
    records.
    """
    within: tuple[bool, ...]
    """Whether the model is accepted. It is if `ratio` is off from 1 by at most 10 %, or by at most four times
    the standard deviation that this ratio has over records of the model's noise.
    """
    from_s: float | None
    to_s: float | None
    text: str


def reproduction(curve: Allan, h: float, model: AxisModel) -> Reproduction:
    """Compare the Allan deviation of an axis with that of its model's noise. `h`: sampling period [s].

    Raises:
        ValueError: the model has no finite variance, or the axis is constant.
    """
    check_comparable(curve, h, model)
    tau, data = np.array(curve.tau_s), np.array(curve.deviation)
    factors, terms = np.rint(tau / h), np.array(curve.differences)
    deviation, degrees = expected(model, h, factors, terms)
    low, middle, high = (
        np.sqrt(chi2_quantile(p, degrees) / degrees) * deviation / data for p in (0.05, 0.5, 0.95)
    )
    # The square of the Allan deviation is chi-squared distributed, and `chi2_log_std` is the standard
    # deviation of its logarithm. The logarithm of the deviation itself is half of that logarithm.
    spread = chi2_log_std(degrees) / 2
    within = np.abs(np.log(middle)) <= np.maximum(math.log1p(CLOSE), SPREADS * spread)
    longest = _longest(within)
    from_s, to_s = (None, None) if longest is None else (float(tau[longest[0]]), float(tau[longest[1]]))
    return Reproduction(
        curve.tau_s,
        tuple(middle.tolist()),
        tuple(low.tolist()),
        tuple(high.tolist()),
        tuple(within.tolist()),
        from_s,
        to_s,
        _text(tau, middle, within, longest),
    )


def check_comparable(curve: Allan, h: float, model: AxisModel) -> None:
    """Raise ValueError if the model has no finite variance, or the axis is constant."""
    check_possible(model, h)
    if not all(curve.deviation):
        raise ValueError("the axis is constant: there is nothing to compare with")


def expected(model: AxisModel, h: float, factors: Array, terms: Array) -> tuple[Array, Array]:
    """Return the model's Allan deviation and its degrees of freedom, each (k,).

    Args:
        model: the noise model.
        h: sampling period [s].
        factors: averaging times in samples, (k,).
        terms: for each averaging time, the number of differences of neighbouring means that the Allan
            deviation of the record averages, (k,).
    """
    narrow = tuple(one for one in model.resonances if one.width_hz < NARROW * one.frequency_hz)
    wide = tuple(one for one in model.resonances if one not in narrow)
    rest = msgspec.structs.replace(model, resonances=wide)
    lines = [_line(one, h) for one in narrow]
    around = [(one.lam, one.half) for one in lines]
    deviation = model_adev(lambda lam: model_spectrum(model, lam, h), factors, around)
    degrees = allan_degrees(lambda lam: model_spectrum(rest, lam, h), factors, deviation**2, terms, lines)
    return deviation, degrees


def _line(one: Lorentzian, h: float) -> Line:
    return Line(2 * np.pi * one.frequency_hz * h, np.pi * one.width_hz * h, one.variance)


def _longest(within: NDArray[np.bool_]) -> tuple[int, int] | None:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], within, [False]]))).reshape(-1, 2)
    if not len(edges):
        return None
    start, stop = edges[(edges[:, 1] - edges[:, 0]).argmax()].tolist()
    return start, stop - 1


def _text(tau: Array, ratio: Array, within: NDArray[np.bool_], longest: tuple[int, int] | None) -> str:
    if within.all():
        return f"The model reproduces the sensor from {tau[0]:.3g} to {tau[-1]:.3g} s."
    worst = int(np.where(within, 0.0, np.abs(np.log(ratio))).argmax())
    off = f"at {tau[worst]:.3g} s its Allan deviation is {ratio[worst]:.2f} times the sensor's."
    if longest is None:
        return f"The model does not reproduce the sensor: {off}"
    return (
        f"The model reproduces the sensor from {tau[longest[0]]:.3g} to {tau[longest[1]]:.3g} s only; {off}"
    )
