"""Guess which samples to leave out of the first analysis of an axis, because the sensor moved.

Later the tracker detects motion (`identification.sensor_events`), since it knows the noise of the sensor at
rest. But that noise has to be found first, from samples at rest. So the first analysis guesses, without any
model, which samples these are.

As in the live fit (firmware/core/engine/gate.hpp), samples are checked in chunks of 128. The power of a chunk
is the variance of its samples, without the sample furthest from the chunk's mean. A chunk is a knock in two
cases:
- its power is sixteen times the usual power;
- its mean is further from the usual offset than the live fit allows for a single sample.

A group of knocks at least eight chunks long is motion if two conditions are met. At least one chunk of the
group must be a knock by its power. Its samples must follow each other smoothly; samples of increased noise do
not.
"""

import math

import numpy as np
from numpy.typing import NDArray

from fltea.identification.fine_peaks import CHUNK, MOST_DEVIATIONS
from fltea.identification.gaps import bridge, cut
from fltea.identification.left_out import LeftOut
from fltea.identification.load import Series
from fltea.records.arrays import Array

KNOCK, IN_A_ROW = 16.0, 8
"""A chunk of samples is a knock if its power is more than KNOCK times the usual power. A group of knocks may
be motion if it is at least IN_A_ROW chunks long. Both numbers are as in gate.hpp.
"""
SMOOTH = 0.5
"""Samples follow each other smoothly if the differences between successive samples are small. Their mean
square must be less than this fraction of the mean square that independent samples of the same variance have.
"""


def likely_motion(series: Series) -> LeftOut:
    """Return the samples that are probably in motion, which the first analysis of an axis leaves out."""
    n = len(series.y)
    parts = [(begin, series.y[begin:end]) for begin, end, _ in cut(n, series.gaps, bridge(n, series.gaps))]
    chunks = [_chunks(np.asarray(y, dtype=np.float64)) for _, y in parts]
    mean, power, steps, resolution = (np.concatenate(one) for one in zip(*chunks, strict=True))
    if len(power) < 2 * IN_A_ROW:
        return LeftOut()
    # The usual power is the mean power of all chunks whose power is at most KNOCK times the median power. The
    # live fit leaves the other chunks out, too.
    usual = float(power[power <= KNOCK * np.median(power)].mean())
    usual = max(usual, float(np.min(resolution)) ** 2 / 12)
    apart = np.abs(mean - np.median(mean))
    knock = power > KNOCK * usual
    moved = knock | (apart > MOST_DEVIATIONS * math.sqrt(usual))
    spans, at = [], 0
    for start, y in parts:
        count = len(y) // CHUNK
        for begin, end in _runs(moved[at : at + count]):
            inside = slice(at + begin, at + end)
            smooth = steps[inside].sum() < SMOOTH * 2 * (power + apart**2)[inside].sum()
            # In a chunk that is a knock only by its mean, the offset may just have drifted. Drift is slow: it
            # gives no chunk the power of a knock. So a span without such a chunk is drift.
            if smooth and knock[inside].any():
                spans.append((start + begin * CHUNK, start + end * CHUNK))
        at += count
    return LeftOut(tuple(spans))


def is_smooth(y: Array) -> bool:
    """Whether samples (n,) follow each other as smoothly as in a motion; noise does not."""
    steps = np.diff(y)
    return float(steps @ steps) < SMOOTH * 2 * float(((y - np.median(y)) ** 2).sum())


def _chunks(y: Array) -> tuple[Array, Array, Array, Array]:
    """Return four arrays with a value for each chunk.

    They are the mean of its samples, the power about this mean, the mean square of the differences between
    successive samples, and the smallest such difference that is not 0.
    """
    whole = y[: len(y) // CHUNK * CHUNK].reshape(-1, CHUNK)
    mean = whole.mean(axis=1)
    apart = np.abs(whole - mean[:, np.newaxis])
    largest = apart.max(axis=1, initial=0.0)
    power = ((apart**2).sum(axis=1) - largest**2) / (CHUNK - 1)
    steps = np.abs(np.diff(whole, axis=1))
    least = np.where(steps > 0, steps, np.inf).min(axis=1, initial=np.inf)
    return mean, power, (steps**2).mean(axis=1), np.where(np.isfinite(least), least, largest)


def _runs(knock: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return begin and end of each group of knocks, in chunks.

    Knocks up to IN_A_ROW chunks apart belong to one group. Groups of fewer than IN_A_ROW chunks are left out.
    """
    at = np.flatnonzero(knock)
    if not len(at):
        return []
    new = np.flatnonzero(np.diff(at) > IN_A_ROW) + 1
    runs = [(int(run[0]), int(run[-1]) + 1) for run in np.split(at, new)]
    return [(begin, end) for begin, end in runs if end - begin >= IN_A_ROW]
