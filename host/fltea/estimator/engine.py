"""Run FLTEA for one state in many lanes at once, natively (Macias & Sierociuk 2023, section 5).

A lane is one independent system: an axis, a sensor, a copy whose samples were shuffled for comparison, or
another set of settings. Its equations:

    x_k = h^α (f x_{k-1} + u_{k-1}) - sum_{j=1}^{L(k)} c_j(α) x_{k-j} + noise of variance Q
    y_k = x_k + noise of variance R

Here c_j(α) = (-1)^j binom(α, j), and L(k) is the number of past samples in the memory. y and x are in deg/s,
the sampling period h in s, f in s^-α. Q is the variance of what the noise adds in one step, so it already
contains the factor h^2α. Lanes never influence each other. Their results depend neither on the number of
lanes nor on the width of the instruction set.

Variants: "triple" is the variant of the paper (equal to `reference` except for rounding), with the filters
KFx for the state, KFo for the order and KFw for the parameter. "joint" has one unscented filter on (α, β =
h^α f) instead of KFo and KFw.

Guards: "off" is the algorithm as printed in the paper. It can diverge: its results are then not finite, or
absurdly large, and no error is raised. "faithful" is the printed algorithm within bounds: as long as no bound
is reached, its results are those of "off", bit by bit. "consistent" has the same bounds. In addition, the
measurement variance of KFo, KFw and the joint filter includes the variance of the estimated state, which the
paper treats as exact. With both guards, whatever the input, every estimate stays finite, 0 <= α <= 2,
-2·2^α <= h^α f <= 1, and |y - x| <= 4 sqrt(R) after each measurement. Every intervention is counted
(`CAUSES`).

A compressed memory replaces the older states by decaying sums of them, which takes less time. It replaces an
order outside [-1.95, 4] by the nearest order inside. This is counted as "memory_order", and can occur only
with guard "off".
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fltea import _native
from fltea.estimator.lane_settings import LaneSettings, native_table
from fltea.records.arrays import Array
from fltea.records.stats import CAUSE_WORDS

CAUSES = tuple(CAUSE_WORDS)
"""Causes of interventions, in the order of `Estimates.interventions`.

In an intervention, a limit changes an estimate, which then differs from that of the algorithm as printed in
the paper. The joint filter estimates α and h^α f together (variant "joint").

- order_box: α left [0, 2].
- order_sigma: a sigma point of α left [-1/2, 5/2].
- order_variance: the predicted variance of α exceeded 1/3.
- order_gate: the innovation of the filter of α, or of the joint filter, exceeded the setting `gate`, which is
  in standard deviations.
- parameter_box: h^α f left its bounds, because the filter of f found a new f, or because α changed.
- parameter_variance: the predicted variance of h^α f exceeded a third of the square of its range.
- parameter_gate: the innovation of the filter of f exceeded the setting `gate`.
- state_bound: the innovation of the state's filter exceeded 4 standard deviations, or a prediction over
  missing samples exceeded all earlier values tenfold.
- memory_order: the compressed memory received an order beyond its range, and used the nearest order inside
  (with guard "off" only).
"""

LARGEST_INPUT = _native.LARGEST_INPUT
"""Largest absolute value of measurements and inputs: sums of the squares of larger values overflow a
float.
"""


class Estimates(NamedTuple):
    """The estimates of each lane after every sample; arrays are (lanes,) from `step`, (n, lanes) from `run`.

    A lane is an axis, or another independent system.
    """

    alpha: Array
    alpha_var: Array
    """Variance of α, as the filter computes it."""
    f: Array
    """Parameter f in s^-α. Variant "joint" estimates β = h^α f, so f = β / h^α (h: sampling period)."""
    f_var: Array
    """Variance of f. With variant "joint" it is the first-order approximation from the covariance of α and
    h^α f.
    """
    x: Array
    """Posterior state."""
    P: Array
    """Variance of the posterior state."""
    innovation: Array
    """Measurement minus prediction; NaN without a measurement."""
    innovation_var: Array
    interventions: NDArray[np.int32]
    """Number of samples at which a limit changed an estimate, since the filters of the lane (axis) last
    started, by cause (`CAUSES`). The shape is always (lanes, len(CAUSES)).
    """


def instruction_sets() -> list[str]:
    """Return the names of the instruction sets that this processor can run, the best first."""
    return _native.instruction_sets()


def as_rows(
    lanes: int, y: ArrayLike, u: ArrayLike | None, missing: ArrayLike | None
) -> tuple[Array, Array | None, NDArray[np.uint8] | None]:
    """Return samples, inputs and marks of missing samples in the form for the native code, all (n, lanes).

    Raises:
        ValueError: an array has another shape.
    """
    measured = np.ascontiguousarray(y, dtype=np.float64)
    if measured.ndim != 2 or measured.shape[1] != lanes:
        raise ValueError(f"y must have {lanes} lanes in its last axis, got shape {np.shape(y)}")
    drive = None if u is None else np.ascontiguousarray(u, dtype=np.float64)
    gone = None if missing is None else np.ascontiguousarray(missing, dtype=bool).view(np.uint8)
    for name, array in (("u", drive), ("missing", gone)):
        if array is not None and array.shape != measured.shape:
            raise ValueError(f"{name} must have y's shape {measured.shape}, got {array.shape}")
    return measured, drive, gone


def interventions_of(native: _native.Engine | _native.Lanes | _native.Bank, lanes: int) -> NDArray[np.int32]:
    """Return the number of samples at which a limit changed an estimate, (lanes, len(CAUSES)).

    Each lane counts from its last start.
    """
    counts = np.empty((lanes, len(CAUSES)), dtype=np.int32)
    native.counts(counts)
    return counts


class Engine:
    """Runs any number of lanes of the estimator, all of one variant, guard and memory.

    `instruction_set`: one of `instruction_sets()`, by default the first. Results of different instruction
    sets differ by rounding. Raises ValueError for settings that no filter works with. Calls from several
    threads wait for each other.
    """

    def __init__(self, lanes: int, settings: LaneSettings, *, instruction_set: str | None = None) -> None:
        self.lanes = lanes
        self.settings = settings
        self.instruction_set = instruction_set or instruction_sets()[0]
        self._native = _native.Engine(*settings.native(self.instruction_set, settings.table(lanes)))

    def step(self, y: ArrayLike, u: ArrayLike | None = None, missing: ArrayLike | None = None) -> Estimates:
        """Process one sample of every lane: the measurement y and the input u (default 0), both (lanes,).

        `missing` (lanes,): marks lanes without a measurement. Such a lane only predicts, and its y is
        ignored. Raises ValueError, and changes nothing, for wrong shapes and for numbers that are not finite
        or beyond ±LARGEST_INPUT.
        """
        one = self.run(
            np.asarray(y)[np.newaxis],
            None if u is None else np.asarray(u)[np.newaxis],
            None if missing is None else np.asarray(missing)[np.newaxis],
        )
        return Estimates._make((*(column[0] for column in one[:-1]), one.interventions))

    def run(self, y: ArrayLike, u: ArrayLike | None = None, missing: ArrayLike | None = None) -> Estimates:
        """Process n samples of every lane; all arguments are (n, lanes).

        The results equal those of n calls of `step`, bit by bit.
        """
        measured, drive, gone = as_rows(self.lanes, y, u, missing)
        out = np.empty((8, *measured.shape))
        self._native.run(measured, drive, gone, out)
        return Estimates._make((*out, self.interventions()))

    def interventions(self) -> NDArray[np.int32]:
        """Return the counts of `interventions_of` for this engine, (lanes, len(CAUSES))."""
        return interventions_of(self._native, self.lanes)

    def retune(self, settings: LaneSettings) -> None:
        """Use other settings from the next sample on, also for later restarts of lanes.

        The lanes keep their states and memory. Raises ValueError, and changes nothing, for invalid settings,
        and if window, memory, accuracy, variant or guard differ from the present ones.
        """
        if settings.kind != self.settings.kind:
            raise ValueError("window, memory, accuracy, variant and guard of an engine cannot change")
        self._native.retune(native_table(settings.table(self.lanes)))
        self.settings = settings

    def reset(self, mask: ArrayLike | None = None) -> None:
        """Restart the lanes in `mask` (lanes,), by default all lanes.

        Restarted lanes begin with the initial estimates and an empty memory.
        """
        flags = np.ones(self.lanes, dtype=bool) if mask is None else np.ascontiguousarray(mask, dtype=bool)
        if flags.shape != (self.lanes,):
            raise ValueError(f"mask must have shape ({self.lanes},), got {flags.shape}")
        self._native.reset(flags.view(np.uint8))

    @property
    def storage_bytes(self) -> int:
        """Size of the working memory [bytes], including that of the unused lanes of the last SIMD vector."""
        return self._native.storage_bytes
