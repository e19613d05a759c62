"""Run FLTEA over a recording as the daemon does.

A start-up window gives bias and R, a guard bounds the estimates, and a supervisor restarts filters that
diverge. Axes with the same settings are run in parallel, as lanes of one engine.
"""

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Literal, NamedTuple

import msgspec
import numpy as np

from fltea.estimator.baseline import baseline_of
from fltea.estimator.engine import CAUSES
from fltea.estimator.lane_settings import LaneSettings
from fltea.estimator.lanes import Lanes
from fltea.identification.gaps import Gaps, longest_epoch, spread
from fltea.records.arrays import Array, Mask
from fltea.records.fit import Interval
from fltea.settings.estimator import EstimatorConfig
from fltea.spectrum.innovation_whiteness import Innovations, InnovationSums, describes, describes_order

Variant = Literal["triple", "joint"]

OTHER: dict[Variant, Variant] = {"joint": "triple", "triple": "joint"}

CHUNK = 4096
"""Number of samples of each axis that the engine processes at a time."""
LEAST = 100
"""FLTEA is run only if at least this many samples follow the start-up window."""


# Why more than 12 attributes: each is one field of the published fit.
class FlteaFit(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The last estimates of one axis; an estimate that is not finite or not valid is None."""

    variant: str
    guard: str
    alpha: float | None
    alpha_std: float | None
    """The standard deviation of α that the filter itself computes.

    It says how much the estimate still varies, but not how far it is from the true α.
    """
    f: float | None
    """The parameter f of D^α x = f x + ω, in s^-α."""
    f_std: float | None
    valid: bool
    bias: float
    """The bias that was subtracted, in the unit of y."""
    R: float
    """Variance of the white noise, in the square of y's unit."""
    R_from: Literal["start-up window", "setting"]
    startup_samples: int
    samples: int
    """Number of samples in the longest part without a restart, over which FLTEA was run.

    The start-up window is included.
    """
    predicted: int
    """Number of lost samples among `samples`. In place of a lost sample, FLTEA only predicts its state."""
    restarts: int
    interventions: dict[str, int]
    """For each cause, the number of samples at which the guard changed an estimate since FLTEA's last start.
    """
    alpha_drift: float | None
    """Change of α over the last third of the record: the mean of α over the second half of this third, minus
    the mean over its first half.
    """
    f_drift: float | None
    converged: bool
    """Whether α has settled: the size of `alpha_drift` is at most `alpha_std`, or at most 0.02."""
    describes_noise: bool | None
    """Whether α and f describe the noise.

    False: the innovations of the last two thirds are not white, or by the verdict the noise has no order or a
    different order. Then α, f and their standard deviations say nothing about the noise. None: too few
    innovations, or no verdict.
    """
    settings: EstimatorConfig
    """All settings of FLTEA: length of the memory, start-up, tuning."""


class FlteaAxis(NamedTuple):
    """An axis over which FLTEA is to be run.

    As in live use, FLTEA predicts lost samples, and restarts after a long gap. So FLTEA runs over the longest
    part between two such gaps.
    """

    y: Array
    """The samples of the axis, (n,)."""
    gaps: Gaps
    """The gaps between the samples."""
    config: EstimatorConfig
    """Settings of FLTEA. If `bias` and `R` are numbers, they are the values for this axis."""
    lsb: float | None
    """One count in the unit of y, if known. The variance of rounding to counts is the smallest R."""
    alpha: Interval | None
    """Order of the noise according to the verdict, with its interval; None if there is no verdict.

    The ends of the interval are null if the noise has no order.
    """

    def why_not(self, h: float) -> str:
        """Return why FLTEA cannot be run, or an empty text if it can. `h`: sampling period [s].

        Raises:
            ValueError: no filter works with the settings, or fewer than a hundred samples follow the start-up
                window.
        """
        lane = _lane(self)
        if not isinstance(lane, str):
            for variant in OTHER:
                _settings(msgspec.structs.replace(self.config, variant=variant), h, [lane.R]).table(1)
        return lane if isinstance(lane, str) else ""


class FlteaFits(NamedTuple):
    """FLTEA's estimates for one axis."""

    own: FlteaFit | None
    """FLTEA's estimates by the variant ("triple" or "joint") that the settings name. If None, `reason` says
    why.
    """
    other: FlteaFit | None
    innovations: dict[str, Innovations | None]
    """For each variant of FLTEA, the test whether the innovations of the last two thirds are white."""
    reason: str = ""


def fltea_fits(axes: Sequence[FlteaAxis], h: float) -> list[FlteaFits]:
    """Run both variants of FLTEA, "triple" and "joint", over all axes.

    The result for each axis is the same as if it were run alone.

    `h`: sampling period [s].

    Raises:
        ValueError: no filter works with the settings of an axis, or fewer than a hundred samples follow its
        start-up window.
    """
    lanes = [_lane(one) for one in axes]
    found: list[dict[Variant, tuple[FlteaFit, Innovations | None]]] = [{} for _ in axes]
    for variant in OTHER:
        for config, indices in _alike(axes, lanes, variant):
            own = [lane for index in indices if not isinstance(lane := lanes[index], str)]
            for index, lane, ran in zip(indices, own, _run(own, h, config), strict=True):
                settings = msgspec.structs.replace(axes[index].config, variant=variant)
                found[index][variant] = _fit(lane, ran, settings, axes[index].alpha), ran.tested
    fits = []
    for axis, lane, of_axis in zip(axes, lanes, found, strict=True):
        variants = axis.config.variant, OTHER[axis.config.variant]
        own_fit, other = (of_axis[one][0] if one in of_axis else None for one in variants)
        tested: dict[str, Innovations | None] = {
            one: of_axis[one][1] if one in of_axis else None for one in variants
        }
        fits.append(FlteaFits(own_fit, other, tested, lane if isinstance(lane, str) else ""))
    return fits


class _Lane(NamedTuple):
    """The input for one lane of the engine, which is one axis."""

    rest: Array
    """The samples after the start-up window, with a 0 for each lost sample."""
    missing: Mask | None
    bias: float
    R: float
    samples: int
    """Number of samples, including the start-up window but not the lost samples."""


def _lane(axis: FlteaAxis) -> _Lane | str:
    """Return the samples of an axis as the engine takes them, or a text that says why FLTEA cannot be run.

    Raises:
        ValueError: fewer than `LEAST` samples follow the start-up window, or the axis's settings of bias and
            R are not valid.
    """
    begin, end = longest_epoch(len(axis.y), axis.gaps)
    y, gaps, config = axis.y[begin:end], axis.gaps.within(begin, end), axis.config
    if len(y) < config.startup_needed + LEAST:
        raise ValueError(
            f"{len(y)} samples: the start-up window takes {config.startup_needed}, and at least {LEAST} "
            "have to follow it"
        )
    base = baseline_of(y, "axis", config, axis.lsb)
    if base.constant_axes:
        window = f"the start-up window, its first {config.startup_needed} samples"
        return f"the axis is constant in {window}"
    return _Lane(*after_startup(y, gaps, config), base.bias_dps[0], base.R[0], len(y))


def _alike(
    axes: Sequence[FlteaAxis], lanes: Sequence[_Lane | str], variant: Variant
) -> Iterator[tuple[EstimatorConfig, list[int]]]:
    """Yield each distinct set of settings of this variant, and the indices of the axes that share it.

    Axes with the same set may differ in bias and R.
    """
    groups: list[tuple[EstimatorConfig, list[int]]] = []
    for index, (axis, lane) in enumerate(zip(axes, lanes, strict=True)):
        if isinstance(lane, str):
            continue
        config = msgspec.structs.replace(axis.config, variant=variant, bias="startup", R="auto")
        for known, indices in groups:
            if type(known) is type(config) and known == config:
                indices.append(index)
                break
        else:
            groups.append((config, [index]))
    yield from groups


def _settings(config: EstimatorConfig, h: float, R: Sequence[float]) -> LaneSettings:
    return LaneSettings(config, h, np.array(R))


def _fit(lane: _Lane, ran: "_Ran", config: EstimatorConfig, order: Interval | None) -> FlteaFit:
    alpha, alpha_std, f, f_std = (_number(value) if ran.valid else None for value in ran.last)
    alpha_drift, f_drift = ran.alpha.value(), ran.f.value()
    tested = ran.tested
    white = None if tested is None else describes(tested.samples, tested.ljung_box)
    last_alpha, last_std, *_ = ran.last
    return FlteaFit(
        variant=config.variant,
        guard=config.guard,
        alpha=alpha,
        alpha_std=alpha_std,
        f=f,
        f_std=f_std,
        valid=ran.valid,
        bias=lane.bias,
        R=lane.R,
        R_from="start-up window" if config.R == "auto" else "setting",
        startup_samples=config.startup_needed,
        samples=lane.samples,
        predicted=0 if lane.missing is None else int(lane.missing.sum()),
        restarts=ran.restarts,
        interventions=ran.interventions,
        alpha_drift=alpha_drift,
        f_drift=f_drift,
        converged=alpha_drift is not None and abs(alpha_drift) <= max(alpha_std or 0.0, 0.02),
        describes_noise=describes_order(white, last_alpha, last_std, order),
        settings=config,
    )


def after_startup(y: Array, gaps: Gaps, config: EstimatorConfig) -> tuple[Array, Mask | None]:
    """Return the samples after the start-up window, and a mask of the lost samples.

    `y`: a part of the record without a restart.
    """
    return spread(y[config.startup_needed :], gaps.within(config.startup_needed, len(y)))


class _Ran:
    """The results for one lane (one axis) of n samples, collected block by block.

    Attributes:
        last: four values after the last sample: α, its standard deviation, f, and its standard deviation.
        alpha: how far α drifts over the last third of the samples.
        f: how far f drifts over the last third of the samples.
        tested: the test whether the innovations of the last two thirds are white.
    """

    def __init__(self, n: int) -> None:
        self.n, self._third = n, n // 3
        self.alpha, self.f = _Drift(n - n // 3, n), _Drift(n - n // 3, n)
        self._sums = InnovationSums()
        self.last: tuple[float, ...] = ()
        self.valid = False
        self.restarts = 0
        self.interventions: dict[str, int] = {}

    def add(self, start: int, columns: Array, *, valid: bool) -> None:
        """Add the results for the next samples, from sample `start` on.

        `columns`: the columns of `LaneBlock`. `valid`: whether the estimates at the last of these samples are
        valid.
        """
        alpha, alpha_std, f, f_std, _, innovation, innovation_std = columns
        self.alpha.add(start, alpha)
        self.f.add(start, f)
        if start + CHUNK > self._third:
            rows = slice(max(0, self._third - start), None)
            self._sums.add(innovation[rows], innovation_std[rows])
        self.last = tuple(float(column[-1]) for column in (alpha, alpha_std, f, f_std))
        self.valid = valid

    def end(self, lanes: Lanes, lane: int) -> None:
        """Store the number of restarts, and for each cause how often the guard has changed an estimate.

        The caller calls this right after the lane's last sample.
        """
        self.restarts = int(lanes.restarts[lane])
        counts = zip(CAUSES, lanes.interventions()[lane].tolist(), strict=True)
        self.interventions = {cause: n for cause, n in counts if n}

    @property
    def tested(self) -> Innovations | None:
        return self._sums.result()


def _run(own: Sequence[_Lane], h: float, config: EstimatorConfig) -> list[_Ran]:
    """Run lanes (axes) of different lengths in parallel, and return the results of each.

    After a lane's last sample the engine only predicts; these predictions are dropped.
    """
    lanes = Lanes(len(own), _settings(config, h, [one.R for one in own]))
    ran = [_Ran(len(one.rest)) for one in own]
    ends = sorted({one.n for one in ran})
    for start in range(0, ends[-1], CHUNK):
        stop = min(start + CHUNK, ends[-1])
        cuts = [start, *(end for end in ends if start < end < stop), stop]
        blocks, valid = [], {}
        for begin, end in pairwise(cuts):
            block = lanes.run(*_rows(own, begin, end))
            blocks.append(np.array(block[:7]))
            for number, one in enumerate(ran):
                if begin < one.n:
                    valid[number] = bool(block.valid[-1, number])
                if end == one.n:
                    one.end(lanes, number)
        columns = np.concatenate(blocks, axis=1) if len(blocks) > 1 else blocks[0]
        for number, one in enumerate(ran):
            if start < one.n:
                one.add(start, columns[:, : one.n - start, number], valid=valid[number])
    return ran


def _rows(own: Sequence[_Lane], begin: int, end: int) -> tuple[Array, Mask | None]:
    """Return samples begin … end - 1 of all lanes minus their biases, and a mask of missing samples."""
    y, gone = np.zeros((end - begin, len(own))), np.zeros((end - begin, len(own)), dtype=bool)
    for lane, one in enumerate(own):
        rest = one.rest[begin:end]
        y[: len(rest), lane] = rest - one.bias
        gone[len(rest) :, lane] = True
        if one.missing is not None:
            gone[: len(rest), lane] = one.missing[begin:end]
    return y, gone if gone.any() else None


class _Drift:
    """Computes how far a value drifts over samples begin … end - 1.

    The drift is the mean of the finite values in the second half minus the mean in the first half.
    """

    def __init__(self, begin: int, end: int) -> None:
        middle = begin + (end - begin) // 2
        self._halves = ((begin, middle), (middle, end))
        self._sums, self._counts = [0.0, 0.0], [0, 0]

    def add(self, start: int, values: Array) -> None:
        """Add the next values, which begin at sample `start`."""
        for i, (begin, end) in enumerate(self._halves):
            part = values[max(0, begin - start) : max(0, end - start)]
            part = part[np.isfinite(part)]
            self._sums[i] += float(part.sum())
            self._counts[i] += len(part)

    def value(self) -> float | None:
        """Return how far the value drifted; None if one half of the samples has no finite value."""
        if not all(self._counts):
            return None
        first, second = (total / count for total, count in zip(self._sums, self._counts, strict=True))
        return second - first


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
