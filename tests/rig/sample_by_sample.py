"""One sample at a time, in Python: the estimator of the daemon written out, as the oracle of the native bank.

The engine is the native one, whose own oracle is `fltea.estimator.reference`.
"""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from fltea.estimator.baseline import Baseline, BaselineRule
from fltea.estimator.engine import CAUSES, Engine
from fltea.estimator.lane_settings import LaneSettings
from fltea.estimator.lanes import BOUND_SAMPLES, BOUND_SHARE, LOST_ORDER, Reason
from fltea.settings.estimator import EstimatorConfig
from fltea.spectrum.innovation_whiteness import LAGS, describes

STATE_BOUND = CAUSES.index("state_bound")


class AxisEstimate(NamedTuple):
    """Estimate of one axis after one sample; with `valid=False` every number is NaN."""

    alpha: float
    alpha_std: float
    f: float
    f_std: float
    state_dps: float
    innovation_dps: float
    innovation_std_dps: float
    valid: bool


INVALID = AxisEstimate(*(math.nan,) * 7, False)


class Verdict(NamedTuple):
    """What the supervisor says of a lane after a sample.

    valid: the estimate may be published. restart: the lane has to begin again with the next sample.
    news: why the lane has just become invalid, else None.
    """

    valid: bool
    restart: bool
    news: Reason | None


GOOD = Verdict(True, False, None)


def ran_away(alpha: float, f: float, state_dps: float) -> bool:
    """Whether an estimate is not finite, or its order beyond all sense."""
    return not (math.isfinite(f) and math.isfinite(state_dps) and abs(alpha) <= LOST_ORDER)


class Supervisor:
    """Watches one lane."""

    def __init__(self) -> None:
        self._bounds: deque[bool] = deque(maxlen=BOUND_SAMPLES)
        self._bounded = 0
        self._distrusted = False

    def judge(self, alpha: float, f: float, state_dps: float, *, state_bound: bool) -> Verdict:
        """Judge one sample's estimates; state_bound says whether the guard held the state in this sample."""
        if ran_away(alpha, f, state_dps):
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


class Startup(BaselineRule):
    """Collects the samples of the start-up window; arguments and errors as of `BaselineRule`."""

    def __init__(self, axes: Sequence[str], config: EstimatorConfig, resolution: float | None = None) -> None:
        super().__init__(axes, config, resolution)
        self._floor = self.resolution**2 / 12
        self._samples: list[tuple[float, ...]] = []

    def add(self, y_dps: Sequence[float]) -> Baseline | None:
        """Take one sample in deg/s of all axes; return the Baseline once the window is full, until then None.

        Samples beyond the window do not change it. Raises ValueError for a wrong count or numbers not finite.
        """
        if len(y_dps) != len(self.axes):
            raise ValueError(f"expected {len(self.axes)} axes in a sample, got {len(y_dps)}")
        for axis, y in zip(self.axes, y_dps, strict=True):
            if not math.isfinite(y):
                raise ValueError(f"{axis} is {y}: leave missing samples out of the start-up window")
        if len(self._samples) < self.needed:
            self._samples.append(tuple(y_dps))
        return self.baseline() if len(self._samples) == self.needed else None

    def baseline(self) -> Baseline:
        """Return the Baseline; ValueError if samples are still missing."""
        missing = self.needed - len(self._samples)
        if missing:
            raise ValueError(f"the start-up window still needs {missing} of {self.needed} samples")
        window = np.array(self._samples).reshape(self.needed, len(self.axes))
        bias = window.mean(axis=0) if self._given_bias is None else self._given_bias
        constant: tuple[str, ...] = ()
        if self._given_R is None:
            R = np.maximum(window.var(axis=0, ddof=1), self._floor)
            # By comparison and not by the variance, in which rounding leaves a trace of the mean. Also where
            # the resolution is known: a channel that is stuck would else look like a quiet one.
            still = (window == window[0]).all(axis=0)
            constant = tuple(axis for axis, same in zip(self.axes, still, strict=True) if same)
            R[still] = np.nan
        else:
            R = np.array(self._given_R)
        return Baseline(tuple(map(float, bias)), tuple(map(float, R)), constant)


class NativeGyroscope:
    """FLTEA for named axes on the native engine; `step` takes one sample of all of them.

    `config` names memory, variant and guard too.
    `lost` holds, after a step, the axes that have just become invalid and why.
    Raises ValueError for settings that no filter can work with.
    """

    def __init__(
        self,
        axes: Sequence[str],
        R: Sequence[float],
        bias: Sequence[float],
        h: float,
        config: EstimatorConfig,
    ) -> None:
        self.axes = tuple(axes)
        self.lost: dict[str, Reason] = {}
        self.restarts = dict.fromkeys(self.axes, 0)
        self._bias = np.array(bias, dtype=np.float64)
        self._supervisors = [Supervisor() for _ in self.axes]
        self._settings = LaneSettings(config, h, R)
        self._engine = Engine(len(self.axes), self._settings) if self.axes else None
        self._bounded = np.zeros(len(self.axes), dtype=np.int32)

    def step(self, y_dps: Sequence[float] | None) -> dict[str, AxisEstimate]:
        """Take one sample in deg/s of all axes, or None for a missing one; an estimate for each axis.

        Raises ValueError for a sample that is not finite, and leaves every axis as it was.
        """
        self.lost = {}
        if self._engine is None:
            return {}
        missing = None if y_dps is not None else np.ones(len(self.axes), dtype=bool)
        y = np.zeros(len(self.axes)) if y_dps is None else np.asarray(y_dps) - self._bias
        e = self._engine.step(y, missing=missing)
        bounded = e.interventions[:, STATE_BOUND]
        held = (bounded > self._bounded).tolist()
        # Lists at once: to take numbers out of arrays one by one would cost more than the engine's step.
        lanes = zip(*(column.tolist() for column in e[:8]), held, strict=True)
        result = {}
        restarts = []
        for i, (axis, (alpha, alpha_var, f, f_var, x, _, nu, nu_var, is_held)) in enumerate(
            zip(self.axes, lanes, strict=True)
        ):
            verdict = self._supervisors[i].judge(alpha, f, x, state_bound=is_held)
            if verdict.restart:
                restarts.append(i)
            if verdict.news:
                self.lost[axis] = verdict.news
            result[axis] = (
                AxisEstimate(
                    alpha,
                    math.sqrt(max(alpha_var, 0.0)),
                    f,
                    math.sqrt(max(f_var, 0.0)),
                    x,
                    nu,
                    math.sqrt(max(nu_var, 0.0)),
                    valid=True,
                )
                if verdict.valid
                else INVALID
            )
        self._bounded = bounded.copy()
        if restarts:
            mask = np.zeros(len(self.axes), dtype=bool)
            mask[restarts] = True
            self._engine.reset(mask)
            for i in restarts:
                self.restarts[self.axes[i]] += 1
                self._supervisors[i] = Supervisor()
                self._bounded[i] = 0
        return result

    @property
    def interventions(self) -> dict[str, dict[str, int]]:
        """How often the guard stepped in since the lane's last start, by axis and cause; zeros left out."""
        if self._engine is None:
            return {}
        counts = self._engine.interventions()
        return {
            axis: {cause: int(n) for cause, n in zip(CAUSES, counts[i], strict=True) if n}
            for i, axis in enumerate(self.axes)
        }


class OnlineEstimator:
    """Bias and R from the start-up window, estimates from the first sample after it.

    axes: names. h: sampling period in s. resolution_dps: one LSB, None where unknown.

    Raises:
        ValueError: settings that no filter can work with.
    """

    def __init__(
        self,
        axes: tuple[str, ...],
        config: EstimatorConfig,
        h: float,
        resolution_dps: float | None,
    ):
        self.axes = axes
        self._config = config
        self._h = h
        self._startup = Startup(axes, config, resolution_dps)
        self.startup_remaining = self._startup.needed
        self.baseline: Baseline | None = None
        self._estimator: NativeGyroscope | None = None
        if not self.startup_remaining:
            self._begin(self._startup.baseline())

    def on_sample(self, y_dps: tuple[float, ...]) -> dict[str, AxisEstimate] | None:
        """Take one sample in deg/s; None while the start-up window fills.

        An axis that was constant over the start-up window has no variance to filter with: it stays invalid.
        """
        if self._estimator is None:
            self.startup_remaining -= 1
            baseline = self._startup.add(y_dps)
            if baseline is not None:
                self._begin(baseline)
            return None
        estimates = self._estimator.step([y_dps[i] for i in self._live])
        return {axis: estimates.get(axis, INVALID) for axis in self.axes}

    def on_missing(self, count: int) -> None:
        """Bridge lost samples by prediction alone; within the start-up window they do not matter."""
        if self._estimator is not None:
            for _ in range(count):
                self._estimator.step(None)

    @property
    def restarts(self) -> dict[str, int]:
        """How often each axis had to start again because its estimate was not finite."""
        counts = self._estimator.restarts if self._estimator else {}
        return {axis: counts.get(axis, 0) for axis in self.axes}

    @property
    def interventions(self) -> dict[str, dict[str, int]]:
        """How often the guard stepped in, by axis and cause."""
        return self._estimator.interventions if self._estimator else {}

    @property
    def lost(self) -> dict[str, Reason]:
        """Axes that have become invalid with the last sample, and why."""
        return self._estimator.lost if self._estimator else {}

    def _begin(self, baseline: Baseline) -> None:
        self.baseline = baseline
        self._live = [i for i, axis in enumerate(self.axes) if axis not in baseline.constant_axes]
        axes = [self.axes[i] for i in self._live]
        R = [baseline.R[i] for i in self._live]
        bias = [baseline.bias_dps[i] for i in self._live]
        self._estimator = NativeGyroscope(axes, R, bias, self._h, self._config)


BLOCK = 100
BLOCKS = 10
FEWEST = 200


@dataclass
class _Sums:
    n: int = 0
    squares: float = 0.0
    products: list[float] = field(default_factory=lambda: [0.0] * LAGS)
    normalised: float = 0.0


class Whiteness:
    """All figures over the last 1,000 innovations, give or take a block; None before `FEWEST`."""

    def __init__(self) -> None:
        self._blocks: deque[_Sums] = deque(maxlen=BLOCKS - 1)
        self._now = _Sums()
        self._before: list[float] = []

    def add(self, innovation: float, std: float) -> None:
        """Take an innovation and the standard deviation that the filter gave it, in the same unit."""
        now = self._now
        for lag, before in enumerate(reversed(self._before)):
            now.products[lag] += innovation * before
        self._before = [*self._before, innovation][-LAGS:]
        if std > 0:
            now.normalised += (innovation / std) ** 2
        now.squares += innovation * innovation
        now.n += 1
        if now.n == BLOCK:
            self._blocks.append(now)
            self._now = _Sums()

    def skip(self) -> None:
        """Take note that there was no innovation: what follows has no neighbours."""
        self._before = []

    @property
    def lag1(self) -> float | None:
        """Correlation of neighbours, 0 ± 1/√n for white innovations."""
        n, squares, products, _ = self._sums()
        return products[0] / squares if n >= FEWEST and squares > 0 else None

    @property
    def describes_noise(self) -> bool | None:
        """Whether the correlations of all lags are small."""
        n, squares, products, _ = self._sums()
        if n < FEWEST or not squares > 0:
            return None
        r = np.array(products) / squares
        return describes(n, n * (n + 2) * float((r**2 / (n - 1 - np.arange(LAGS))).sum()))

    @property
    def nis(self) -> float | None:
        """Mean normalised innovation squared; 1 where the filter's variance is right."""
        n, _, _, normalised = self._sums()
        return normalised / n if n >= FEWEST else None

    def _sums(self) -> tuple[int, float, list[float], float]:
        every = [*self._blocks, self._now]
        products = [sum(column) for column in zip(*(one.products for one in every), strict=True)]
        return (
            sum(one.n for one in every),
            sum(one.squares for one in every),
            products,
            sum(one.normalised for one in every),
        )
