"""One axis of a recording: the sums of the live fit, and the lines that only a file can show."""

import math

import numpy as np
from numpy.typing import NDArray

from fltea.spectrum.lines import find_peaks
from fltea.spectrum.octave_lines import around
from fltea.spectrum.octaves import Octaves
from fltea.spectrum.periodogram import Periodogram, periodogram
from fltea.spectrum.spectral import Spectral, examine

Array = NDArray[np.float64]
Bands = tuple[tuple[float, float], ...]

CHUNK, MOST_DEVIATIONS = 128, 12.0
"""As in host/native/gate.hpp."""
AT_ONCE = 1 << 18
"""Samples, so that of a long file little is in memory."""


def octaves_of(y: Array) -> Octaves:
    """Add up y (n,).

    Raises:
        ValueError: y is not finite.
    """
    sums = Octaves(1)
    for begin in range(0, len(y), AT_ONCE):
        sums.add(np.asarray(y[begin : begin + AT_ONCE, np.newaxis], dtype=np.float64))
    return sums


def limited(y: Array) -> Array:
    """Take the outliers off y (n,): samples far from the mean of their chunk are moved nearer, as live.

    A few large samples that stand close together have a spectrum of their own.
    """
    chunks = len(y) // CHUNK
    if not chunks:
        return y
    whole = y[: chunks * CHUNK].reshape(chunks, CHUNK)
    mean = whole.mean(axis=1, keepdims=True)
    most = MOST_DEVIATIONS * math.sqrt(float(np.median(whole.var(axis=1))))
    inside = np.clip(whole, mean - most, mean + most).ravel() if most > 0 else whole.ravel()
    return np.concatenate([inside, y[chunks * CHUNK :]])


def lines_of(sums: Octaves, h: float, from_hz: float = 0.0, notch: Bands = ()) -> Periodogram:
    """The lines above from_hz and outside of the bands (low, high), in Hz; h: sampling period in s.

    Raises:
        ValueError: y is constant, or too few are left.
    """
    whole = sums.periodogram(0, h)
    return whole.without(from_hz, notch) if from_hz > 0 or notch else whole


def examined(y: Array, h: float, from_hz: float = 0.0, notch: Bands = ()) -> Spectral:
    """What the spectrum of y (n,) says; h, from_hz and notch as for `lines_of`.

    Raises:
        ValueError: y is not finite, constant, or too short.
    """
    # At the full resolution.
    peaks = find_peaks(periodogram(limited(y), h, from_hz=from_hz, notch=notch))
    sums = octaves_of(y)
    notch = around(sums.periodogram(0, h), notch)
    return examine(
        lines_of(sums, h, from_hz, notch),
        len(y) * h,
        len(y),
        cells=sums.cells(0, h),
        drift=sums.lines_and_drift(0, h)[1],
        peaks=peaks,
        from_hz=from_hz,
        notch=notch,
    )
