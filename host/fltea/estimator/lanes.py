"""Lanes under the supervisor are what daemon, identify and evaluate all run.

Engine, supervisor and restarts are one native call for a whole block (host/native/lanes.hpp). The rules of
the supervisor are in firmware/core/engine/supervisor.hpp, for the board too.
"""

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fltea import _native
from fltea.estimator.engine import as_rows, instruction_sets, interventions_of
from fltea.estimator.lane_settings import LaneSettings
from fltea.records.arrays import Array, Mask

LOST_ORDER = _native.LOST_ORDER
"""An order beyond ± this is a runaway."""

BOUND_SAMPLES = _native.BOUND_SAMPLES
BOUND_SHARE = _native.BOUND_MOST / _native.BOUND_SAMPLES
"""A lane whose state the guard held in more than this share of the last `BOUND_SAMPLES` is not valid."""

Reason = Literal["runaway", "bound"]


class Lost(NamedTuple):
    """Tells with which row a lane has become invalid, and why."""

    row: int
    lane: int
    reason: Reason


class LaneBlock(NamedTuple):
    """Holds estimates after every sample; columns are (n, lanes), and NaN where a lane is not valid."""

    alpha: Array
    alpha_std: Array
    """the filter's own"""
    f: Array
    """in s^-α"""
    f_std: Array
    x: Array
    """posterior state"""
    innovation: Array
    """measurement minus prediction; NaN where the sample is missing, too"""
    innovation_std: Array
    valid: Mask
    lost: list[Lost]
    """row after row"""
    white: Mask | None
    """of a bank: the innovations are white, as of the last hundred that were full"""


class Lanes:
    """Runs any number of lanes of the estimator, all of one variant, guard and memory.

    A lane that the supervisor gives up begins again with the next sample. Raises ValueError for settings
    that no filter can work with. Calls from several threads wait for each other.
    """

    def __init__(self, lanes: int, settings: LaneSettings, *, instruction_set: str | None = None) -> None:
        self.lanes = lanes
        table = settings.table(lanes)
        self._native = _native.Lanes(*settings.native(instruction_set or instruction_sets()[0], table))

    def run(self, y: ArrayLike, missing: ArrayLike | None = None) -> LaneBlock:
        """Take n samples of every lane, (n, lanes): the same, to the bit, however they are cut into blocks.

        `missing`, of the same shape, marks lanes without a measurement, which make a prediction-only step;
        their y is ignored. Raises ValueError, and changes nothing, for wrong shapes and for numbers that are
        not finite or beyond ±LARGEST_INPUT.
        """
        measured, _, gone = as_rows(self.lanes, y, None, missing)
        out = np.empty((7, *measured.shape))
        valid = np.empty(measured.shape, dtype=bool)
        lost = self._native.run(measured, gone, out, valid.view(np.uint8))
        return LaneBlock._make((*out, valid, [Lost(*one) for one in lost], None))

    @property
    def restarts(self) -> NDArray[np.int64]:
        """Tell how often each lane had to begin again, (lanes,)."""
        return np.array(self._native.restarts(), dtype=np.int64)

    def interventions(self) -> NDArray[np.int32]:
        """Return how often the guard stepped in, (lanes, len(CAUSES)), since the last start of each lane."""
        return interventions_of(self._native, self.lanes)
