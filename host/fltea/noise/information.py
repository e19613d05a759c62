"""Fisher's information that a spectrum holds on the parameters of the fractional state in white noise (pure).

Of Gaussian noise with the spectrum S each ordinate of the periodogram tells (Whittle, *Ark. Mat.* 2, 1953)

    (∂ log S) (∂ log S)ᵀ

of α, g = h^α f, log s2 and log R.
"""

import numpy as np

from fltea.records.arrays import Array


def log_slopes(lam: Array, alpha: float, g: float, s2: float, R: float) -> Array:
    """Return ∂ log S by α, g, log s2 and log R at frequencies in rad a sample, (4, len(lam))."""
    z = np.exp(-1j * lam)
    difference = -np.expm1(-1j * lam)  # 1 - z, without its rounding near λ = 0
    order = difference**alpha
    inverse = 1 / (order - g * z)
    x = s2 * np.abs(inverse) ** 2
    share = x / (x + R)
    by_alpha = -2 * (np.log(difference) * order * inverse).real
    by_g = 2 * (z * inverse).real
    return np.stack([share * by_alpha, share * by_g, share, 1 - share])
