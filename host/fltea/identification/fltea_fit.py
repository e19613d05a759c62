"""FLTEA itself on a recording, as the daemon runs it: start-up window, bias, R, guard, supervisor."""

import math
from typing import Literal

import msgspec
import numpy as np

from fltea.estimator.baseline import baseline_of
from fltea.estimator.engine import CAUSES
from fltea.estimator.lane_settings import LaneSettings
from fltea.estimator.lanes import Lanes
from fltea.identification.gaps import Gaps, longest_epoch, no_gaps, spread
from fltea.records.arrays import Array, Mask
from fltea.records.fit import Interval
from fltea.settings.estimator import EstimatorConfig
from fltea.spectrum.innovation_whiteness import Innovations, InnovationSums, describes, describes_order

CHUNK = 4096
"""Samples that the lane takes at a time."""
LEAST = 100
"""Samples after the start-up window."""


class ConstantStartup(ValueError):
    """The axis does not change in the start-up window, so that FLTEA has no R."""


class FlteaFit(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The last estimates of one axis; those that are not finite, or not valid, are None."""

    variant: str
    guard: str
    alpha: float | None
    alpha_std: float | None
    """The filter's own standard deviation, which says how steady the figure is, not how true."""
    f: float | None
    """The parameter f in s^-α."""
    f_std: float | None
    valid: bool
    bias: float
    """Taken off, in the unit of y."""
    R: float
    """The variance of the white noise in the square of that unit."""
    R_from: Literal["start-up window", "setting"]
    startup_samples: int
    samples: int
    """Samples that it was run over with the start-up window: those of the longest epoch."""
    predicted: int
    """Lost ones between them, of which it made predictions only."""
    restarts: int
    interventions: dict[str, int]
    """Interventions of the guard since the last start by cause, without those that never happened."""
    alpha_drift: float | None
    """Change of α over the last third of the record, by the means of its two halves."""
    f_drift: float | None
    converged: bool
    """The drift of α is less than its standard deviation or 0.02."""
    describes_noise: bool | None
    """False: the innovations of the last two thirds are not white, or the noise has no order or another one,
    so that α and f, and their deviations, say nothing of it; None: there are too few, or no verdict."""
    settings: EstimatorConfig
    """All of them: window, start-up, tuning."""


def fltea_fit(
    y: Array,
    h: float,
    config: EstimatorConfig,
    lsb: float | None = None,
    gaps: Gaps | None = None,
    order: Interval | None = None,
) -> tuple[FlteaFit, Innovations | None]:
    """Run the variant and guard of `config` over one axis, (n,), at a period of h s.

    gaps: between the samples, if there are any. As live, lost samples are predicted, and after a long gap all
    begins again: so it is run over the longest part between two such gaps.

    Returns the last estimates, and the test of the innovations of the last two thirds.

    lsb: one count in the unit of y, if known; the variance of rounding is the least R. order: the noise's by
    the verdict, without ends if it has none; None where there is no verdict.

    Raises:
        ConstantStartup: the axis is constant in the start-up window.
        ValueError: settings that no filter can work with, fewer samples than the start-up window has
            and a hundred more.
    """
    gaps = gaps or no_gaps()
    begin, end = longest_epoch(len(y), gaps)
    y, gaps = y[begin:end], gaps.within(begin, end)
    if len(y) < config.startup_needed + LEAST:
        raise ValueError(
            f"{len(y)} samples: the start-up window takes {config.startup_needed}, and at least {LEAST} "
            "have to follow it"
        )
    base = baseline_of(y, "axis", config, lsb)
    if base.constant_axes:
        raise ConstantStartup(
            f"the axis is constant in the start-up window, its first {config.startup_needed} samples"
        )
    bias, R = base.bias_dps[0], base.R[0]
    used, (rest, missing) = len(y), after_startup(y, gaps, config)
    run = _Run(rest, missing, bias, h, config, R)
    alpha, alpha_std, f, f_std = (_number(value) if run.valid else None for value in run.last)
    alpha_drift, f_drift = run.alpha.value(), run.f.value()
    tested = run.innovations
    white = None if tested is None else describes(tested.samples, tested.ljung_box)
    last_alpha, last_std, *_ = run.last
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
        samples=used,
        predicted=0 if missing is None else int(missing.sum()),
        restarts=run.restarts,
        interventions=run.interventions,
        alpha_drift=alpha_drift,
        f_drift=f_drift,
        converged=alpha_drift is not None and abs(alpha_drift) <= max(alpha_std or 0.0, 0.02),
        describes_noise=describes_order(white, last_alpha, last_std, order),
        settings=config,
    )
    return result, tested


def after_startup(y: Array, gaps: Gaps, config: EstimatorConfig) -> tuple[Array, Mask | None]:
    """Return what follows the start-up window of an epoch, and which of its samples are lost."""
    return spread(y[config.startup_needed :], gaps.within(config.startup_needed, len(y)))


class _Run:
    """One lane over y (n,), the start-up window taken off, under the supervisor; memory for one block.

    last: α, its deviation, f, its deviation after the last sample. alpha, f: their drift over the last third.
    innovations: the test of those of the last two thirds.
    """

    def __init__(
        self, y: Array, missing: Mask | None, bias: float, h: float, config: EstimatorConfig, R: float
    ) -> None:
        lanes = Lanes(1, LaneSettings(config, h, R))
        n, third = len(y), len(y) // 3
        tested = InnovationSums()
        self.alpha, self.f = _Drift(n - third, n), _Drift(n - third, n)
        for start in range(0, n, CHUNK):
            now = slice(start, start + CHUNK)
            gone = None if missing is None else missing[now, np.newaxis]
            block = lanes.run(y[now, np.newaxis] - bias, gone)
            self.alpha.add(start, block.alpha[:, 0])
            self.f.add(start, block.f[:, 0])
            if start + CHUNK > third:
                rows = slice(max(0, third - start), None)
                tested.add(block.innovation[rows, 0], block.innovation_std[rows, 0])
        self.innovations = tested.result()
        last = block.alpha, block.alpha_std, block.f, block.f_std
        self.last = tuple(float(column[-1, 0]) for column in last)
        self.valid = bool(block.valid[-1, 0])
        self.restarts = int(lanes.restarts[0])
        counts = zip(CAUSES, lanes.interventions()[0].tolist(), strict=True)
        self.interventions = {cause: n for cause, n in counts if n}


class _Drift:
    """Mean of the second half of samples begin … end less that of the first, of those that are finite."""

    def __init__(self, begin: int, end: int) -> None:
        middle = begin + (end - begin) // 2
        self._halves = ((begin, middle), (middle, end))
        self._sums, self._counts = [0.0, 0.0], [0, 0]

    def add(self, start: int, values: Array) -> None:
        """Add the next values, from number `start` on."""
        for i, (begin, end) in enumerate(self._halves):
            part = values[max(0, begin - start) : max(0, end - start)]
            part = part[np.isfinite(part)]
            self._sums[i] += float(part.sum())
            self._counts[i] += len(part)

    def value(self) -> float | None:
        """Return the result, or None if too few values are finite."""
        if not all(self._counts):
            return None
        first, second = (total / count for total, count in zip(self._sums, self._counts, strict=True))
        return second - first


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
