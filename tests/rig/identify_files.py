"""Helpers for the tests of `fltea identify`: recordings of white noise, and settings that save time."""

import os
from pathlib import Path
from typing import Any

import numpy as np
from fltea.identification.axis import AxisResult, IdentifyOptions, analyse, identified
from fltea.identification.gaps import Gaps
from fltea.identification.settings import Settings
from fltea.settings.estimator import AccelConfig, EstimatorConfig

from tests.rig.identify_support import white

RATE_HZ, LSB_PER_DPS = 100.0, 131.0
QUICK = EstimatorConfig(window=100, startup=100)


def settings(shuffles: int = 4, figures: bool = False) -> Settings:
    return Settings(
        IdentifyOptions(shuffles=shuffles), QUICK, AccelConfig(window=100, startup=100), figures=figures
    )


def counts(n: int, axes: int = 3, seed: int = 1) -> np.ndarray:
    """Return white noise of σ 16 LSB with an offset, an array of shape (n, axes)."""
    return np.rint(16 * white(n, axes, seed).T + 40).astype(np.int32)


def npz(path: Path, raw: np.ndarray, **extra: object) -> Path:
    np.savez(path, gyro_raw=raw, lsb_per_dps=LSB_PER_DPS, fs_hz=RATE_HZ, **extra)
    return path


class Deadly:
    """An object that a test sends to another process in place of a path. It kills the process that receives
    it, at the first `times` attempts.

    The receiver dies when it unpickles the object. The sender only pickles it, and so survives.
    """

    def __init__(self, path: Path, mark: Path, times: int) -> None:
        self.path, self.mark, self.times = path, mark, times

    def __str__(self) -> str:
        return str(self.path)

    def __reduce__(self) -> tuple[object, ...]:
        return _die, (self.path, self.mark, self.times)


def _die(path: Path, mark: Path, times: int) -> Path:
    with mark.open("a") as file:
        file.write("x")
    if len(mark.read_text()) <= times:
        os._exit(1)
    return path


def identify_axis(
    y: Any,
    h: float,
    lsb: float | None = None,
    options: IdentifyOptions | None = None,
    gaps: Gaps | None = None,
) -> AxisResult:
    """Return the identification of one axis, without FLTEA's estimates of shuffled copies of the samples."""
    return identified(analyse(y, h, options, gaps), lsb, options)
