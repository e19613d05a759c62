"""The tracker says what the bias of each axis is now, with its σ: the filter of the noise that was found.

The bias is the sensor's offset and the state of its noise. Until the noise is known, a bank of random walks
and relaxations stands for it (host/native/walk_bank.hpp). The samples that a filter remembers are filtered
again when the noise is found to be another one, so that the state is that of the newest model from then on.
Where a sensor is moved, it predicts.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from fltea import _native
from fltea.noise.system import System
from fltea.records.arrays import Array, Mask


class Tracks(NamedTuple):
    """What is known after every sample, (n, axes); NaN where nothing is yet."""

    state: Array
    state_std: Array
    bias: Array
    """offset and state"""
    bias_std: Array
    innovation: Array
    """measurement minus prediction"""
    moving: Mask


class TrackerFigures(NamedTuple):
    """How the tracker of an axis gets on; figures of innovations are None before there are enough."""

    moved: int
    """samples in motion"""
    begun: int
    """how often it began again, at an offset that had changed"""
    lag1: float | None
    nis: float | None
    ljung_box: float | None
    innovations: int


class Remembered:
    """What a tracker remembers of the samples of an axis, as it was; it may be asked in any thread."""

    def __init__(self, native: _native.Remembered) -> None:
        self._native = native

    def likelihood(self, system: System) -> float:
        """Return 2 log L of them with such a noise, but for a constant; NaN without a filter.

        Raises ValueError for what is no system.
        """
        return self._native.likelihood(*_numbers(system))

    def likelihoods(self, system: System, steps: Array) -> Array:
        """Return the same for each variance of a step of the last coordinate, (n,)."""
        return np.array(self._native.likelihoods(steps.tolist(), *_numbers(system)))

    def likelihood_of_walks(self) -> float:
        """Return the same of the bank of walks; NaN before it knew enough, and once a system was set."""
        return self._native.of_walks()


class Tracker:
    """Tracks the biases of the axes of one sensor.

    offsets: what the sensor adds to each axis, None where that is not known.
    """

    def __init__(self, offsets: Sequence[float | None]) -> None:
        self.native = _native.Tracker(list(offsets))

    def run(self, y: ArrayLike) -> Tracks:
        """Take n samples of every axis, (n, axes): the same, to the bit, however they are cut into blocks.

        Raises ValueError, and changes nothing, for a wrong shape, and for numbers that are not finite or
        beyond all measure.
        """
        rows = np.ascontiguousarray(y, dtype=np.float64)
        out, moving = np.empty((5, *rows.shape)), np.empty(rows.shape, dtype=np.uint8)
        self.native.run(rows, out, moving)
        return Tracks._make((*out, moving.view(np.bool_)))

    def skip(self, count: int) -> None:
        """Predict over lost samples of all axes."""
        self.native.skip(count)

    def set(self, lane: int, system: System) -> None:
        """Take this for the noise of an axis, from the next sample on.

        Raises ValueError, and changes nothing, if no filter can work with it.
        """
        self.native.set(lane, system.walks, *_numbers(system))

    def remembered(self, lane: int) -> Remembered:
        """Return what it remembers of the samples of an axis, as it is now."""
        return Remembered(self.native.remembered(lane))

    def x(self, lane: int) -> tuple[float, Array]:
        """Return where the numbers of an axis begin, and from there x of its system after the newest sample.

        Without a system there are no coordinates.
        """
        origin, x = self.native.x(lane)
        return origin, np.array(x)

    def figures(self) -> list[TrackerFigures]:
        """Tell how each axis gets on."""
        found = []
        for moved, begun, lag1, nis, ljung_box, n in self.native.stats():
            known = (x if math.isfinite(x) else None for x in (lag1, nis, ljung_box))
            found.append(TrackerFigures._make((moved, begun, *known, n)))
        return found

    def save(self) -> bytes:
        """Return what `load` takes."""
        return self.native.save()

    def load(self, saved: bytes) -> None:
        """Go on from there. Raises ValueError, and changes nothing, for what cannot be one's own."""
        self.native.load(saved)


def _numbers(s: System) -> tuple[int, Array, Array, Array, Array, Array, Array, Array, float]:
    return s.pairs, s.a, s.b, s.Q, s.c, s.signal * s.c, s.bias, s.P0, s.R
