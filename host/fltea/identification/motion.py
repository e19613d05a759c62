"""Guess which samples to leave out of the first analysis of an axis, because the sensor moved.

Later the tracker detects motion (`identification.sensor_events`), since it knows the noise of the sensor at
rest. But that noise has to be found first, from samples at rest. So the first analysis guesses, without any
model, which samples these are. As in the live fit (firmware/core/engine/gate.hpp), samples are checked in
chunks of 128. A chunk is a knock if its power about its own mean, without its largest sample, is sixteen
times the usual power. Eight such chunks in a row are motion if their samples follow each other smoothly,
which samples of increased noise do not. A chunk also counts as a knock if its mean is further from the usual
offset than the live fit allows for a single sample. But at least one of the eight chunks must be a knock by
its power.
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
"""A knock has at least KNOCK times the usual power, and IN_A_ROW knocks in a row are motion, as in gate.hpp.
"""
SMOOTH = 0.5
"""Samples follow each other smoothly if the mean square of their steps is at most this fraction of that of
independent samples.
"""


def likely_motion(series: Series) -> LeftOut:
    """Return the motion to leave out of the first analysis."""
    n = len(series.y)
    parts = [(begin, series.y[begin:end]) for begin, end, _ in cut(n, series.gaps, bridge(n, series.gaps))]
    chunks = [_chunks(np.asarray(y, dtype=np.float64)) for _, y in parts]
    mean, power, steps, resolution = (np.concatenate(one) for one in zip(*chunks, strict=True))
    if len(power) < 2 * IN_A_ROW:
        return LeftOut()
    # The usual power is the mean power of the chunks without a knock; the live fit leaves knocks out, too.
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
            # Drift may also take the means of chunks as far from the median as motion does. But drift is
            # slow, so none of its chunks has the power of a knock.
            if smooth and knock[inside].any():
                spans.append((start + begin * CHUNK, start + end * CHUNK))
        at += count
    return LeftOut(tuple(spans))


def is_smooth(y: Array) -> bool:
    """Whether samples (n,) follow each other as smoothly as in a motion; noise does not."""
    steps = np.diff(y)
    return float(steps @ steps) < SMOOTH * 2 * float(((y - np.median(y)) ** 2).sum())


def _chunks(y: Array) -> tuple[Array, Array, Array, Array]:
    """Return for each chunk: mean, power, mean square of the steps, smallest step."""
    whole = y[: len(y) // CHUNK * CHUNK].reshape(-1, CHUNK)
    mean = whole.mean(axis=1)
    apart = np.abs(whole - mean[:, np.newaxis])
    largest = apart.max(axis=1, initial=0.0)
    power = ((apart**2).sum(axis=1) - largest**2) / (CHUNK - 1)
    steps = np.abs(np.diff(whole, axis=1))
    least = np.where(steps > 0, steps, np.inf).min(axis=1, initial=np.inf)
    return mean, power, (steps**2).mean(axis=1), np.where(np.isfinite(least), least, largest)


def _runs(knock: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return begin and end of each group of knocks that is at least IN_A_ROW chunks long.

    Knocks up to IN_A_ROW chunks apart belong to one group.
    """
    at = np.flatnonzero(knock)
    if not len(at):
        return []
    new = np.flatnonzero(np.diff(at) > IN_A_ROW) + 1
    runs = [(int(run[0]), int(run[-1]) + 1) for run in np.split(at, new)]
    return [(begin, end) for begin, end in runs if end - begin >= IN_A_ROW]
