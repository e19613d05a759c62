"""Estimate the period with which the power of the noise in an octave rises and falls.

The running sums that detect a changing power do not keep its course over time. So the course is computed from
the samples here: it is the logarithm of the octave's power in short blocks. If the change is periodic, the
autocorrelation of the course is high again after one, two and three periods.
"""

import math

import msgspec
import numpy as np

from fltea.records.arrays import Array
from fltea.spectrum.stationarity import Change

BLOCKS_A_SWING = 12
"""The time from the highest to the lowest power is divided into this number of blocks."""
LEAST_FREEDOM = 4.0
"""A block's duration [s] times the octave's width [Hz] is at least this, so that the power in a block is well
determined.
"""
PERIODS = 4
"""The record has to hold at least this number of periods."""
COMES_BACK = 0.6
"""If the power of the noise is periodic, its autocorrelation is high again after one, two and three periods:
at least this proportion of the autocorrelation at a lag of one block.
"""
AS_HIGH = 0.8
"""The autocorrelation's peaks that reach at least this proportion of the highest value are candidates for the
period. The one with the shortest lag is taken.
"""
PHASES = 24


def with_period(change: Change, y: Array, h: float) -> Change:
    """Return `change`, how the power in an octave varies over time, with the period if there is one.

    A periodic change also gets a new size, that of its periodic part. `h`: sampling period [s].
    """
    if change.is_step:
        return change
    half_s = change.half_s or len(y) * h / 16
    width = change.high_hz - change.low_hz
    block = max(round(max(half_s / BLOCKS_A_SWING, LEAST_FREEDOM / width) / h), 1)
    course = _course(y, h, change, block)
    period = _period(course)
    if period is None:
        return change
    size = math.exp(2 * math.sqrt(_folded(course, period)))
    return msgspec.structs.replace(change, period_s=period * block * h, size=size)


def _course(y: Array, h: float, change: Change, block: int) -> Array:
    """Return the log power in the octave of `change` for each of m blocks, less its mean, (m,)."""
    spectrum = np.fft.rfft(y)
    hz = np.fft.rfftfreq(len(y), h)
    spectrum[(hz < change.low_hz) | (hz > change.high_hz)] = 0
    inside = np.fft.irfft(spectrum, len(y))
    power = (inside[: len(y) // block * block] ** 2).reshape(-1, block).mean(axis=1)
    course = np.log(np.maximum(power, 1e-12 * power.mean()))
    return np.asarray(course - course.mean())


def _period(course: Array) -> float | None:
    """Return the period of a power over time, as a number of blocks; None if the power is not periodic."""
    m = len(course)
    spectrum = np.fft.rfft(course, 2 * m)
    again = np.fft.irfft(np.abs(spectrum) ** 2)[:m] / np.arange(m, 0, -1)
    most = m // PERIODS
    below = np.flatnonzero(again[:most] < 0)
    if not len(below) or not again[1] > 0:
        return None
    begin = int(below[0])
    lags = np.arange(begin, most)
    is_top = (again[lags] >= again[lags - 1]) & (again[lags] >= again[lags + 1])
    tops = lags[is_top & (again[lags] >= AS_HIGH * again[lags].max())]
    if not len(tops):
        return None
    period = _top(again, float(tops[0]), 1.0)
    # The autocorrelation has a peak at each multiple of the period. Each further peak gives the period more
    # exactly. Each peak is searched for within an eighth of a period of where it is expected.
    multiple = 1
    while (multiple + 1) * period < m / 2:
        multiple += 1
        period = _top(again, multiple * period, max(period / 8, 1.0)) / multiple
        if multiple <= PERIODS - 1 and again[round(multiple * period)] < COMES_BACK * again[1]:
            return None
    return period if multiple >= 2 and again[round(period)] >= COMES_BACK * again[1] else None


def _top(values: Array, at: float, around: float) -> float:
    """Return the interpolated index of the highest of `values` (m,) within `around` of index `at`.

    The interpolation is by a parabola.
    """
    low, high = max(round(at - around), 1), min(round(at + around), len(values) - 2)
    top = low + int(values[low : high + 1].argmax())
    before, here, after = values[top - 1 : top + 2].tolist()
    bend = before - 2 * here + after
    return top + (float(np.clip((before - after) / 2 / bend, -0.5, 0.5)) if bend < 0 else 0.0)


def _folded(course: Array, period: float) -> float:
    """Return the variance of the periodic part of `course`, the logarithm of a power over time.

    `period`: in blocks. Values at the same phase of the period are averaged. The result is the variance of
    these means, less the variance that they would have by chance.
    """
    phase = (np.arange(len(course)) / period % 1 * min(PHASES, int(period))).astype(np.int64)
    counts = np.bincount(phase)
    means = np.bincount(phase, course) / np.maximum(counts, 1)
    left = float(np.mean((course - means[phase]) ** 2))
    share = counts / counts.sum()
    return max(float(share @ means**2) - left * len(counts) / len(course), 0.0)
