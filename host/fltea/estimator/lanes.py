"""Run lanes (independent filters). The supervisor of a lane restarts the lane when its filter diverges.

The live program, identification and evaluation use this module.

Engine, supervisor and restarts are one native call for a whole block (host/native/lanes.hpp). The
supervisor's rules, which the board uses too, are in firmware/core/engine/supervisor.hpp.
"""

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fltea import _native
from fltea.estimator.engine import as_rows, instruction_sets, interventions_of
from fltea.estimator.lane_settings import LaneSettings
from fltea.records.arrays import Array, Mask

LOST_ORDER = _native.LOST_ORDER
"""Absolute value of the order α beyond which an estimate counts as diverged."""

BOUND_SAMPLES = _native.BOUND_SAMPLES
BOUND_SHARE = _native.BOUND_MOST / _native.BOUND_SAMPLES
"""A lane (the filters of one axis) becomes invalid if the guard had to bound its state at more than this
fraction of the last `BOUND_SAMPLES` samples.
"""

Reason = Literal["runaway", "bound"]


class Lost(NamedTuple):
    """A lane (axis) that became invalid: the row (sample) at which this happened, and the reason."""

    row: int
    lane: int
    reason: Reason


class LaneBlock(NamedTuple):
    """The estimates of each lane (axis) after every sample, (n, lanes); NaN where a lane is not valid."""

    alpha: Array
    alpha_std: Array
    """Standard deviation of α, as the filter computes it."""
    f: Array
    """Parameter f in s^-α."""
    f_std: Array
    x: Array
    """Posterior state."""
    innovation: Array
    """Measurement minus prediction; NaN also for a missing sample."""
    innovation_std: Array
    valid: Mask
    lost: list[Lost]
    """Lanes that became invalid, the earliest first."""
    white: Mask | None
    """After every sample, whether the newest complete group of 100 innovations is white. None if the block is
    not from a `Bank`.
    """


class Lanes:
    """Runs any number of lanes (independent filters), all of one variant, guard and memory.

    A lane that the supervisor declares invalid restarts with the next sample. Raises ValueError for settings
    that no filter works with. Calls from several threads wait for each other.
    """

    def __init__(self, lanes: int, settings: LaneSettings, *, instruction_set: str | None = None) -> None:
        self.lanes = lanes
        table = settings.table(lanes)
        self._native = _native.Lanes(*settings.native(instruction_set or instruction_sets()[0], table))

    def run(self, y: ArrayLike, missing: ArrayLike | None = None) -> LaneBlock:
        """Process n samples of every lane, (n, lanes).

        The results do not depend on how samples are grouped into blocks.

        `missing`, of the same shape, marks samples without a measurement. There a lane only predicts, and its
        y is ignored. Raises ValueError, and changes nothing, for wrong shapes and for numbers that are not
        finite or beyond ±LARGEST_INPUT.
        """
        measured, _, gone = as_rows(self.lanes, y, None, missing)
        out = np.empty((7, *measured.shape))
        valid = np.empty(measured.shape, dtype=bool)
        lost = self._native.run(measured, gone, out, valid.view(np.uint8))
        return LaneBlock._make((*out, valid, [Lost(*one) for one in lost], None))

    @property
    def restarts(self) -> NDArray[np.int64]:
        """Number of restarts of each lane (axis), (lanes,)."""
        return np.array(self._native.restarts(), dtype=np.int64)

    def interventions(self) -> NDArray[np.int32]:
        """Return the number of interventions since the last start of each lane, (lanes, len(CAUSES))."""
        return interventions_of(self._native, self.lanes)
