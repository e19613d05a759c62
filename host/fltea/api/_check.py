"""What a caller may pass; a mistake gives a ValueError that says what to pass instead."""

import math

import numpy as np
from numpy.typing import ArrayLike

from fltea.recording.session import HIGHEST_RATE_HZ, LOWEST_RATE_HZ
from fltea.records.arrays import Array


def period_s(rate_hz: float) -> float:
    """Return the sampling period of a rate in Hz."""
    if not (math.isfinite(rate_hz) and LOWEST_RATE_HZ <= rate_hz <= HIGHEST_RATE_HZ):
        raise ValueError(
            f"rate_hz is the sample rate in Hz, {LOWEST_RATE_HZ:g} to {HIGHEST_RATE_HZ:g}, got {rate_hz}"
        )
    return 1 / rate_hz


def finite(y: ArrayLike, what: str, remedy: str) -> Array:
    """Return numbers as an array of float; `remedy` is what to do about one that is not finite."""
    try:
        found = np.asarray(y, dtype=np.float64, order="C")
    except (TypeError, ValueError) as error:
        raise ValueError(f"{what} has to be numbers: {error}") from error
    bad = np.argwhere(~np.isfinite(found))
    if len(bad):
        at = ", ".join(str(i) for i in bad[0])
        raise ValueError(f"{what} has {len(bad)} values that are not finite, the first at [{at}]: {remedy}")
    return found


def one_axis(y: ArrayLike) -> Array:
    """Return samples of one axis, (n,)."""
    found = finite(
        y, "y", "leave them out only at the ends, or use fltea.Live and its skip(), which knows gaps."
    )
    if found.ndim != 1:
        raise ValueError(
            f"y is one axis, (n,), got shape {found.shape}: pass its axes one by one, as y[:, 0]."
        )
    return found
