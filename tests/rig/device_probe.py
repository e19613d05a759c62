"""Run the board's estimator, compiled for this computer, from Python.

There is a library for each variant of the estimator (tests/native/device_probe.cpp).
"""

import ctypes
import weakref
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from fltea.estimator.engine import Engine
from fltea.estimator.lane_settings import LaneSettings
from fltea.records.arrays import Array
from fltea.settings.estimator import EstimatorConfig
from fltea.wire.layout import Estimate
from numpy.typing import ArrayLike

from tests.rig.built import BYTES, COUNTS, DOUBLES, probe

VARIANTS = ("joint", "triple")
FIELDS = Estimate._fields[: Estimate._fields.index("tracker_bias")]
"""Fields of ESTIMATE that the estimator fills. The other fields are those of the bias tracker
(tests/rig/spectrum_probe.py).
"""


class Baseline(NamedTuple):
    """Bias of an axis and the variance R of its measurement, both from the board's start-up window (its first
    samples), and the number of restarts of the axis's filters.
    """

    bias_dps: float
    R: float
    restarts: int


@lru_cache
def library(variant: str) -> ctypes.CDLL:
    """Load the library of one variant; build it first if it is out of date."""
    size, pointer = ctypes.c_size_t, ctypes.c_void_p
    return probe(
        f"device_probe-{variant}",
        ("device_startup", ctypes.c_int),
        ("device_lsb_per_dps", ctypes.c_double),
        ("device_make", pointer),
        ("device_free", None, pointer),
        ("device_run", size, pointer, size, COUNTS, BYTES, DOUBLES),
        ("device_baseline", None, pointer, DOUBLES),
    )


STARTUP = library("joint").device_startup()
LSB_PER_DPS = library("joint").device_lsb_per_dps()


class Device:
    """The board's estimator for one axis."""

    def __init__(self, variant: str) -> None:
        self._library = library(variant)
        self._device = self._library.device_make()
        weakref.finalize(self, self._library.device_free, self._device)

    def run(self, counts: ArrayLike, missing: ArrayLike | None = None) -> dict[str, Array]:
        """Process samples, the oldest first; return the fields of ESTIMATE after each sample.

        Samples in the start-up window give no row of fields.
        """
        counts = np.ascontiguousarray(counts, dtype=np.int16)
        lost = np.zeros(len(counts), np.uint8) if missing is None else np.asarray(missing, dtype=np.uint8)
        rows = np.empty((len(counts), len(FIELDS)))
        made = self._library.device_run(self._device, len(counts), counts, lost, rows)
        return dict(zip(FIELDS, rows[:made].T, strict=True))

    @property
    def baseline(self) -> Baseline:
        out = np.empty(3)
        self._library.device_baseline(self._device, out)
        return Baseline(float(out[0]), float(out[1]), int(out[2]))


def host_engine(variant: str, R: float) -> Engine:
    """Return the host's estimator in double precision for one axis, with the device's settings and unlimited
    memory.
    """
    return Engine(
        1,
        LaneSettings(
            EstimatorConfig(window=0, variant=variant, guard="consistent"),  # type: ignore[arg-type]
            h=0.01,
            R=R,
            accuracy=9,
        ),
    )


def host_baseline(counts: ArrayLike) -> tuple[float, float]:
    """Return bias and variance R of the samples of a start-up window in double precision.

    R is at least the variance of rounding to counts.
    """
    window = np.asarray(counts) / LSB_PER_DPS
    return float(window.mean()), max(float(window.var(ddof=1)), 1 / LSB_PER_DPS**2 / 12)
