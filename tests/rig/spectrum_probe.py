"""Run the board's running spectrum, its fit and its tracker from Python (tests/native/spectrum_probe.cpp)."""

import ctypes
import re
import weakref
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tests.rig.built import COUNTS, DOUBLES, probe


class BoardFit(NamedTuple):
    """The board's fit of an axis, with the fields of FitFigures in firmware/core/engine/fit_memory.hpp."""

    verdict: float
    """0: none, 1: white, 2: fractional, 3: a relaxation describes the noise as well as an order does"""
    alpha: float
    alpha_std: float
    g: float
    s2: float
    R: float
    ratio_white: float
    ratio_ar1: float
    ordinates: float
    alpha_defined: float
    evaluations: float


def board_quantile(level: int, ordinates: float) -> float:
    """Return the limit of the board's null test, which asks whether white noise alone describes the samples.

    `level`: the significance level: 0 means 5 %, 1 means 1 %, 2 means 0.1 %.
    """
    header = Path(__file__).parents[2] / "firmware/core/engine/null_quantiles.hpp"
    rows = re.findall(r"\{(-?[\d.]+)f, (-?[\d.]+)f, (-?[\d.]+)f\}", header.read_text(encoding="utf-8"))
    return float(np.polyval([float(c) for c in reversed(rows[level])], np.log10(ordinates)))


@lru_cache
def library() -> ctypes.CDLL:
    """Load the probe; build it first if it is out of date."""
    size, pointer = ctypes.c_size_t, ctypes.c_void_p
    return probe(
        "spectrum_probe",
        ("spectrum_make", pointer, ctypes.c_int),
        ("spectrum_free", None, pointer),
        ("spectrum_add", None, pointer, size, COUNTS),
        ("spectrum_skip", None, pointer, size),
        ("spectrum_fit", None, pointer, DOUBLES),
        ("spectrum_retrack", None, pointer),
        ("spectrum_design", None, pointer, DOUBLES),
        ("spectrum_track", None, ctypes.POINTER(pointer), ctypes.c_int, size, COUNTS, DOUBLES),
        ("spectrum_lose", None, pointer, size),
    )


class BoardSpectrum:
    """The board's spectrum, fit and tracker of one axis.

    `ahead`: number of future samples over which the bias is averaged; 0 means the present bias.
    """

    def __init__(self, ahead: int = 0) -> None:
        self._axis = library().spectrum_make(ahead)
        weakref.finalize(self, library().spectrum_free, self._axis)

    def add(self, counts: NDArray[np.int16]) -> None:
        library().spectrum_add(self._axis, len(counts), np.ascontiguousarray(counts))

    def skip(self, lost: int) -> None:
        """Notify the spectrum that `lost` samples are missing before the next sample."""
        library().spectrum_skip(self._axis, lost)

    def fit(self) -> BoardFit:
        """Return the board's fit of the samples so far. The next fit starts from this fit's parameters."""
        out = np.empty(len(BoardFit._fields))
        library().spectrum_fit(self._axis, out)
        return BoardFit(*out.tolist())

    def retrack(self) -> None:
        """Let the tracker use the last fit for the next samples."""
        library().spectrum_retrack(self._axis)

    def track_by(self, verdict: int, *numbers: float) -> None:
        """Let the tracker use given parameters for the next samples.

        `numbers`: for a fractional noise, α, g = h^α f (h: sampling period), the variance of the noise ω that
        drives it, and the variance R of the white noise. For a relaxation, 1 - φ (φ: correlation of two
        neighbouring samples), the variance of the relaxation, and R.
        """
        given = np.array([verdict, *numbers, *[0.0] * (4 - len(numbers))])
        library().spectrum_design(self._axis, given)

    def track(self, counts: NDArray[np.int16]) -> NDArray[np.float64]:
        """Track the bias over samples in counts.

        Return an array of shape (n, 4). After each sample it has the bias, the bias's standard deviation, the
        state and the state's standard deviation.
        """
        return track_sensor([self], counts[:, None])[0][:, 0]

    def lose(self, lost: int) -> None:
        """Notify the tracker that `lost` samples are missing before the next sample."""
        library().spectrum_lose(self._axis, lost)


def track_sensor(
    axes: Sequence[BoardSpectrum], counts: NDArray[np.int16]
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Track the bias of all axes of a sensor. `counts`: its samples, of shape (n, axes).

    Returns:
        Two arrays. The first has the shape (n, axes, 4): after each sample, the bias, the bias's standard
        deviation, the state, and the state's standard deviation. The second has the shape (n,): whether the
        sensor is in motion.
    """
    n, k = counts.shape
    out = np.empty((n, k, 5))
    handles = (ctypes.c_void_p * k)(*(axis._axis for axis in axes))
    library().spectrum_track(handles, k, n, np.ascontiguousarray(counts, dtype=np.int16), out)
    return out[:, :, :4], out[:, 0, 4] > 0
