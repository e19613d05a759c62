"""Which samples a first look at an axis leaves out, since the sensor was moved there (pure).

The tracker tells motion (`identification.sensor_events`), by the noise of the sensor at rest. To find that
noise takes samples at rest, so the first look needs a guess which ones these are. It needs no model: samples
are judged as the live fit judges them (firmware/core/engine/gate.hpp), in chunks of 128, of which one is a
knock if its power about its own mean, the largest sample not counted, is sixteen times the usual. Eight in a
row are motion, if the samples in them follow each other smoothly, as those of noise that has grown do not. So
is what stays away from the usual offset by as many deviations as the live fit limits samples to.
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
"""The same numbers as in gate.hpp: power over the usual, chunks."""
SMOOTH = 0.5
"""Mean square of the steps over that of neighbours that know nothing of each other."""


def likely_motion(series: Series) -> LeftOut:
    """Return what the first look leaves out."""
    n = len(series.y)
    parts = [(begin, series.y[begin:end]) for begin, end, _ in cut(n, series.gaps, bridge(n, series.gaps))]
    chunks = [_chunks(np.asarray(y, dtype=np.float64)) for _, y in parts]
    mean, power, steps, resolution = (np.concatenate(one) for one in zip(*chunks, strict=True))
    if len(power) < 2 * IN_A_ROW:
        return LeftOut()
    # As the live fit's running mean, which knows of no knock.
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
            # Drift goes far, too, but not by a knock.
            if smooth and knock[inside].any():
                spans.append((start + begin * CHUNK, start + end * CHUNK))
        at += count
    return LeftOut(tuple(spans))


def is_smooth(y: Array) -> bool:
    """Whether samples (n,) follow each other as those of a motion do, and as those of noise do not."""
    apart = np.diff(y)
    return float(apart @ apart) < SMOOTH * 2 * float(((y - np.median(y)) ** 2).sum())


def _chunks(y: Array) -> tuple[Array, Array, Array, Array]:
    """Return of each chunk: mean, power, mean square of steps, least step."""
    whole = y[: len(y) // CHUNK * CHUNK].reshape(-1, CHUNK)
    mean = whole.mean(axis=1)
    apart = np.abs(whole - mean[:, np.newaxis])
    largest = apart.max(axis=1, initial=0.0)
    power = ((apart**2).sum(axis=1) - largest**2) / (CHUNK - 1)
    steps = np.abs(np.diff(whole, axis=1))
    least = np.where(steps > 0, steps, np.inf).min(axis=1, initial=np.inf)
    return mean, power, (steps**2).mean(axis=1), np.where(np.isfinite(least), least, largest)


def _runs(knock: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return begin and end of where knocks are at most IN_A_ROW chunks apart, and take that many in all."""
    at = np.flatnonzero(knock)
    if not len(at):
        return []
    new = np.flatnonzero(np.diff(at) > IN_A_ROW) + 1
    runs = [(int(run[0]), int(run[-1]) + 1) for run in np.split(at, new)]
    return [(begin, end) for begin, end in runs if end - begin >= IN_A_ROW]
