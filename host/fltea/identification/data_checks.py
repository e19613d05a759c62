"""Check the data of an axis for what can mislead the identification, and say what to do about it.

The threshold of each data check is so high that clean noise, white or coloured, hardly ever exceeds it.
"""

import math
import sys
from collections.abc import Iterable, Iterator, Sequence
from typing import Literal

import msgspec
import numpy as np

from fltea.identification.counts import Counts
from fltea.identification.gaps import Gaps, cut, no_gaps
from fltea.identification.resolution import LONG, decimals, step, thin
from fltea.records.arrays import Array, median
from fltea.records.kinds import ERROR_KINDS
from fltea.spectrum import comb_words
from fltea.spectrum.median_filter import find_median_filter
from fltea.spectrum.spectral_lines import Peak

Severity = Literal["note", "warning", "bad"]

SHORT_S = 580.0
"""Length below which a record counts as short [s]; about ten minutes."""
BLOCKS = 20
"""Number of blocks into which the record is divided; their means show offset and drift."""
SIGNIFICANT = 5.0
"""Threshold for Student's t with about BLOCKS degrees of freedom; chance exceeds it once in ten thousand."""
OFFSET_SHARE, DRIFT_SHARE = 0.1, 0.1
"""An offset below OFFSET_SHARE standard deviations of the samples is not reported. Neither is a drift over
the record below DRIFT_SHARE standard deviations of the fast noise.
"""
OUTLIER = 6.0
"""A sample is an outlier if it is further from its neighbours than this many robust standard deviations.

In Gaussian noise one sample in 500 million is further away.
"""
TORN_COUNTS = 256.0
"""Size in counts of the jump that occurs if the bytes of two samples are mixed."""
TORN_WITHIN = 0.5
"""A jump of TORN_COUNTS can be told from noise only if four standard deviations of the noise are less than
TORN_WITHIN times the jump.
"""
COARSE_LSB, TOO_COARSE_LSB = 2.0, 0.5
"""Counts are coarse if the standard deviation of the samples is below COARSE_LSB [LSB], and too coarse if it
is below TOO_COARSE_LSB.

From 2 LSB on, rounding is at most 2 % of the variance. Below 0.5 LSB, rounding noise is not white.
"""
FULL_SCALE_COUNTS = 32767.0
RATE_PPM = 1000.0
SHORTEST_RUN = 5
FINER = {
    "deg/s": "±250 deg/s has eight times the resolution of ±2000",
    "m/s²": "±2 g has eight times the resolution of ±16 g",
}
LINE_SHARE = 0.01
"""A spectral line with more than this fraction of the samples' power is a warning; a weaker one is a note."""


class DataCheck(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a check of the data has found.

    If its severity is "bad", no figure of the noise is valid before the cause is removed.

    `axes`: the axes of the recording that the finding concerns. If empty, it concerns all axes, or the one
    axis in whose report it stands.
    """

    kind: str
    severity: Severity
    text: str
    remedy: str
    axes: tuple[str, ...] = ()


def of_axis(data_checks: Iterable[DataCheck], axis: str) -> tuple[DataCheck, ...]:
    """Return the data checks of a recording that concern one axis."""
    return tuple(data_check for data_check in data_checks if not data_check.axes or axis in data_check.axes)


def withheld(data_checks: Iterable[DataCheck]) -> str:
    """Return what is wrong with bad data and what to do about it; "" if the data are not bad.

    With bad data, no models, files for other programs, comparisons with a data sheet and forecasts are made.
    Whoever uses those would not see that their figures are wrong.
    """
    bad = (
        f"{data_check.text} {data_check.remedy}" for data_check in data_checks if data_check.severity == "bad"
    )
    return " ".join(dict.fromkeys(bad))


def axis_data_checks(
    y: Array,
    h: float,
    lsb: float | None = None,
    peaks: Sequence[Peak] = (),
    unit: str = "deg/s",
    gaps: Gaps | None = None,
    *,
    longer: str = "ten minutes or more",
) -> tuple[DataCheck, ...]:
    """Yield the data checks of one axis.

    Args:
        y: samples, (n,).
        h: sampling period [s].
        lsb: one count in the unit of y, if known.
        peaks: peaks found in the spectrum of y.
        unit: unit of y.
        gaps: where samples are missing.
        longer: the length that a record should have, in words.
    """
    gaps = gaps or no_gaps()
    samples = np.ascontiguousarray(y, dtype=np.float64)
    short = _too_short(len(samples), h, longer)
    if len(samples) < 2 * BLOCKS or np.ptp(samples) == 0:
        return (*short, *_stuck(samples))
    return (
        *short,
        *_offset_and_drift(_unbroken(samples, gaps), h, unit),
        *_quantisation(samples, lsb, unit),
        *_median_or_outliers(samples, h, lsb, unit, gaps),
        *_saturation(samples, lsb),
        *_stuck(samples),
        *_peaks(peaks),
    )


def source_data_check(kind: str, text: str) -> DataCheck:
    """Return a data check for a fault that the recording itself reported.

    `kind`: the kind of the `error` record.
    """
    remedy = ERROR_KINDS[kind].remedy if kind in ERROR_KINDS else ""
    return DataCheck(kind, "note", text, remedy)


def timing_data_checks(c: Counts, rate_hz: float, clock_ppm: float | None) -> Iterator[DataCheck]:
    """Check sample times and losses. `clock_ppm`: deviation of the device's clock from the host's."""
    if c.lost or c.gaps or c.stretches > 1:
        share = c.lost / max(c.samples + c.lost, 1)
        done = [f"{c.used} of {c.samples} samples, in {c.stretches} stretches, are used."]
        if c.bridged:
            done.append(
                f"{c.bridged} lost samples are filled in at random between their neighbours; "
                "longer gaps are not."
            )
        if c.used < c.samples:
            done.append("The others have another rate or scale.")
        yield DataCheck(
            "gaps",
            "warning" if c.used < 0.5 * c.samples or share > 0.01 else "note",
            f"{c.lost} samples ({share:.2%}) are missing in {c.gaps} gaps. {' '.join(done)}",
            "Look at the link with `fltea info`, and record again without losses.",
        )
    if clock_ppm is not None and abs(clock_ppm) > RATE_PPM:
        true_hz = rate_hz * (1 + clock_ppm * 1e-6)
        yield DataCheck(
            "sample rate",
            "bad" if abs(clock_ppm) > 0.05 * 1e6 else "warning",
            f"The samples come {clock_ppm:+.0f} ppm off the stated rate: {true_hz:.6g} Hz by the host's "
            f"clock, not {rate_hz:.6g}.",
            f"f, N and all frequencies are wrong in proportion: give the true rate (--rate {true_hz:.6g} for "
            "text).",
        )


def _too_short(n: int, h: float, longer: str) -> Iterator[DataCheck]:
    seconds = n * h
    if seconds < SHORT_S:
        yield DataCheck(
            "short",
            "note",
            f"{seconds:.3g} s, {n} samples: too short to separate a fractional order from "
            "relaxations (Gauss-Markov processes).",
            f"Record {longer}, at rest; bias instability and rate random walk show even later.",
        )


def _unbroken(y: Array, gaps: Gaps) -> Array:
    """Return the longest part of y without a step of the bias or a restart.

    At a step or a restart, the mean may jump.
    """
    begin, end, _ = max(cut(len(y), gaps, sys.maxsize), key=lambda part: part[1] - part[0])
    return y[begin:end] if end - begin >= 2 * BLOCKS else y


def _offset_and_drift(y: Array, h: float, unit: str) -> Iterator[DataCheck]:
    block = len(y) // BLOCKS
    means = y[: block * BLOCKS].reshape(BLOCKS, block).mean(axis=1)
    noise = _scale(thin(np.diff(y))) / math.sqrt(2) or float(y.std())
    mean, std = float(y.mean()), float(y.std())
    error = max(float(means.std(ddof=1)), noise / math.sqrt(block)) / math.sqrt(BLOCKS)
    if abs(mean) > max(OFFSET_SHARE * std, SIGNIFICANT * error):
        yield DataCheck(
            "offset",
            "note",
            "The bias is large compared with the noise.",
            'The start-up window subtracts it; do not run with `bias = "none"`.',
        )
    k = np.arange(BLOCKS) - (BLOCKS - 1) / 2
    slope = float(k @ means / (k @ k))
    left = means - means.mean() - slope * k
    # Twenty block means may lie on a straight line by chance. The error of the slope, computed from their
    # distances from the line, would then be too small. So it is at least the error that white noise alone
    # gives.
    residual = max(math.sqrt(float(left @ left) / (BLOCKS - 2)), noise / math.sqrt(block))
    t = slope * math.sqrt(float(k @ k)) / residual
    change = slope * BLOCKS
    if abs(t) > SIGNIFICANT and abs(change) > DRIFT_SHARE * noise:
        yield DataCheck(
            "drift",
            "warning",
            f"Drift of {change:+.3g} {unit} over {len(y) * h:.3g} s ({abs(t):.0f} standard errors).",
            "Let the sensor warm up and keep its temperature steady; --from-hz 0.02 leaves drift out.",
        )


def _quantisation(y: Array, lsb: float | None, unit: str) -> Iterator[DataCheck]:
    quantum = lsb or step(y)
    if quantum is None or (sigma := float(y.std()) / quantum) >= COARSE_LSB:
        return
    written = "" if lsb else decimals(quantum, unit)
    share = min(1 / 12 / sigma**2, 1.0)
    coarse = sigma < TOO_COARSE_LSB
    yield DataCheck(
        "decimals" if written else "quantisation",
        "bad" if coarse else "warning",
        f"σ is {sigma:.2g} {f'steps of {written}' if written else 'LSB'}: rounding makes up {share:.0%} of "
        f"the variance{', and is not white.' if coarse else '.'}",
        "The step is a power of ten, so the file has too few decimals: write more of them, or the sensor's "
        "counts. (If the step is one count of the sensor, choose a smaller range.)"
        if written
        else f"Choose a smaller range of the sensor ({FINER.get(unit, FINER['deg/s'])}).",
    )


def _outliers(y: Array, h: float, lsb: float | None, unit: str, gaps: Gaps) -> Iterator[DataCheck]:
    # Compare each sample with the mean of its two neighbours: drift and slow noise are the same in all three.
    r = y[:-2] + y[2:]
    r /= 2
    np.subtract(y[1:-1], r, out=r)
    # r: each sample minus the mean of its neighbours. If samples are rounded to counts, r is a multiple of
    # half an LSB. The median of |r| may then be a quarter of an LSB too small, so a quarter of an LSB is
    # added.
    scale = _scale(thin(r)) + 1.4826 / 4 * (lsb or step(y) or 0.0) or float(r.std())
    size = np.abs(r, out=r)
    # Samples next to a gap are not checked. Since the bias may change during the gap, such a sample may
    # differ from its neighbour across the gap without being an outlier.
    neighbours = np.concatenate([gaps.at - 2, gaps.at - 1])
    size[neighbours[(neighbours >= 0) & (neighbours < len(size))]] = 0.0
    is_top = size > OUTLIER * scale
    is_top[1:] &= size[1:] >= size[:-1]
    is_top[:-1] &= size[:-1] >= size[1:]
    at = np.flatnonzero(is_top) + 1
    if not at.size:
        return
    first = f"the first at {gaps.place(int(at[0])) * h:.4g} s"
    torn = 0
    if lsb is not None and 4 * scale < TORN_WITHIN * TORN_COUNTS * lsb:
        off = np.abs(size[at - 1] - TORN_COUNTS * lsb)
        # If samples mix bytes of two measurements, most outliers are jumps of TORN_COUNTS. Otherwise outliers
        # have many sizes, and one of that size says nothing. So at least half of them must have this size.
        torn = int((off < 4 * scale).sum()) if 2 * int((off < 2 * scale).sum()) >= at.size else 0
    if torn:
        yield DataCheck(
            "torn reads",
            "bad",
            f"{torn} jumps of ±256 LSB for one sample ({first}): the sample mixes bytes of two measurements.",
            "Read all bytes of a sample in one burst, after the data-ready signal or with the shadow "
            "registers on.",
        )
    if (others := int(at.size) - torn) > 0:
        largest = float(size[at - 1].max())
        yield DataCheck(
            "outliers",
            "bad" if others > 1e-3 * len(y) else "warning",
            f"{others} samples stand out from both neighbours, by up to {largest:.3g} {unit} or "
            f"{largest / scale:.0f} standard deviations ({first}).",
            "Was the sensor touched, or is the link bad? Leave that part out, or record again.",
        )


def _median_or_outliers(y: Array, h: float, lsb: float | None, unit: str, gaps: Gaps) -> Iterator[DataCheck]:
    found = find_median_filter(y)
    if found is None or found.replaces_outliers:
        yield from _outliers(y, h, lsb, unit, gaps)
    # Outliers are not searched for if all samples went through a median filter, which removes outliers. It
    # also makes many neighbours equal, so that the median of |r| is too small. Normal samples would then seem
    # to be outliers.
    if found is not None:
        yield DataCheck(
            "median filter",
            "warning",
            f"The samples have been through {found.words}: {found.share:.0%} of them equal the sample "
            "before, beyond what rounding explains.",
            "Record without that filter: it is not linear, and corner frequencies and fast parts of the "
            "noise describe the filter, not the sensor.",
        )


def _saturation(y: Array, lsb: float | None) -> Iterator[DataCheck]:
    ends = 0 if lsb is None else int((np.abs(y) / lsb >= FULL_SCALE_COUNTS - 0.5).sum())
    if ends:
        yield DataCheck(
            "saturation",
            "bad",
            f"{ends} samples are at the end of the sensor's range.",
            "The sensor was moved, or its offset is too large: record at rest, or choose a larger range.",
        )


def _stuck(y: Array) -> Iterator[DataCheck]:
    """Yield the data check on a value that the sensor repeats for longer than chance explains."""
    n = len(y)
    same = np.concatenate([[False], y[1:] == y[:-1], [False]])
    edges = np.flatnonzero(same[1:] != same[:-1]).reshape(-1, 2)
    if not len(edges):
        return
    lengths = edges[:, 1] - edges[:, 0]
    longest, first = int(lengths.max()), int(edges[lengths.argmax(), 0])
    # The proportion of samples that equal the sample before gives the length that a run of equal values may
    # have by chance. The longest run is left out of this proportion, since it is the run to be tested.
    others = thin(y) if n > LONG else np.delete(y, slice(first, first + longest + 1))
    commonest = np.unique(others, return_counts=True)[1].max(initial=1) / (len(others) if n > LONG else n)
    share = min(max((lengths.sum() - longest) / n, commonest), 0.999)
    by_chance = 1 + math.log(n / 1e-6) / -math.log(share)
    if longest >= max(SHORTEST_RUN, by_chance):
        yield DataCheck(
            "stuck",
            "bad",
            f"One value is repeated for {longest + 1} samples, from sample number {first} on.",
            "The sensor stopped measuring, or reads failed: look at the supply, the wires and the log.",
        )


def _peaks(peaks: Sequence[Peak]) -> Iterator[DataCheck]:
    for peak in peaks:
        severity: Severity = "warning" if peak.power_share > LINE_SHARE else "note"
        if peak.repeats is not None:
            text = f"{comb_words.happens(peak.repeats, peak.power_share)}."
            yield DataCheck(peak.kind, severity, text, comb_words.next_step(peak.repeats))
            continue
        yield DataCheck(
            peak.kind,
            severity,
            f"A {'narrow line' if peak.kind == 'line' else 'broad resonance'} at {peak.frequency_hz:.4g} Hz, "
            f"{peak.width_hz:.2g} Hz wide, has {peak.power_share:.2%} of the power.",
            "The fits leave it out. Look for a fan, mains or a resonance of the mounting; "
            f"--notch {peak.notch_hz[0]:.4g}-{peak.notch_hz[1]:.4g} leaves it out of the null test too.",
        )


def _scale(values: Array) -> float:
    """Return the standard deviation of a Gaussian with the same median absolute deviation."""
    return 1.4826 * median(np.abs(values - median(values)))
