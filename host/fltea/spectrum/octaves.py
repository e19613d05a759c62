"""The spectrum of an endless series of samples, in constant memory and without loss of resolution.

Each octave of the spectrum is a Welch estimate (blocks of 256 samples, Hann window, half overlapping). Its
sample rate is half of that of the next higher octave. Below the lowest octave there is the whole-record level
(firmware/core/engine/octave_ladder.hpp): the whole record at a reduced rate, at which it has at most 3,072
samples. So the spectrum of up to 3,072 samples is the periodogram of the record, and the lowest frequencies
of a longer record have the resolution of the whole record. The sums of two records can be added (`merge`):
they then give the spectrum of both.

Samples that are not noise are left out and counted. They are knocks, steps of the offset and gaps
(firmware/core/engine/gate.hpp), and samples that the caller marks as motion.

With a memory of M samples, the weight of older samples fades between M and 2 M samples, and nothing older
than 2 M contributes.
"""

import functools
import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fltea import _native
from fltea.records.arrays import Array
from fltea.spectrum.cubic_drift import Drift, cubic_through, drift_of, is_large
from fltea.spectrum.periodogram import LOWEST, Periodogram, check_enough

WHOLE: int = _native.OCTAVES_WHOLE
"""If there are at most this many samples, the spectrum is the periodogram of the whole record."""
BLOCK: int = _native.OCTAVES_BLOCK
LANE_BYTES: int = _native.OCTAVES_LANE_BYTES
"""Memory for each lane (axis) [bytes], whatever the length of the record."""
SHORTEST = 64
"""Fewest samples of a stretch without a gap at the reduced rate. Shorter stretches are not used."""

_FIRST_LINE: int = _native.OCTAVES_LOWEST
_LINES = _native.OCTAVES_LINES
JOIN = (_FIRST_LINE - 0.5) * 2 * 2 * math.pi / BLOCK
"""Below this frequency [rad per sample of the reduced rate], the spectrum comes from the whole record at a
reduced rate; above it, from the octaves.
"""
_HANN_POWER = 0.375 * BLOCK
_HANN_LINES = 1 + 2 * (4 / 9 + 1 / 36)
"""Hann's window makes neighbouring frequencies correlated, so that only one in this many is independent. It
is the sum of the squared correlations of one frequency with itself and with its neighbours.
"""
_HALF_OVERLAP = 2 / 12
"""Blocks that overlap by half are correlated, too, so this is added to `_HANN_LINES`. It is the sum of the
squared correlations of one frequency with all frequencies of the previous and of the next block.
"""


class Counts(NamedTuple):
    """Counts of what happened to the samples of one lane (axis)."""

    used: int
    """Number of samples in the spectrum, and of samples that wait until their chunk of 128 samples is full.
    """
    bridged: int
    """Number of lost samples that were replaced by a straight line."""
    lost: int
    """Number of all lost samples, including the bridged ones."""
    gaps: int
    """Number of breaks in the series because of lost samples."""
    knocks: int
    """Number of chunks of 128 samples that were left out as knocks."""
    knocked: int
    """Number of samples that were left out because of knocks or steps."""
    steps: int
    """The number of steps of the offset."""
    changes: int
    """How often the power of the noise changed by a factor of more than ten."""
    constant: bool
    """Whether all samples are equal to the first."""
    limited: int = 0
    """Number of used samples that were replaced by a limit because they exceeded it."""
    moved: int = 0
    """Number of samples that were left out as motion, including those of the unfinished chunk before a
    motion.
    """
    motions: int = 0
    """Number of breaks in the series because of motion."""


class BandCells(NamedTuple):
    """The power of one frequency band over time: the logarithms of the powers of its blocks of samples.

    The blocks are grouped into at most 16 cells (intervals of time). In addition, the mean of each 2^s
    successive blocks is compared with that of the next 2^s, for several scales s.
    """

    low_hz: float
    high_hz: float
    counts: Array
    """The number of blocks of each cell (interval of time), (c,). The blocks overlap by half."""
    mean_log: Array
    """The mean logarithm of the powers of each cell's blocks, (c,). Powers are in the square of the samples'
    unit.
    """
    variance_log: Array
    """The variance of the log powers of each cell's blocks, (c,); NaN for a cell with a single block."""
    first: NDArray[np.int64]
    """The index of the first sample of each cell, (c,). Lost samples are counted, too."""
    hop: int
    """Number of samples from the start of a block to the start of the next."""
    pairs: Array
    """For each scale s, how often 2^s blocks were compared with the next 2^s, in mean log power, (k,)."""
    scale_variance: Array
    """For each scale s, the mean of 2^s d²/2 over the compared `pairs`, (k,). d is the difference between the
    mean log powers of 2^s blocks and of the next 2^s. If the blocks are independent, the expected value is
    the same at all scales.
    """


class AllanPoints(NamedTuple):
    """Overlapping Allan variances at averaging times of 2^j samples."""

    factors: list[float]
    """Averaging times in samples, (k,)."""
    avar: list[float]
    """Allan variances in the squared unit of the samples, (k,)."""
    terms: list[float]
    """Effective numbers of squared differences that were averaged, (k,)."""
    samples: float
    """Number of samples from which the variances were computed."""


Lines = tuple[Array, Array, Array]
"""Frequencies [rad a sample], powers and weights of a part of a spectrum, (m,) each."""


class Parts(NamedTuple):
    """The parts that make up a spectrum."""

    welch: list[Lines]
    """The frequencies, powers and weights of each octave that has blocks."""
    whole: list[Lines]
    """The frequencies, powers and weights of each unbroken stretch of the record at reduced rate."""
    depth: int
    """Number of octaves. For the record at reduced rate, the rate was halved as many times."""
    drift: Drift | None
    n: int
    """Length, in samples of the full rate, of the longest stretch without a gap in `whole`. If `whole` is
    empty, the length of a block of the lowest octave.
    """


class Octaves:
    """Running spectra of several lanes (axes) that are sampled together."""

    def __init__(self, lanes: int, memory_samples: float = 0.0) -> None:
        """Begin without samples.

        Raises:
            ValueError: there are no lanes, or the memory is neither 0, with which nothing is forgotten, nor
                256 to 10^12 samples.
        """
        self.native = _native.Octaves(lanes, memory_samples)

    def add(self, y: Array, moving: NDArray[np.bool_] | None = None, longest: float = 0.0) -> None:
        """Add samples `y`, (n, lanes). The result does not depend on how many samples a call adds.

        `moving` (n, lanes): samples that are motion and are left out. `longest`: if no 1,024 samples in a row
        were at rest for this many samples, further samples that are motion count as noise.

        Raises:
            ValueError: the shape is wrong, or a number is not finite or beyond 5e99.
        """
        rows = np.ascontiguousarray(y, dtype=np.float64)
        if moving is None:
            self.native.add(rows)
        else:
            self.native.add_at_rest(rows, np.ascontiguousarray(moving).view(np.uint8), longest)

    def skip(self, count: int) -> None:
        """Record that `count` samples of all lanes were lost before the next sample."""
        self.native.skip(count)

    def merge(self, other: "Octaves") -> None:
        """Add all that `other` contains, as if the record of `other` followed this one after a break.

        Raises:
            ValueError: `other` has another number of lanes (axes) or another memory.
        """
        self.native.merge(other.native)

    def copy(self) -> "Octaves":
        """Return an independent copy, which another thread may use."""
        result = Octaves.__new__(Octaves)
        result.native = self.native.copy()
        return result

    def save(self) -> bytes:
        """Return the whole state, from which `restore` can continue."""
        return self.native.save()

    @classmethod
    def restore(cls, lanes: int, memory_samples: float, data: bytes) -> "Octaves":
        """Return spectra that continue from the state that `save` returned.

        Raises:
            ValueError: the state is damaged, or had other lanes or another memory.
        """
        result = cls(lanes, memory_samples)
        result.native.load(data)
        return result

    @property
    def samples(self) -> int:
        """The number of samples that each lane (axis) has received so far, whether they were used or not."""
        counts, _ = self.native.counts(0)
        return counts[0] + counts[-2]

    def counts(self, lane: int) -> Counts:
        """Return the counts of what happened to the samples of a lane so far."""
        counts, constant = self.native.counts(lane)
        taken, _, bridged, lost, gaps, knocks, knocked, steps, changes, *rest = counts
        return Counts(taken - knocked, bridged, lost, gaps, knocks, knocked, steps, changes, constant, *rest)

    @property
    def noticed(self) -> int:
        """Number of steps of the offset and changes of the noise's level so far, in all lanes (axes)."""
        return self.native.noticed()

    def periodogram(self, lane: int, h: float) -> Periodogram:
        """Return the spectrum of a lane (axis) with the weights of its ordinates. `h`: sampling period [s].

        The periodogram's `n` is the `n` of `Parts`.

        Raises:
            ValueError: the lane is constant, h is not positive, or there are too few samples yet.
        """
        return self.lines_and_drift(lane, h)[0]

    def lines_and_drift(self, lane: int, h: float) -> tuple[Periodogram, Drift | None]:
        """Return the spectrum as `periodogram` does, and the drift of the record.

        The drift is subtracted if the record is long or the drift is large.

        Raises:
            ValueError: for the same reasons as in `periodogram`.
        """
        if not (math.isfinite(h) and h > 0):
            raise ValueError(f"h is a sampling period in s and must be > 0, got {h}")
        if self.counts(lane).constant:
            raise ValueError("y is constant: there is no noise in it")
        found = self.parts(lane)
        if not (found.welch or found.whole):
            check_enough(0, self.samples)
        return put_together(found.welch + found.whole, h, found.n), found.drift

    def parts(self, lane: int) -> Parts:
        """Return the spectrum of a lane in parts: each octave, and the record at reduced rate."""
        welch, values, lengths = self.native.spectrum(lane)
        depth = len(welch)
        octaves = [
            _welch_lines(level, np.frombuffer(power), blocks, effective)
            for level, (power, blocks, effective) in enumerate(welch)
            if blocks > 0
        ]
        stretches = _stretches(np.frombuffer(values, np.float32), np.frombuffer(lengths, np.int32))
        amplitudes: list[Array] = []
        whole = [_whole_lines(depth, y, amplitudes) for y in stretches]
        longest = max((len(y) for y in stretches), default=0)
        n = (longest << depth) if longest else BLOCK << max(depth - 1, 0)
        return Parts(octaves, whole, depth, drift_of(amplitudes, depth), n)

    def cells(self, lane: int, h: float) -> list[BandCells]:
        """Return the power of each octave over time, with the highest octave first.

        `h`: sampling period [s].
        """
        _, levels = self.native.cells(lane)
        result = []
        for level, (data, scales) in enumerate(levels):
            first, counts, mean, squares = np.frombuffer(data).reshape(-1, 4).T
            if len(first) == 0:
                continue
            lines = np.array([_FIRST_LINE - 0.5, _FIRST_LINE + _LINES[level > 0] - 0.5])
            low, high = (lines / (BLOCK * h * 2**level)).tolist()
            with np.errstate(invalid="ignore", divide="ignore"):
                variance = np.where(counts > 1, squares / (counts - 1), np.nan)
            pairs, by_scale = np.frombuffer(scales).reshape(-1, 2).T
            result.append(
                BandCells(
                    low,
                    high,
                    counts,
                    mean + math.log(2.0**level),
                    variance,
                    first.astype(np.int64),
                    BLOCK // 2 << level,
                    pairs,
                    by_scale,
                )
            )
        return result

    def allan(self, lane: int) -> AllanPoints:
        """Return the Allan variances of a lane (axis)."""
        return AllanPoints(*self.native.allan(lane))


def put_together(parts: Sequence[Lines], h: float, n: int) -> Periodogram:
    """Join the parts of a spectrum in the order of rising frequency. There is at least one part.

    `n`: number of samples, as in `Periodogram`.

    Raises:
        ValueError: there are too few frequencies for a fit.
    """
    # `parts` begins with the highest octave. Without gaps, frequencies rise from the last part to the first.
    lam, power, weight = map(np.concatenate, zip(*reversed(parts), strict=True))
    if not (lam[1:] > lam[:-1]).all():
        lam, power, weight = in_order(*map(np.concatenate, zip(*parts, strict=True)))
    check_enough(len(lam), n)
    return Periodogram(lam, power, h, n, weight)


def _welch_lines(level: int, power: Array, blocks: float, effective: float) -> Lines:
    lam, gain = _welch_gain(level, len(power))
    weight = effective / (_HANN_LINES + _HALF_OVERLAP * (1 - 1 / max(effective, 1)))
    return lam, power * (gain / blocks), np.full(len(power), weight)


@functools.cache
def _welch_gain(level: int, lines: int) -> tuple[Array, Array]:
    """Return an octave's frequencies, and the factors that turn the mean |FFT|² of its blocks into powers."""
    own = np.asarray(2 * np.pi / BLOCK * (_FIRST_LINE + np.arange(lines)), dtype=np.float64)
    return own / 2**level, 2.0**level / _HANN_POWER / _passed(own, level)


def _whole_lines(level: int, y: NDArray[np.float32], amplitudes: list[Array]) -> Lines:
    """Return frequencies, powers and weights of `y`, a stretch at a rate that was halved `level` times.

    A cubic, the drift, is subtracted if the rate was halved or the drift is large. Its coefficients are
    appended to `amplitudes` in any case.
    """
    m = len(y)
    lam, gain = _whole_gain(level, m)
    values = y.astype(np.float64)
    values -= values.mean()
    cubic, found = cubic_through(values)
    amplitudes.append(found)
    if level or is_large(values, found):
        values -= cubic
    spectrum = np.fft.rfft(values)[LOWEST : LOWEST + len(lam)]
    return lam, (spectrum.real**2 + spectrum.imag**2) * gain, np.ones(len(lam))


@functools.lru_cache(maxsize=8)
def _whole_gain(level: int, m: int) -> tuple[Array, Array]:
    """Return the frequencies for a stretch of m samples, and the factors that convert |FFT|² into power.

    `level`: number of times that the sampling rate was halved.
    """
    last = (m - 1) // 2 if level == 0 else min((m - 1) // 2, math.ceil(JOIN * m / (2 * np.pi)) - 1)
    own = np.asarray(2 * np.pi * np.arange(LOWEST, last + 1) / m, dtype=np.float64)
    return own / 2**level, 2.0**level / m / _passed(own, level)


def _stretches(values: NDArray[np.float32], lengths: NDArray[np.int32]) -> list[NDArray[np.float32]]:
    ends = itertools.accumulate(lengths.tolist())
    parts = (values[end - length : end] for end, length in zip(ends, lengths.tolist(), strict=True))
    return [part for part in parts if len(part) >= SHORTEST]


def _passed(own: Array, level: int) -> Array:
    """Return the power gain of all filters that samples pass before their rate is halved `level` times.

    `own`: frequencies [rad a sample of the reduced rate], up to 0.7 π.
    """
    return np.interp(own, _GRID, _passed_on_grid(level))


_GRID = np.linspace(0, 0.71 * np.pi, 2001)
"""Frequencies [rad a sample of the reduced rate] at which `_passed_on_grid` computes the gain of the filters.
Interpolated between them, the gain is accurate to seven digits.
"""


@functools.cache
def _passed_on_grid(level: int) -> Array:
    if level == 0:
        return np.ones_like(_GRID)
    last = np.array(_native.half_band_gains(_GRID / 2**level))
    return np.asarray(_passed_on_grid(level - 1) * last**2)


def in_order(lam: Array, power: Array, weight: Array) -> Lines:
    """Return the spectrum in the order of rising frequency. Values at equal frequencies are averaged."""
    order = np.argsort(lam)
    lam, power, weight = lam[order], power[order], weight[order]
    unique, place = np.unique(lam, return_inverse=True)
    total = np.bincount(place, weight).astype(np.float64)
    return unique, np.bincount(place, weight * power) / total, total
