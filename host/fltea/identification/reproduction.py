"""Does the identified model reproduce the sensor? Allan deviations of its noise over that of the data."""

import itertools
import math
from collections.abc import Sequence

import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray

from fltea.identification.allan import averaging_factors, overlapping
from fltea.identification.noise_model import AxisModel, check_possible, draws
from fltea.records.arrays import Array

SIMULATIONS = 20
CLOSE = 0.1
"""A model may be so far off, whatever the spread of the simulations: parameters are not known better."""
LONGEST = 1 << 18
"""Samples that are simulated. Of a longer record the model is compared over short averaging times with so
much noise, and over longer ones with means of k samples, drawn with the spectrum that such means have."""
FEWEST_MEANS = 8
"""Averaging times of at least so many means are compared with means."""
SPREADS = 4.0
"""A model may be off by so many standard deviations of the simulations, since forty points are compared."""


class Reproduction(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Ratio of the Allan deviations, simulated over data, at each averaging time.

    from_s, to_s: the longest stretch over which the model reproduces the sensor; None if it does nowhere.
    """

    tau_s: tuple[float, ...]
    ratio: tuple[float, ...]
    """Median of the simulations."""
    low: tuple[float, ...]
    """5 % of them."""
    high: tuple[float, ...]
    """95 %."""
    within: tuple[bool, ...]
    """The median is within 10 % of the data, or within four standard deviations of the simulations."""
    from_s: float | None
    to_s: float | None
    text: str


def reproduction(
    y_dps: ArrayLike,
    h: float,
    model: AxisModel,
    *,
    simulations: int = SIMULATIONS,
    seed: int = 0,
    stretches: Sequence[Array] | None = None,
) -> Reproduction:
    """Compare one axis (n,), in the unit of its model, with noise of that model; h in s.

    stretches: those of the axis, if samples are missing.

    Raises:
        ValueError: the model has no finite variance, or the axis is constant.
    """
    y = np.ascontiguousarray(y_dps, dtype=np.float64)
    check_possible(model, h)
    stretches = stretches or [y]
    factors = averaging_factors(max(map(len, stretches)))
    mean_of = -(-len(y) // LONGEST)
    if mean_of > 1:
        whole = mean_of * np.rint(factors / mean_of).astype(np.int64)
        factors = np.unique(np.where(factors < FEWEST_MEANS * mean_of, factors, whole))
    data = overlapping(stretches, factors)
    if not data.all():
        raise ValueError("the axis is constant: there is nothing to compare with")
    rng = np.random.default_rng(seed)
    if mean_of == 1:
        logs = _logs(model, h, factors, data, len(y), simulations, rng)
    else:
        short = factors < FEWEST_MEANS * mean_of
        logs = np.empty((simulations, len(factors)))
        n = len(y) // mean_of
        logs[:, short] = _logs(model, h, factors[short], data[short], n, simulations, rng)
        # They are of less of the noise than the record is, so they spread by more.
        middle = np.median(logs[:, short], axis=0)
        logs[:, short] = middle + (logs[:, short] - middle) / math.sqrt(mean_of)
        logs[:, ~short] = _logs(model, h, factors[~short], data[~short], n, simulations, rng, mean_of)
    low, middle, high = np.quantile(logs, (0.05, 0.5, 0.95), axis=0)
    within = np.abs(middle) <= np.maximum(math.log1p(CLOSE), SPREADS * logs.std(axis=0, ddof=1))
    tau = np.asarray(factors * h, dtype=np.float64)
    longest = _longest(within)
    from_s, to_s = (None, None) if longest is None else (float(tau[longest[0]]), float(tau[longest[1]]))
    return Reproduction(
        tuple(tau.tolist()),
        tuple(np.exp(middle).tolist()),
        tuple(np.exp(low).tolist()),
        tuple(np.exp(high).tolist()),
        tuple(within.tolist()),
        from_s,
        to_s,
        _text(tau, np.exp(middle), within, longest),
    )


def _logs(
    model: AxisModel,
    h: float,
    factors: NDArray[np.int64],
    data: Array,
    n: int,
    simulations: int,
    rng: np.random.Generator,
    mean_of: int = 1,
) -> Array:
    """Return log(simulated / measured Allan deviation), (simulations, factors), of n means each."""
    noises = itertools.islice(draws(model, h, n, rng, mean_of), simulations)
    drawn = np.array([overlapping([noise], factors // mean_of) for noise, _ in noises])
    return np.asarray(np.log(np.maximum(drawn, np.finfo(np.float64).tiny) / data))


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
