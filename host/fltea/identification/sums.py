"""Compute the running sums of one axis of a recording, as the live fit does, and analyse its spectrum.

Also find spectral lines in all samples together. The live fit cannot do that, since it does not keep all
samples.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import msgspec
import numpy as np

from fltea.identification.fine_peaks import fine_peaks, limited
from fltea.identification.folded_line import folded_line
from fltea.identification.gaps import LONGEST_BRIDGE, Gaps, Stretch, bridged, no_gaps
from fltea.identification.swing_period import with_period
from fltea.records.arrays import Array
from fltea.spectrum.cubic_drift import Drift
from fltea.spectrum.median_filter import MedianFilter, find_median_filter
from fltea.spectrum.octaves import SHORTEST, Lines, Octaves, Parts, in_order, put_together
from fltea.spectrum.ordinates import around
from fltea.spectrum.periodogram import Periodogram, check_enough, periodogram
from fltea.spectrum.spectral import Spectral, examine
from fltea.spectrum.spectral_lines import Peak

Bands = tuple[tuple[float, float], ...]

AT_ONCE = 1 << 18
"""Number of samples processed at once, so that little of a long file is in memory."""
LEAST_SHARE = 0.5
"""If the longest stretch without a gap holds at least this proportion of all samples, spectral lines are
searched for in the samples of this stretch.

If the stretch holds fewer samples, lines are searched for in the octave spectrum of all stretches.
"""
NOTHING = 1e-20
"""If the median spectral density is below the samples' variance times this factor, the density comes only
from the rounding of floating-point numbers.
"""


def octaves_of(y: Array) -> Octaves:
    """Return the running sums of y (n,) from which its octave spectrum is computed.

    Raises:
        ValueError: y is not finite.
    """
    return octaves_of_stretches([Stretch(y, 0)])


def octaves_of_stretches(stretches: Sequence[Stretch]) -> Octaves:
    """Return the running sums of all stretches for one octave spectrum.

    A stretch is a run of samples without a gap. No block of samples that is summed crosses a gap.

    Raises:
        ValueError: a sample is not finite.
    """
    sums = Octaves(1)
    for number, (y, missing) in enumerate(stretches):
        if number:
            sums.skip(max(missing, LONGEST_BRIDGE + 1))
        for begin in range(0, len(y), AT_ONCE):
            sums.add(np.asarray(y[begin : begin + AT_ONCE, np.newaxis], dtype=np.float64))
    return sums


def lines_of_stretches(
    stretches: Sequence[Stretch], sums: Octaves, h: float
) -> tuple[Periodogram, Drift | None]:
    """Return the spectrum and the drift of the samples in stretches (runs of samples without a gap).

    `sums`: the running sums over all stretches.

    `sums` have as many octaves as fit the length of the whole record. Short stretches would leave the lowest
    octaves empty. So if there are several stretches, each gets sums of its own here.

    Raises:
        ValueError: the stretches are constant, or too short.
    """
    if len(stretches) == 1:
        return sums.lines_and_drift(0, h)
    if sums.counts(0).constant:
        raise ValueError("y is constant: there is no noise in it")
    return lines_together(parts_of(stretches), h, max(len(one.y) for one in stretches))


def parts_of(stretches: Sequence[Stretch]) -> list[Parts]:
    """Return the running sums of each stretch (samples without a gap) that is long enough for a spectrum."""
    return [octaves_of(one.y).parts(0) for one in stretches if len(one.y) >= SHORTEST]


def lines_together(found: Sequence[Parts], h: float, longest: int) -> tuple[Periodogram, Drift | None]:
    """Return the joint spectrum and drift of several stretches (runs of samples without a gap).

    `found`: the running sums of each stretch. `longest`: number of samples of the longest stretch.

    Raises:
        ValueError: the stretches are too short.
    """
    welch = [lines for one in found for lines in one.welch]
    whole: dict[int, list[Lines]] = {}
    for one in found:
        whole.setdefault(one.depth, []).extend(one.whole)
    together = [on_one_grid(parts) for parts in whole.values() if parts]
    if not welch and not together:
        check_enough(0, longest)
    return put_together(welch + together, h, max(one.n for one in found)), drift_together(found)


def drift_together(found: Sequence[Parts]) -> Drift | None:
    """Return one drift for several stretches (runs of samples without a gap); None if none has a drift.

    Its power is the mean square of the amplitudes of all stretches. `Drift` says what the amplitudes are.
    """
    drifts = [one.drift for one in found if one.drift is not None]
    amplitudes = sum(one.amplitudes for one in drifts)
    return Drift(sum(d.power * d.amplitudes for d in drifts) / amplitudes, amplitudes) if drifts else None


def one_a_depth(found: Sequence[Parts]) -> list[Parts]:
    """Merge the running sums of stretches that have the same depth, which is the number of octaves.

    In stretches of the same depth, the lowest octaves have the same sampling rate. So their spectral
    ordinates at nearly the same frequency can be averaged, which leaves fewer ordinates.
    """
    depths: dict[int, list[Parts]] = {}
    for one in found:
        depths.setdefault(one.depth, []).append(one)
    return [
        Parts(
            [in_order(*(np.concatenate(part) for part in zip(*welch, strict=True)))] if welch else [],
            [on_one_grid(whole)] if whole else [],
            depth,
            drift_together(those),
            max(one.n for one in those),
        )
        for depth, those in depths.items()
        for welch in [[lines for one in those for lines in one.welch]]
        for whole in [[lines for one in those for lines in one.whole]]
    ]


def on_one_grid(parts: Sequence[Lines]) -> Lines:
    """Merge the spectral ordinates of stretches (runs of samples without a gap) of different length.

    The longest stretch has the finest grid of frequencies. Ordinates that are nearest to the same frequency
    of this grid are averaged.
    """
    lam, power, weight = (np.concatenate(part) for part in zip(*parts, strict=True))
    step = min(float(np.diff(one[0]).min(initial=math.inf)) for one in parts)
    cell = np.rint(lam / step).astype(np.int64) if math.isfinite(step) else np.arange(len(lam))
    _, index = np.unique(cell, return_inverse=True)
    total = np.bincount(index, weight).astype(np.float64)
    return np.bincount(index, weight * lam) / total, np.bincount(index, weight * power) / total, total


def left_in(whole: Periodogram, from_hz: float, notch: Bands) -> Periodogram:
    """Return the ordinates of a spectrum above `from_hz` [Hz] and outside the bands (low, high) of `notch`.

    Raises:
        ValueError: too few ordinates are left.
    """
    return whole.without(from_hz, notch) if from_hz > 0 or notch else whole


class Summed(NamedTuple):
    """The analysis of an axis's spectrum, and the data from which it was made."""

    seen: Spectral
    octaves: Octaves
    lines: Periodogram
    """All ordinates of the spectrum, including those that the user excluded from the fit."""
    stretches: Sequence[Stretch]
    """The samples from which the ordinates were computed.

    If the spectrum had a comb of lines, the periodic pattern that makes the comb was subtracted from these
    samples.
    """


def examined(
    y: Array, h: float, from_hz: float = 0.0, notch: Bands = (), gaps: Gaps | None = None
) -> Spectral:
    """Analyse the spectrum of y (n,).

    If the longest stretch without a gap has at least half of the samples, spectral lines are searched for in
    this stretch at full resolution.

    Args:
        y: samples, (n,).
        h: sampling period [s].
        from_hz: lowest frequency in use [Hz].
        notch: bands (low, high) that are left out [Hz].
        gaps: gaps between the samples of y, if there are any.

    Raises:
        ValueError: y is not finite, constant, or too short.
    """
    return examined_stretches(bridged(y, gaps or no_gaps()), len(y), h, from_hz, notch).seen


def examined_stretches(
    stretches: Sequence[Stretch], samples: int, h: float, from_hz: float = 0.0, notch: Bands = ()
) -> Summed:
    """Analyse the spectrum of stretches, as `examined` does. `samples`: number of samples of the axis.

    Raises:
        ValueError: for the same reasons as `examined`.
    """
    sums = octaves_of_stretches(stretches)
    lines, drift = lines_of_stretches(stretches, sums, h)
    longest = max((one.y for one in stretches), key=len)
    _check_noise(lines, longest)
    median = find_median_filter(longest)
    peaks: tuple[Peak, ...] | None = None
    before: Periodogram | None = None
    if len(stretches) == 1 or len(longest) >= LEAST_SHARE * samples:
        # Search for spectral lines in the longest stretch at full resolution.
        fine = periodogram(limited(longest), h, from_hz=from_hz, notch=notch)
        peaks, rest = fine_peaks(fine, stretches, from_hz, notch)
        if rest is not None:
            stretches, before = rest, lines
            sums = octaves_of_stretches(stretches)
            lines, drift = lines_of_stretches(stretches, sums, h)
    seen = examined_sums(lines, drift, sums, samples, h, from_hz, notch, peaks, before, median)
    folded = folded_line(longest, h, seen.evidence.candidates) if peaks is not None else None
    if folded is not None and peaks is not None:
        peaks = (*peaks, folded)
        from_hz = max(from_hz, folded.notch_hz[1])
        seen = examined_sums(lines, None, sums, samples, h, from_hz, notch, peaks, before, median)
    if (change := seen.evidence.change) is not None:
        evidence = seen.evidence._replace(change=with_period(change, np.asarray(longest), h))
        seen = msgspec.structs.replace(seen, evidence=evidence)
    return Summed(seen, sums, lines, stretches)


def _check_noise(lines: Periodogram, y: Array) -> None:
    """Check that y (n,) has noise in addition to an exactly repeated pattern or a straight line.

    Raises:
        ValueError: y has no noise.
    """
    if float(np.median(lines.power)) < NOTHING * float(np.mean((y - y.mean()) ** 2)):
        raise ValueError(
            "there is no noise in the samples to identify: they repeat themselves exactly, as 1, 2, 1, 2 …, "
            "or lie on a straight line"
        )


def examined_sums(
    lines: Periodogram,
    drift: Drift | None,
    sums: Octaves,
    samples: int,
    h: float,
    from_hz: float = 0.0,
    notch: Bands = (),
    peaks: tuple[Peak, ...] | None = None,
    before: Periodogram | None = None,
    median: MedianFilter | None = None,
) -> Spectral:
    """Analyse a spectrum that was computed before, as `examined` does.

    Args:
        lines: the ordinates of the spectrum, with their frequencies.
        drift: the slow part of the samples that is not noise; None if it is not known.
        sums: the running sums of the samples by octaves.
        samples: number of samples.
        h: sampling period [s].
        from_hz: lowest frequency in use [Hz].
        notch: bands (low, high) that are left out [Hz].
        peaks: spectral peaks found in the samples; None: search for peaks in `lines`.
        before: the spectrum before a comb was removed from the samples; None if there was no comb. A comb is
            the peaks of a periodic pattern.
        median: the median filter that was detected in the samples.

    Raises:
        ValueError: for the same reasons as `examined`.
    """
    notch = around(lines, notch)
    return examine(
        left_in(lines, from_hz, notch),
        samples * h,
        samples,
        cells=sums.cells(0, h),
        drift=drift,
        peaks=peaks,
        before=None if before is None else left_in(before, from_hz, notch),
        median=median,
        from_hz=from_hz,
        notch=notch,
    )
