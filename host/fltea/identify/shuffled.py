"""What FLTEA gives for shuffled copies of the same samples, which are white whatever they were before.

All copies are lanes of one engine, each with a start-up window, a bias and an R of its own, as the daemon
would have them.
"""

import math
from dataclasses import replace

import msgspec
import numpy as np
from numpy.typing import NDArray

from fltea.config import EstimatorConfig
from fltea.estimator.engine import Engine
from fltea.estimator.native_gyroscope import lane_settings
from fltea.estimator.supervisor import LOST_ORDER

Array = NDArray[np.float64]

PROBABILITIES = (0.05, 0.5, 0.95)
BLOCK = 100
"""Samples of all lanes that the engine takes at once: what it returns has to fit the caches."""
ACCURACY = 3
"""Digits of the compressed memory: cost 1e-6 in α, where copies differ by 1e-2; a sixth of the time."""


class ShuffledBand(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """5, 50 and 95 % of the copies' last estimates; None where no copy has one."""

    copies: int
    lost: int
    """copies that ran away (only without a guard); left out"""
    alpha: tuple[float, float, float] | None
    f: tuple[float, float, float] | None
    """in s^-α"""
    alpha_rank: float | None
    """share of the copies whose α is below that of the data: 0.05 to 0.95 is what white noise gives"""
    f_rank: float | None


def shuffled_band(
    y: Array,
    h: float,
    config: EstimatorConfig,
    alpha: float | None,
    f: float | None,
    *,
    lsb: float | None = None,
    copies: int = 200,
    seed: int = 0,
) -> ShuffledBand:
    """Estimate `copies` shuffled copies of one axis y (n,) with the settings of `config`, period h in s.

    alpha, f: what the same settings gave for y itself. Memory is compressed whatever `config.engine` says.

    Raises:
        ValueError: settings that no filter can work with.
    """
    shuffles = _shuffled(y, copies, np.random.default_rng(seed))
    startup = config.startup_needed
    window = shuffles[:startup]
    bias = np.zeros(copies)
    if config.bias == "startup":
        bias = window.mean(axis=0)
    elif config.bias != "none":
        bias += np.ravel(config.bias)[0]
    if config.R == "auto":
        R = np.maximum(window.var(axis=0, ddof=1), ((lsb or 0.0) ** 2) / 12)
        # A copy that happens to be constant in its window, of data that hardly ever change.
        R = np.maximum(R, 1e-6 * y.var())
    else:
        R = np.full(copies, np.ravel(config.R)[0])
    engine = Engine(
        copies, replace(lane_settings(config, h, R.tolist()), memory="compressed", accuracy=ACCURACY)
    )
    lost = np.zeros(copies, dtype=bool)
    for start in range(startup, len(y), BLOCK):
        after = engine.run(shuffles[start : start + BLOCK] - bias)
        last_alpha, last_f = after.alpha[-1].copy(), after.f[-1].copy()
        gone = ~(np.isfinite(last_f) & np.isfinite(after.x[-1]) & (np.abs(last_alpha) <= LOST_ORDER))
        if gone.any():
            engine.reset(gone)
            lost |= gone
    alphas, fs = last_alpha[~lost], last_f[~lost]
    return ShuffledBand(
        copies, int(lost.sum()), _quantiles(alphas), _quantiles(fs), _rank(alphas, alpha), _rank(fs, f)
    )


def _shuffled(y: Array, copies: int, rng: np.random.Generator) -> Array:
    """Copies side by side, (n, copies)."""
    shuffles = np.empty((len(y), copies))
    for lane in range(copies):
        shuffles[:, lane] = rng.permutation(y)
    return shuffles


def _quantiles(values: Array) -> tuple[float, float, float] | None:
    """At Weibull's positions: one more copy falls between two of them with their share."""
    if not values.size:
        return None
    places = np.array(PROBABILITIES) * (values.size + 1) - 1
    low, middle, high = np.interp(places, np.arange(values.size), np.sort(values)).tolist()
    return low, middle, high


def _rank(values: Array, value: float | None) -> float | None:
    if value is None or not math.isfinite(value) or not values.size:
        return None
    return float((values < value).mean() + (values == value).mean() / 2)
