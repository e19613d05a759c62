"""Run the online filters on many series at once, as the daemon does; each series is an axis of a sensor."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from fltea.estimator.bank import Bank, Variances
from fltea.estimator.filter_model import FilterModel
from fltea.records.arrays import Array
from fltea.settings.estimator import EstimatorConfig
from numpy.typing import NDArray

BLOCK = 100
"""Number of samples of each series that are filtered in one call. All record lengths are multiples of this
number.
"""


class Reading(NamedTuple):
    """The estimates that the live page would show after some number of samples.

    Each array has the shape (seeds,).
    """

    alpha: Array
    alpha_std: Array
    f: Array
    f_std: Array
    valid: NDArray[np.bool_]
    """False if the filter's supervisor would not publish the estimate, or has restarted the filter before."""


class Tuning(NamedTuple):
    """New variances for the filters after some number of samples, as arrays (seeds,).

    NaN leaves a variance as it is.

    `filter_models`: the filter model with which each series continues; None if the series keeps its own.
    """

    samples: int
    Q: Array
    R: Array
    filter_models: Sequence[FilterModel | None] = ()


def read(
    y: Array,
    h: float,
    config: EstimatorConfig,
    lengths: Sequence[int],
    *,
    Q: Array | None = None,
    R: Array | None = None,
    tunings: Sequence[Tuning] = (),
) -> list[Reading]:
    """Run one filter over y (n, seeds), and read its estimates after each of `lengths` samples.

    `h`: sampling period [s].

    `Q`, `R`: variances (seeds,) [(deg/s)²] in place of those in `config`. `tunings`: further variances while
    the filter runs, in rising order; tunings within the start-up window are ignored.

    Lengths count from the first sample of the start-up window. They are rising multiples of BLOCK and longer
    than the window. After the supervisor has once restarted the filter of a series or refused to publish its
    estimate, the estimates of this series stay invalid, although its filter restarts and goes on as in the
    daemon.
    """
    seeds, nothing = y.shape[1], np.full(y.shape[1], np.nan)
    bank = Bank(tuple(f"series {i}" for i in range(seeds)), config, h, None)
    startup = bank.startup_remaining
    if any(n % BLOCK or n < startup + BLOCK for n in lengths) or startup % BLOCK:
        raise ValueError(f"lengths must be multiples of {BLOCK} beyond the start-up window, got {lengths}")
    bank.run(y[:startup])
    given = Tuning(startup, nothing if Q is None else Q, nothing if R is None else R)
    by_samples = {one.samples: one for one in (*tunings, given)}
    valid, readings = np.ones(seeds, dtype=bool), []
    for start in range(startup, lengths[-1], BLOCK):
        if start in by_samples:
            _tune(bank, by_samples[start])
        e = bank.run(y[start : start + BLOCK])
        valid[[one.lane for one in e.lost]] = False
        if start + BLOCK in lengths:
            last = (column[-1].copy() for column in (e.alpha, e.alpha_std, e.f, e.f_std))
            readings.append(Reading._make((*last, valid.copy())))
    return readings


def _tune(bank: Bank, tuning: Tuning) -> None:
    changed = {}
    for axis, Q, R in zip(bank.axes, tuning.Q.tolist(), tuning.R.tolist(), strict=True):
        now = bank.variances[axis]
        if not (np.isnan(Q) and np.isnan(R)):
            changed[axis] = Variances(now.Q if np.isnan(Q) else Q, now.R if np.isnan(R) else R)
    filter_models = zip(bank.axes, tuning.filter_models, strict=bool(tuning.filter_models))
    bank.retune(changed, {axis: one for axis, one in filter_models if one is not None})
