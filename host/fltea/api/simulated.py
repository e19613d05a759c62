"""Noise of known order, to try things on."""

from typing import TYPE_CHECKING

import msgspec
import numpy as np

from fltea.api._check import period_s, scale
from fltea.api._tables import columns
from fltea.api.identified import Identified
from fltea.api.series import identify
from fltea.noise.simulation import FractionalNoise
from fltea.records.arrays import Array

if TYPE_CHECKING:
    import pandas as pd


class Simulated(msgspec.Struct, frozen=True):
    """Measurements, the true state behind them, and what they were made with."""

    y: Array
    """Measurements (n,) in `unit`."""
    state: Array
    """The state (n,) in `unit`, which the measurements have white noise on."""
    rate_hz: float
    """Sample rate in Hz."""
    alpha: float
    """The order."""
    f: float
    """The parameter, in s^-α."""
    Q: float
    """The strength of what drives the state, in unit² s^-2α."""
    R: float
    """The variance of the white noise, in unit²."""
    unit: str
    """The unit of the samples."""

    def identify(self) -> Identified:
        """Return what `fltea.identify` says of y."""
        return identify(self.y, self.rate_hz, unit=self.unit)

    def to_pandas(self) -> "pd.DataFrame":
        """Return a table of y and the state over the time in s.

        Raises:
            UsageError: pandas is not installed.
        """
        return columns({"y": self.y, "state": self.state}, np.arange(len(self.y)) / self.rate_hz)


def simulate(
    n: int,
    rate_hz: float = 100.0,
    *,
    alpha: float,
    f: float,
    Q: float,
    R: float,
    unit: str,
    window: int = 3000,
    warmup: int = 3000,
    seed: int = 0,
) -> Simulated:
    """Draw fractional noise; the model is that of `fltea.noise.simulation`.

    Args:
        n: samples.
        rate_hz: sample rate in Hz.
        alpha: order, below 2.
        f: parameter, in s^-α, 0 or below.
        Q: strength of what drives the state, in unit² s^-2α; 0: white noise alone.
        R: variance of the white noise, in unit².
        unit: of the samples that are drawn, such as deg/s: that in which Q and R are given.
        window: samples of memory.
        warmup: samples that are thrown away first.
        seed: equal ones give equal samples.

    Raises:
        ValueError: impossible parameters, a unit that is not known, or noise that runs away.
    """
    scale(unit)
    if n < 1:
        raise ValueError(f"n is how many samples to draw, 1 or more, got {n}")
    h = period_s(rate_hz)
    y, state = FractionalNoise(alpha, f, Q, R, h, window, seed, warmup=warmup).samples(n)
    return Simulated(y.copy(), state.copy(), rate_hz, alpha, f, Q, R, unit)
