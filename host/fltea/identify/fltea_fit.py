"""FLTEA itself on a recording, as the daemon runs it: start-up window, bias, R, guard, supervisor."""

import math
from collections.abc import Sequence
from typing import Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from fltea.estimator.bias import Baseline, Startup
from fltea.estimator.engine import CAUSES, Engine
from fltea.estimator.native_gyroscope import STATE_BOUND, lane_settings
from fltea.estimator.online import OnlineEstimator
from fltea.estimator.supervisor import BOUND_SAMPLES, BOUND_SHARE, LOST_ORDER
from fltea.settings.config import EstimatorConfig
from fltea.spectrum.innovation_whiteness import Innovations, innovations

Array = NDArray[np.float64]

CHUNK = 50
"""Samples between two looks at the guard's counts; BOUND_SAMPLES is a multiple of it."""


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
    if len(y) < config.startup_needed + 2 * CHUNK:
        raise ValueError(
            f"{len(y)} samples: the start-up window takes {config.startup_needed}, and at least {2 * CHUNK} "
            "have to follow it"
        )
    base = baseline(y, config, lsb)
    if base.constant_axes:
        raise ValueError("the axis is constant in the start-up window: there is no noise to identify")
    bias, R = base.bias_dps[0], base.R[0]
    rest = y[config.startup_needed :]
    run = _Run.fast(rest - bias, h, config, R) or _Run.as_daemon(y, h, config, lsb)
    alpha, alpha_std, f, f_std = (_number(run.columns[i][-1]) if run.valid else None for i in range(4))
    third = len(rest) // 3
    alpha_drift, f_drift = (_drift(run.columns[i][-third:]) for i in (0, 2))
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
    return result, innovations(run.columns[4][third:], run.columns[5][third:])


def baseline(y: Array, config: EstimatorConfig, lsb: float | None) -> Baseline:
    """Bias and R of one axis from its first samples, or from the settings."""
    bias: Literal["startup", "none"] | float | Sequence[float] = config.bias
    startup = Startup(("axis",), config.startup, bias, config.R, lsb)
    for value in y[: startup.needed]:
        startup.add((float(value),))
    return startup.baseline()


class _Run:
    """α, its deviation, f, its deviation, innovation, its deviation: each (n,), after the start-up."""

    def __init__(
        self, columns: list[Array], valid: bool, restarts: int, interventions: dict[str, int]
    ) -> None:
        self.columns = columns
        self.valid = valid
        self.restarts = restarts
        self.interventions = interventions

    @staticmethod
    def fast(y: Array, h: float, config: EstimatorConfig, R: float) -> "_Run | None":
        """The engine alone; None if the supervisor might have had something to say."""
        engine = Engine(1, lane_settings(config, h, [R]))
        columns = np.empty((6, len(y)))
        lately = BOUND_SAMPLES // CHUNK + 1
        bounded = [0] * lately
        for start in range(0, len(y), CHUNK):
            e = engine.run(y[start : start + CHUNK, np.newaxis])
            columns[:, start : start + CHUNK] = np.concatenate(
                [e.alpha, e.alpha_var, e.f, e.f_var, e.innovation, e.innovation_var], axis=1
            ).T
            bounded.append(int(e.interventions[0, STATE_BOUND]))
        # Windows that are a chunk longer, so that none of the supervisor's can hold more.
        longer = np.subtract(bounded[lately:], bounded[:-lately])
        if longer.max() > BOUND_SHARE * BOUND_SAMPLES:
            return None
        if not np.isfinite(columns).all() or np.abs(columns[0]).max() > LOST_ORDER:
            return None
        columns[[1, 3, 5]] = np.sqrt(np.maximum(columns[[1, 3, 5]], 0))
        counts = zip(CAUSES, e.interventions[0].tolist(), strict=True)
        return _Run(list(columns), True, 0, {cause: n for cause, n in counts if n})

    @staticmethod
    def as_daemon(y: Array, h: float, config: EstimatorConfig, lsb: float | None) -> "_Run":
        """Sample by sample with the daemon's own restarts; slower."""
        online = OnlineEstimator(("axis",), config, h, lsb)
        rows = []
        for value in y.tolist():
            found = online.on_sample((value,))
            if found is not None:
                e = found["axis"]
                rows.append((e.alpha, e.alpha_std, e.f, e.f_std, e.innovation_dps, e.innovation_std_dps))
        return _Run(
            list(np.array(rows).T),
            found is not None and found["axis"].valid,
            online.restarts["axis"],
            online.interventions.get("axis", {}),
        )


def _drift(values: Array) -> float | None:
    """Mean of the second half less that of the first; None if too few are finite."""
    half = len(values) // 2
    first, second = (part[np.isfinite(part)] for part in (values[:half], values[half:]))
    if not (first.size and second.size):
        return None
    return float(second.mean() - first.mean())


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
