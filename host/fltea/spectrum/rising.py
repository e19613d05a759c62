"""Spectra that rise with frequency: |1 - e^{-iλ}|^2δ in white noise, 0 < δ <= 1 (pure).

δ is the -d of ARFIMA(0, d, 0) with d < 0; δ = 1 is the difference of white noise, as quantisation of an
angle makes it. No other family here has such a spectrum, but for AR(1) with φ < 0, whose bend is in mid-band.
"""

import numpy as np
from numpy.typing import NDArray

from fltea.spectrum.models import logit, share
from fltea.spectrum.whittle import Model

Array = NDArray[np.float64]


def rising_parameters(theta: Array) -> tuple[Array, Array]:
    """Return δ, and the share of the rising part in its sum with white noise, of coordinates (..., 2)."""
    return share(theta[..., 0]), share(theta[..., 1])


def _rising() -> Model:
    def shape(lam: Array, theta: Array) -> Array:
        delta, weight = (one[:, np.newaxis] for one in rising_parameters(theta))
        return np.asarray(weight * (2 * np.sin(lam / 2)) ** (2 * delta) + 1 - weight)

    order, weight = (
        axis.ravel() for axis in np.meshgrid([0.1, 0.3, 0.6, 0.9], [0.03, 0.3, 0.8, 0.99], indexing="ij")
    )
    starts = np.stack([logit(order), logit(weight)], axis=-1)
    return Model("rising", 3, starts, np.arange(len(order)), shape)


RISING = _rising()
