"""Find spectral lines, resonances and combs of lines at the full resolution of a record.

Only a stored recording has this resolution.
"""

import math
from collections.abc import Sequence

import numpy as np

from fltea.identification.comb_samples import WithoutComb, without_comb
from fltea.identification.gaps import Stretch
from fltea.records.arrays import Array
from fltea.spectrum.comb import Comb, find_comb
from fltea.spectrum.periodogram import Periodogram, periodogram
from fltea.spectrum.spectral_lines import Peak, Repeats, find_peaks

CHUNK, MOST_DEVIATIONS = 128, 12.0
"""CHUNK: number of samples in a chunk. MOST_DEVIATIONS: largest distance of a sample from the mean of its
chunk, in standard deviations. A sample further away is moved to this distance. Both are as in
firmware/core/engine/gate.hpp.
"""
Bands = tuple[tuple[float, float], ...]


def fine_peaks(
    p: Periodogram, stretches: Sequence[Stretch], from_hz: float, notch: Bands
) -> tuple[tuple[Peak, ...], Sequence[Stretch] | None]:
    """Return the peaks of a periodogram, and the stretches without the pattern that makes a comb of lines.

    If there is no comb, None is returned in place of the stretches.

    Args:
        p: periodogram of the longest stretch, above `from_hz` and outside `notch`.
        stretches: the samples between breaks.
        from_hz: lowest frequency in use [Hz].
        notch: bands (low, high) that are left out [Hz].
    """
    comb = find_comb(p)
    peaks: tuple[Peak, ...] = ()
    if comb is None:
        peaks = find_peaks(p)
        lines_hz = tuple(peak.frequency_hz for peak in peaks if peak.kind == "line")
        comb = find_comb(p, lines_hz) if lines_hz else None
    if comb is None:
        return peaks, None
    found = without_comb(stretches, comb)
    if found is None:
        return peaks or find_peaks(p), None
    rest = max((one.y for one in found.stretches), key=len)
    others = find_peaks(periodogram(limited(rest), p.h, from_hz=from_hz, notch=notch))
    return (_peak(comb, found, p), *others), found.stretches


def _peak(comb: Comb, found: WithoutComb, p: Periodogram) -> Peak:
    hz, width = 1 / (comb.period * p.h), 1 / (p.n * p.h)
    return Peak(
        kind="comb",
        frequency_hz=hz,
        width_hz=width,
        power_share=found.share,
        height=comb.height,
        notch_hz=(hz - width, hz + width),
        repeats=Repeats(comb.period * p.h, comb.teeth, found.shape, found.samples * p.h or None, found.size),
    )


def limited(y: Array) -> Array:
    """Limit the outliers of y (n,) as live fits do.

    Samples far from the mean of their chunk are moved nearer to it.

    If the outliers were kept, a few large ones close together would add their own spectrum to the spectrum of
    the noise.
    """
    chunks = len(y) // CHUNK
    if not chunks:
        return y
    whole = y[: chunks * CHUNK].reshape(chunks, CHUNK)
    mean = whole.mean(axis=1, keepdims=True)
    most = MOST_DEVIATIONS * math.sqrt(float(np.median(whole.var(axis=1))))
    inside = np.clip(whole, mean - most, mean + most).ravel() if most > 0 else whole.ravel()
    return np.concatenate([inside, y[chunks * CHUNK :]])
