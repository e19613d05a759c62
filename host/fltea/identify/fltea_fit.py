"""FLTEA itself on a recording, as the daemon runs it: start-up window, bias, R, guard, supervisor."""

import math
from typing import Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from fltea.estimator.baseline import baseline_of
from fltea.estimator.engine import CAUSES
from fltea.estimator.lane_settings import lane_settings
from fltea.estimator.lanes import Lanes
from fltea.settings.config import EstimatorConfig
from fltea.spectrum.innovation_whiteness import Innovations, innovations

Array = NDArray[np.float64]

CHUNK = 4096
"""Samples that the lane takes at a time."""
LEAST = 100
"""Samples after the start-up window."""


class FlteaFit(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The last estimates of one axis; those that are not finite, or not valid, are None."""

    variant: str
    guard: str
    alpha: float | None
    alpha_std: float | None
    """the filter's own: how steady the figure is, not how true"""
    f: float | None
    """in s^-α"""
    f_std: float | None
    valid: bool
    bias: float
    """taken off, in the unit of y"""
    R: float
    """in its square"""
    R_from: Literal["start-up window", "setting"]
    startup_samples: int
    restarts: int
    interventions: dict[str, int]
    """of the guard, since the last start, by cause; those that never happened left out"""
    alpha_drift: float | None
    """change of α over the last third of the record, by the means of its two halves"""
    f_drift: float | None
    converged: bool
    """the drift of α is less than its standard deviation or 0.02"""
    settings: EstimatorConfig
    """all of them: window, start-up, tuning"""


def fltea_fit(
    y: Array, h: float, config: EstimatorConfig, lsb: float | None = None
) -> tuple[FlteaFit, Innovations | None]:
    """Run the variant and guard of `config` over one axis without missing samples, (n,), at a period of h s.

    Returns the last estimates, and the test of the innovations of the last two thirds.

    lsb: one count in the unit of y, if known; the variance of rounding is the least R.

    Raises:
        ValueError: settings that no filter can work with, fewer samples than the start-up window has
            and a hundred more, or an axis that is constant in it.
    """
    if len(y) < config.startup_needed + LEAST:
        raise ValueError(
            f"{len(y)} samples: the start-up window takes {config.startup_needed}, and at least {LEAST} "
            "have to follow it"
        )
    base = baseline_of(y, "axis", config, lsb)
    if base.constant_axes:
        raise ValueError("the axis is constant in the start-up window: there is no noise to identify")
    bias, R = base.bias_dps[0], base.R[0]
    run = _Run(y[config.startup_needed :] - bias, h, config, R)
    alpha, alpha_std, f, f_std = (_number(value) if run.valid else None for value in run.last)
    alpha_drift, f_drift = _drift(run.alpha), _drift(run.f)
    result = FlteaFit(
        variant=config.variant,
        guard=config.guard,
        alpha=alpha,
        alpha_std=alpha_std,
        f=f,
        f_std=f_std,
        valid=run.valid,
        bias=bias,
        R=R,
        R_from="start-up window" if config.R == "auto" else "setting",
        startup_samples=config.startup_needed,
        restarts=run.restarts,
        interventions=run.interventions,
        alpha_drift=alpha_drift,
        f_drift=f_drift,
        converged=alpha_drift is not None and abs(alpha_drift) <= max(alpha_std or 0.0, 0.02),
        settings=config,
    )
    return result, innovations(run.innovation, run.innovation_std)


class _Run:
    """One lane over y (n,), the start-up window and the bias taken off, under the supervisor.

    last: α, its deviation, f, its deviation after the last sample. alpha, f: of the last third; innovation,
    innovation_std: of the last two thirds.
    """

    def __init__(self, y: Array, h: float, config: EstimatorConfig, R: float) -> None:
        lanes = Lanes(1, lane_settings(config, h, [R]))
        third = len(y) // 3
        self.alpha, self.f = np.empty(third), np.empty(third)
        self.innovation, self.innovation_std = np.empty(len(y) - third), np.empty(len(y) - third)
        kept = (
            (self.alpha, len(y) - third),
            (self.f, len(y) - third),
            (self.innovation, third),
            (self.innovation_std, third),
        )
        for start in range(0, len(y), CHUNK):
            block = lanes.run(y[start : start + CHUNK, np.newaxis])
            columns = block.alpha, block.f, block.innovation, block.innovation_std
            for column, (to, begin) in zip(columns, kept, strict=True):
                skipped = max(0, begin - start)
                to[start + skipped - begin : start + CHUNK - begin] = column[skipped:, 0]
        last = block.alpha, block.alpha_std, block.f, block.f_std
        self.last = tuple(float(column[-1, 0]) for column in last)
        self.valid = bool(block.valid[-1, 0])
        self.restarts = int(lanes.restarts[0])
        counts = zip(CAUSES, lanes.interventions()[0].tolist(), strict=True)
        self.interventions = {cause: n for cause, n in counts if n}


def _drift(values: Array) -> float | None:
    """Mean of the second half less that of the first; None if too few are finite."""
    half = len(values) // 2
    first, second = (part[np.isfinite(part)] for part in (values[:half], values[half:]))
    if not (first.size and second.size):
        return None
    return float(second.mean() - first.mean())


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
