"""Run the daemon's estimator in Python, one sample at a time, as the oracle of the native estimator.

This estimator contains the native engine, whose own oracle is `fltea.lab.reference`.
"""

import math
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from fltea.estimator.engine import CAUSES, Engine
from fltea.estimator.lane_settings import LaneSettings
from fltea.estimator.lanes import Reason
from fltea.records.arrays import Array
from fltea.settings.estimator import EstimatorConfig
from fltea.spectrum.innovation_whiteness import LAGS, describes
from numpy.typing import ArrayLike, NDArray

LOST_ORDER, BOUND_SAMPLES, BOUND_SHARE = 5.0, 200, 0.25
STATE_BOUND = CAUSES.index("state_bound")


class Verdict(NamedTuple):
    """What the supervisor decides about the filters of one axis (a lane) after a sample.

    `valid`: the estimate may be published. `restart`: the filters have to restart with the next sample.
    `news`: the reason, if the estimates have become invalid at this sample, otherwise None.
    """

    valid: bool
    restart: bool
    news: Reason | None


GOOD = Verdict(True, False, None)


class Supervisor:
    """Decides after each sample whether an axis's estimates are valid, and whether its filters restart."""

    def __init__(self) -> None:
        self._bounds: deque[bool] = deque(maxlen=BOUND_SAMPLES)
        self._bounded = 0
        self._distrusted = False

    def judge(self, alpha: float, f: float, state: float, *, state_bound: bool) -> Verdict:
        """Decide, by the estimates after one sample, whether they are valid and whether the filters restart.

        `state_bound`: whether the guard had to limit the state in this sample.
        """
        if not (math.isfinite(f) and math.isfinite(state) and abs(alpha) <= LOST_ORDER):
            return Verdict(False, True, "runaway")
        if len(self._bounds) == BOUND_SAMPLES:
            self._bounded -= self._bounds[0]
        self._bounds.append(state_bound)
        self._bounded += state_bound
        share = self._bounded / BOUND_SAMPLES
        if not self._distrusted and share <= BOUND_SHARE:
            return GOOD
        news: Reason | None = None if self._distrusted else "bound"
        self._distrusted = share > BOUND_SHARE / 2
        return Verdict(False, not self._distrusted, news)


class Row(NamedTuple):
    """Output of the filters of all axes (lanes) after a sample.

    The seven columns have the shape (7, lanes). The columns of an invalid axis are NaN. Axes that have just
    become invalid are listed with their reasons.
    """

    columns: Array
    valid: NDArray[np.bool_]
    lost: dict[int, Reason]


class LanesBySample:
    """The filters of several axes. Each axis has a supervisor that withdraws estimates and restarts filters.

    Invalid estimates are NaN. Filters that have to restart do so before the next sample.
    """

    def __init__(self, lanes: int, settings: LaneSettings) -> None:
        self.engine = Engine(lanes, settings)
        self.restarts = [0] * lanes
        self._supervisors = [Supervisor() for _ in range(lanes)]
        self._held = np.zeros(lanes, dtype=np.int32)

    def step(self, y: ArrayLike, *, missing: bool = False) -> Row:
        """Process one sample of every axis; `y` has the shape (axes,).

        `missing`: whether the sample was lost.
        """
        e = self.engine.step(y, missing=np.full(np.shape(y), missing))
        held = e.interventions[:, STATE_BOUND]
        newly_held = held > self._held
        lanes = zip(e.alpha.tolist(), e.f.tolist(), e.x.tolist(), newly_held.tolist(), strict=True)
        verdicts = [
            watch.judge(alpha, f, x, state_bound=bound)
            for watch, (alpha, f, x, bound) in zip(self._supervisors, lanes, strict=True)
        ]
        deviations = np.sqrt(np.maximum([e.alpha_var, e.f_var, e.innovation_var], 0.0))
        columns = np.array([e.alpha, deviations[0], e.f, deviations[1], e.x, e.innovation, deviations[2]])
        valid = np.array([verdict.valid for verdict in verdicts])
        columns[:, ~valid] = np.nan
        again = np.array([verdict.restart for verdict in verdicts])
        if again.any():
            self.engine.reset(again)
        self._held = np.where(again, 0, held)
        for lane in np.flatnonzero(again):
            self.restarts[lane] += 1
            self._supervisors[lane] = Supervisor()
        return Row(columns, valid, {i: one.news for i, one in enumerate(verdicts) if one.news})


def baseline(
    window: Array, config: EstimatorConfig, lsb: float | None
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return bias and variance R of each axis, from start-up window or settings, and the constant axes."""
    axes = window.shape[1]
    if config.bias == "startup":
        bias = window.mean(axis=0)
    else:
        bias = np.broadcast_to(0.0 if config.bias == "none" else config.bias, axes)
    if config.R != "auto":
        return bias, np.broadcast_to(config.R, axes), np.zeros(axes, dtype=bool)
    R = np.maximum(window.var(axis=0, ddof=1), (lsb or 0.0) ** 2 / 12)
    # Constant axes are found by comparison, since rounding of the mean leaves a nonzero variance. The
    # comparison is made even if the resolution is known; otherwise a channel that is stuck at one value would
    # count as a channel of little noise.
    return bias, R, (window == window[0]).all(axis=0)


BLOCK, BLOCKS, FEWEST = 100, 10, 200


class Whiteness(NamedTuple):
    """Figures that show whether the last innovations are white noise. A figure is None if there are too few
    innovations.
    """

    lag1: float | None
    nis: float | None
    is_white: bool | None


def whiteness(rows: Sequence[tuple[float, float] | None]) -> Whiteness:
    """Return figures of the last 900 to 999 innovations (of all if there are fewer), by their definitions.

    `rows`: innovation and its predicted standard deviation for each sample, or None for a sample that is lost
    or invalid. The correlation leaves out pairs of innovations with such a sample between them.
    """
    x, std = np.array([one or (np.nan, np.nan) for one in rows]).reshape(-1, 2).T
    there = ~np.isnan(x)
    number = np.cumsum(there)
    kept = there & (number > BLOCK * max(0, there.sum() // BLOCK - BLOCKS + 1))
    n, squares = int(kept.sum()), float((x[kept] ** 2).sum())
    if n < FEWEST:
        return Whiteness(None, None, None)
    sure = kept & (std > 0)
    nis = float(((x[sure] / std[sure]) ** 2).sum()) / n
    if not squares > 0:
        return Whiteness(None, nis, None)
    r = np.empty(LAGS)
    for lag in range(1, LAGS + 1):
        unbroken = number[lag:] - number[:-lag] == lag  # no sample is missing within a pair
        pairs = kept[lag:] & there[:-lag] & unbroken
        r[lag - 1] = (x[lag:] * x[:-lag])[pairs].sum() / squares
    ljung_box = n * (n + 2) * float((r**2 / (n - np.arange(1, LAGS + 1))).sum())
    return Whiteness(float(r[0]), nis, describes(n, ljung_box))
