"""Bias at rest by other methods: VQF, imufusion and means.

Each method is a function that takes rates (n, 3) [deg/s] and returns biases (n, 3) [deg/s].

VQF and imufusion use their default settings and start with a bias of 0.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from fltea.records.arrays import Array
from fltea.settings.extras import load

from tools.validation.bias.noises import H

GRAVITY, ACCEL_SIGMA = 9.81, 0.02
"""Acceleration, and standard deviation of the accelerometer's noise, which VQF needs [m/s²]. With these
values the simulated sensor lies flat and still.
"""
AT_ONCE = 20_000
"""Number of samples for which VQF returns its whole state in one call."""
MEAN_S = 10.0


def need_peers() -> None:
    """Check that the peers (other methods of estimating the bias) are installed, before anything is computed.

    Raises:
        UsageError: a peer is not installed; the message says how to install it.
    """
    _library("vqf")
    _library("imufusion")


def _library(name: str) -> Any:
    return load(name, name, "validation", "the peers of `bias` need")


def vqf(y: Array) -> Array:
    """Return the bias by VQF (Laidig & Seel, 2023).

    At rest, VQF estimates the bias from the rates. In motion, it also uses gravity.
    """
    rng = np.random.default_rng(20261126)
    accel = rng.normal((0.0, 0.0, GRAVITY), ACCEL_SIGMA, y.shape)
    rates, it = np.ascontiguousarray(np.radians(y)), _library("vqf").VQF(H)
    pieces = [
        it.updateBatchFullState(rates[begin : begin + AT_ONCE], accel[begin : begin + AT_ONCE])["bias"]
        for begin in range(0, len(y), AT_ONCE)
    ]
    return np.asarray(np.degrees(np.concatenate(pieces)))


def imufusion(y: Array) -> Array:
    """Return the offset that imufusion's `Bias` (x-io's Fusion) computes.

    The offset is the output of a low-pass filter for the rates, which runs while all rates stay small.
    """
    library = _library("imufusion")
    it, settings = library.Bias(), library.BiasSettings()
    settings.sample_rate = 1 / H
    it.set_settings(settings)
    found = np.empty_like(y)
    for k, rates in enumerate(y):
        it.update(rates)
        found[k] = it.get_offset()
    return found


def running_mean(y: Array) -> Array:
    """Return the mean of all samples so far."""
    return np.asarray(np.cumsum(y, axis=0) / np.arange(1, len(y) + 1)[:, np.newaxis])


def short_mean(y: Array) -> Array:
    """Return the mean of the last MEAN_S seconds."""
    n = round(MEAN_S / H)
    sums = np.cumsum(y, axis=0)
    sums[n:] -= sums[:-n].copy()
    return np.asarray(sums / np.minimum(np.arange(1, len(y) + 1), n)[:, np.newaxis])


PEERS: dict[str, Callable[[Array], Array]] = {
    "VQF": vqf,
    "imufusion": imufusion,
    "running mean": running_mean,
    f"{MEAN_S:g} s mean": short_mean,
}
