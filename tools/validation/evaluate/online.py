"""Run the online filters on many series at once, as the daemon does.

Each series takes the place of a sensor's axis.
"""

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
    """The estimates that the live page would show after a certain number of samples.

    Each array has the shape (seeds,).
    """

    alpha: Array
    alpha_std: Array
    f: Array
    f_std: Array
    valid: NDArray[np.bool_]
    """False if the program would not publish the estimate, or has restarted the filter earlier because it ran
    away.
    """


class Tuning(NamedTuple):
    """The variances that the filters get after a certain number of samples, as arrays (seeds,).

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

    `Q`, `R`: variances (seeds,) [(deg/s)²] that replace those in `config`. `tunings`: variances that the
    filter gets while it runs, in the order of time. Tunings within the start-up window (the first samples,
    which give bias and R) are ignored.

    Lengths count from the first sample of the start-up window. They are rising multiples of BLOCK and longer
    than the window. If the supervisor restarts the filter of a series or refuses to publish its estimate, all
    later estimates of this series are invalid. The filter itself goes on as in the daemon.
    """
    seeds, nothing = y.shape[1], np.full(y.shape[1], np.nan)
    bank = Bank(tuple(f"series {i}" for i in range(seeds)), config, h, None)
    startup = bank.startup_remaining
    if any(n % BLOCK or n < startup + BLOCK for n in lengths) or startup % BLOCK:
        raise ValueError(
            f"lengths must be multiples of {BLOCK} and exceed the start-up window, got {lengths}"
        )
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
