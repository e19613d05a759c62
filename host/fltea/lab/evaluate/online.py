"""The online filters on many series at once, as the daemon would run them: each series is a lane."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fltea.estimator.engine import Engine
from fltea.estimator.lane_settings import lane_settings
from fltea.estimator.native_gyroscope import STATE_BOUND
from fltea.estimator.supervisor import BOUND_SAMPLES, BOUND_SHARE, LOST_ORDER
from fltea.settings.config import EstimatorConfig

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
    """False: the supervisor would not publish it, or has had to begin anew on the way"""


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
    A lane that ran away or was held by the guard (as the supervisor counts) at the end of a block, is not
    valid from there on; the daemon would begin anew.
    """
    startup = config.startup_needed
    if any(n % BLOCK or n < startup + BLOCK for n in lengths) or startup % BLOCK:
        raise ValueError(f"lengths must be multiples of {BLOCK} beyond the start-up window, got {lengths}")
    window = y[:startup]
    bias = window.mean(axis=0) if config.bias == "startup" else np.zeros(y.shape[1])
    if R is None:
        R = window.var(axis=0, ddof=1) if config.R == "auto" else np.full(y.shape[1], np.ravel(config.R)[0])
    settings = lane_settings(config, h, R.tolist())
    if Q is not None:
        settings = replace(settings, state=replace(settings.state, Q=Q))
    engine = Engine(y.shape[1], settings)
    valid = np.ones(y.shape[1], dtype=bool)
    back = BOUND_SAMPLES // BLOCK
    held = [np.zeros(y.shape[1], dtype=np.int64)] * (back + 1)
    readings = []
    for start in range(startup, lengths[-1], BLOCK):
        e = engine.run(y[start : start + BLOCK] - bias)
        alpha, f = e.alpha[-1].copy(), e.f[-1].copy()
        gone = ~(np.isfinite(f) & np.isfinite(e.x[-1]) & (np.abs(alpha) <= LOST_ORDER))
        held = [*held[1:], engine.interventions()[:, STATE_BOUND].astype(np.int64)]
        valid &= ~gone & (held[-1] - held[0] <= BOUND_SHARE * BOUND_SAMPLES)
        if start + BLOCK in lengths:
            alpha_std, f_std = (np.sqrt(np.maximum(v[-1], 0)) for v in (e.alpha_var, e.f_var))
            readings.append(Reading(alpha, alpha_std, f, f_std, valid.copy()))
    return readings
