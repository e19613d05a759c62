"""Simulate noise of known order, to try the program with."""

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
    """Simulated measurements, the true state behind them, and the parameters."""

    y: Array
    """Measurements (n,) in `unit`."""
    state: Array
    """True state (n,) in `unit`; the measurements are the state plus white noise."""
    rate_hz: float
    """Sampling rate in Hz."""
    alpha: float
    """The order α."""
    f: float
    """The parameter f of D^α x = f x + ω, in s^-α."""
    Q: float
    """Variance of the noise that drives the state, in unit² s^-2α."""
    R: float
    """Variance of the white noise, in unit²."""
    unit: str
    """Unit of the samples."""

    def identify(self) -> Identified:
        """Return the result of `fltea.identify` for y."""
        return identify(self.y, self.rate_hz, unit=self.unit)

    def to_pandas(self) -> "pd.DataFrame":
        """Return a table of y and the state, with the time in s as index.

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
    """Simulate fractional noise by the model of `fltea.noise.simulation`.

    Args:
        n: number of samples.
        rate_hz: sampling rate in Hz.
        alpha: order, below 2.
        f: parameter of D^α x = f x + ω, in s^-α, 0 or below.
        Q: variance of the noise that drives the state, in unit² s^-2α; 0: white noise alone.
        R: variance of the white noise, in unit².
        unit: unit of the samples and of Q and R, such as deg/s.
        window: length of the memory in samples.
        warmup: number of samples that are drawn first and dropped.
        seed: seed of the random generator; the same seed gives the same samples.

    Raises:
        ValueError: parameters are impossible, the unit is not known, or the noise diverges.
    """
    scale(unit)
    if n < 1:
        raise ValueError(f"n must be the number of samples to draw, 1 or more, got {n}")
    h = period_s(rate_hz)
    y, state = FractionalNoise(alpha, f, Q, R, h, window, seed, warmup=warmup).samples(n)
    return Simulated(y.copy(), state.copy(), rate_hz, alpha, f, Q, R, unit)
