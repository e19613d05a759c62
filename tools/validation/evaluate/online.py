"""The online filters on many series at once, as the daemon would run them: each series is a lane."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from fltea.estimator.baseline import lane_baselines
from fltea.estimator.lane_settings import LaneSettings
from fltea.estimator.lanes import Lanes
from fltea.settings.estimator import EstimatorConfig
from numpy.typing import NDArray

Array = NDArray[np.float64]

BLOCK = 100
"""Samples of all lanes that the engine takes at once; divides the lengths."""


class Reading(NamedTuple):
    """What the page shows after some number of samples; (seeds,) each."""

    alpha: Array
    alpha_std: Array
    f: Array
    f_std: Array
    valid: NDArray[np.bool_]
    """False: the supervisor would not publish it, or has had to begin again on the way"""


def read(
    y: Array,
    h: float,
    config: EstimatorConfig,
    lengths: Sequence[int],
    *,
    Q: Array | None = None,
    R: Array | None = None,
) -> list[Reading]:
    """Run one filter over y (n, seeds) at a period of h s, and read it after each of `lengths` samples.

    Q, R: (seeds,) in (deg/s)², in place of those of `config`.

    Lengths count from the first sample of the start-up window; they are rising multiples of BLOCK beyond it.
    A lane that the supervisor has withdrawn once is not valid from there on, though it begins again as it
    does in the daemon.
    """
    startup = config.startup_needed
    if any(n % BLOCK or n < startup + BLOCK for n in lengths) or startup % BLOCK:
        raise ValueError(f"lengths must be multiples of {BLOCK} beyond the start-up window, got {lengths}")
    bias, own_R = lane_baselines(y[:startup], config, None)
    numbers = {} if Q is None else {"state.Q": Q}
    lanes = Lanes(y.shape[1], LaneSettings(config, h, own_R if R is None else R, numbers))
    valid = np.ones(y.shape[1], dtype=bool)
    readings = []
    for start in range(startup, lengths[-1], BLOCK):
        e = lanes.run(y[start : start + BLOCK] - bias)
        valid[[one.lane for one in e.lost]] = False
        if start + BLOCK in lengths:
            alpha, alpha_std, f, f_std = (v[-1].copy() for v in (e.alpha, e.alpha_std, e.f, e.f_std))
            readings.append(Reading(alpha, alpha_std, f, f_std, valid.copy()))
    return readings
