"""Whether a fitted spectrum has a peak that the data have too, and so is a resonance (pure)."""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from fltea.noise import spectra as spectrum
from fltea.noise.distributions import f_deviate
from fltea.spectrum.periodogram import Binned

Array = NDArray[np.float64]

LEAST_HEIGHT = 1.2
"""The least height of the peak over frequency 0: a pole pair without one is a low-pass."""
LEAST_DEVIATE = 3.0
"""The least deviate of the data about the peak from those at half its frequency and below: p = 1e-3."""
POINTS = 2049


def peak_of(data: Binned, density: Callable[[Array], Array], h: float) -> dict[str, float]:
    """Return the frequency of a spectrum's peak, and its height over that at 0; h is the period in s.

    Nothing if it has none, or if the one series of `data` does not show it.
    """
    lam = np.linspace(1e-6, np.pi, POINTS)
    found = density(lam)
    top = int(found.argmax())
    height = float(found[top] / found[0])
    if not 0 < top < POINTS - 1 or height < LEAST_HEIGHT:
        return {}
    about = density(data.lam) > (found[top] + found[0]) / 2
    below = data.lam < lam[top] / 2
    weights = [float(data.counts[part].sum()) for part in (about, below)]
    if min(weights) < 2:
        return {}
    means = [float(np.average(data.power[0][part], weights=data.counts[part])) for part in (about, below)]
    ratio = means[0] / max(means[1], 1e-300)
    if f_deviate(ratio, 2 * weights[0], 2 * weights[1]) < LEAST_DEVIATE:
        return {}
    return {"resonance_hz": float(lam[top]) / (2 * math.pi * h), "height": height}


def pole_pair(data: Binned, phi1: float, phi2: float, h: float) -> dict[str, float]:
    """Return the peak of AR(2), or where it has fallen by half (bend_hz); nothing if it rises; h in s."""
    if found := peak_of(data, lambda lam: spectrum.ar2(lam, phi1, phi2), h):
        return found
    lam = np.linspace(1e-6, np.pi, POINTS)
    density = spectrum.ar2(lam, phi1, phi2)
    below = np.flatnonzero(density < density[0] / 2)
    falls = density[-1] < density[0]
    return {"bend_hz": float(lam[below[0]]) / (2 * math.pi * h)} if len(below) and falls else {}
