"""Areas with gaps: a browser's canvas would join what is on both sides of one (pure)."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def closed(low: Array, high: Array, before: float = np.nan) -> tuple[Array, Array, float]:
    """Let an area have no height where its ends are not known, at the middle of what was known last.

    before: the third of what was returned for the rows before these.
    """
    middle = (low + high) / 2
    known = np.isfinite(middle)
    last = np.maximum.accumulate(np.where(known, np.arange(1, len(middle) + 1), 0))
    filled = np.concatenate([[before], middle])[last]
    end = float(filled[-1]) if len(filled) else before
    return np.where(known, low, filled), np.where(known, high, filled), end
