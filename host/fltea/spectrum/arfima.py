"""ARFIMA(1, d, 0) in white noise: memory of another kind than the fractional state's (pure).

S = |1 - e^{-iλ}|^-2d / |1 - φ e^{-iλ}|². The fractional state bends to a flat spectrum at low frequencies;
this does not, but may bend at high ones (Granger and Joyeux, *J. Time Ser. Anal.* 1, 1980). It is fitted so
that noise of this kind is not taken for a sum of relaxations.
"""

import numpy as np
from numpy.typing import NDArray

from fltea.noise import spectra as spectrum
from fltea.spectrum.models import logit, share
from fltea.spectrum.whittle import Model

Array = NDArray[np.float64]

LEAST_ORDER, MOST_ORDER = 0.15, 0.85
"""Orders that neither white noise nor a relaxation or a random walk has; those near 0 and 1 nearly have."""


def arfima_parameters(theta: Array) -> tuple[Array, Array, Array]:
    """Return d, φ and s2 / (s2 + R) of coordinates (..., 3)."""
    return (
        LEAST_ORDER + (MOST_ORDER - LEAST_ORDER) * share(theta[..., 0]),
        2 * share(theta[..., 1]) - 1,
        share(theta[..., 2]),
    )


def _arfima() -> Model:
    def shape(lam: Array, theta: Array) -> Array:
        d, phi, weight = arfima_parameters(theta)
        size = np.exp(-2 * d[:, np.newaxis] * np.log(2 * np.sin(lam / 2)))
        w = weight[:, np.newaxis]
        return np.asarray(w * size * spectrum.ar1(lam, phi) + 1 - w)

    axes = [logit((np.array([0.2, 0.35, 0.5, 0.7]) - LEAST_ORDER) / (MOST_ORDER - LEAST_ORDER))]
    axes += [
        logit((1 + np.array([-0.8, -0.3, 0.3, 0.8, 0.95, 0.99])) / 2),
        logit([1e-4, 0.01, 0.1, 0.5, 0.95]),
    ]
    d, phi, weight = (axis.ravel() for axis in np.meshgrid(*axes, indexing="ij"))
    groups = np.unique(d * 100 + phi, return_inverse=True)[1]
    return Model("arfima", 4, np.stack([d, phi, weight], axis=-1), groups.astype(np.intp), shape)


ARFIMA = _arfima()
