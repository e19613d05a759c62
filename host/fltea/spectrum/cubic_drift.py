"""The drift of a record, described by a cubic.

The cubic is subtracted, since drift leaks into all frequencies.
"""

import functools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from fltea.records.arrays import Array

LARGE_DRIFT, NEAR_THE_DRIFT = 30.0, slice(10, 30)
"""From a short record, the cubic is subtracted only if its power is large. The power has to be more than
LARGE_DRIFT times the mean power of the ordinates whose numbers are in NEAR_THE_DRIFT.
"""


class Drift(NamedTuple):
    """The slow part of a record that is not noise.

    This drift is described by a cubic in each unbroken stretch of the record at reduced rate (the
    whole-record level of `octaves`).
    """

    power: float
    """Mean square of the amplitudes of all cubics: of the coefficients of each cubic, written as a sum of
    orthonormal polynomials. For white noise that has the variance R at the full sampling rate, the expected
    value of `power` is R.
    """
    amplitudes: int
    """Number of all amplitudes: three for each cubic, and each stretch has one cubic."""


def cubic_through(values: Array) -> tuple[Array, Array]:
    """Return the cubic that is fitted to `values` (m,) of mean 0, and its three amplitudes (coefficients).

    The amplitudes are the coefficients of orthonormal polynomials of degree 1, 2 and 3. For white noise of
    variance 1, each amplitude is normally distributed with variance 1. A drift whose last value differs from
    its first leaks into all frequencies λ as 1/λ², far above its own frequencies. A cubic that is subtracted
    from noise takes power from the ordinates below number `periodogram.LOWEST`, which no fit uses. From the
    ordinate with this number it takes a few percent of the power.
    """
    basis = _cubics(len(values))
    amplitudes = basis @ values
    return amplitudes @ basis, amplitudes


@functools.lru_cache(maxsize=8)
def _cubics(m: int) -> Array:
    """Return three orthogonal polynomials, of degree 1, 2 and 3, at m points, (3, m).

    Each has the mean 0 and the sum of squares 1.
    """
    x = np.linspace(-1, 1, m)
    squares = x * x
    curve = squares - squares.mean()
    bend = x * (squares - (squares @ squares) / squares.sum())
    return np.stack([one / math.sqrt(one @ one) for one in (x, curve, bend)])


def drift_of(amplitudes: Sequence[Array], level: int) -> Drift | None:
    """Return the drift that cubics with these `amplitudes` describe; None if there are no cubics.

    `amplitudes`: three for each unbroken stretch of the record at reduced rate. `level`: number of times that
    the sampling rate was halved for it.
    """
    if not amplitudes:
        return None
    all_of_them = np.concatenate(amplitudes)
    power = float(all_of_them @ all_of_them) / len(all_of_them) * 2.0**level
    return Drift(power, len(all_of_them))


def is_large(values: Array, amplitudes: Array) -> bool:
    """Return whether a short record drifts so much that the drift would leak into fitted frequencies."""
    near = np.fft.rfft(values)[NEAR_THE_DRIFT]
    level = float(np.mean(near.real**2 + near.imag**2)) / len(values) if near.size else 0.0
    return float(np.mean(amplitudes**2)) > LARGE_DRIFT * level > 0
