"""Whether a fitted spectrum has a peak, and so is a resonance, or falls as behind a low-pass (pure)."""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from fltea.noise import spectra as spectrum

Array = NDArray[np.float64]

LEAST_HEIGHT = 1.2
"""Of the peak of a resonance over frequency 0: a pole pair without one is a low-pass."""
POINTS = 2049


def peak_of(density: Callable[[Array], Array], h: float) -> dict[str, float]:
    """Where a spectrum of λ has a peak (resonance_hz), and how high it is over frequency 0 (height); h in s.

    Nothing if it has none.
    """
    lam = np.linspace(1e-6, np.pi, POINTS)
    found = density(lam)
    top = int(found.argmax())
    height = float(found[top] / found[0])
    if not 0 < top < POINTS - 1 or height < LEAST_HEIGHT:
        return {}
    return {"resonance_hz": float(lam[top]) / (2 * math.pi * h), "height": height}


def pole_pair(phi1: float, phi2: float, h: float) -> dict[str, float]:
    """The peak of AR(2), or where it has fallen by half (bend_hz); nothing if it rises; h in s."""
    if found := peak_of(lambda lam: spectrum.ar2(lam, phi1, phi2), h):
        return found
    lam = np.linspace(1e-6, np.pi, POINTS)
    density = spectrum.ar2(lam, phi1, phi2)
    below = np.flatnonzero(density < density[0] / 2)
    falls = density[-1] < density[0]
    return {"bend_hz": float(lam[below[0]]) / (2 * math.pi * h)} if len(below) and falls else {}
