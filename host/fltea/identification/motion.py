"""When a sensor that should be at rest was moved (pure).

Samples are judged as the live fit judges them (firmware/core/engine/gate.hpp): in chunks of 128, of which one
is a knock if its power about its own mean, the largest sample not counted, is sixteen times the usual. These
sums leave knocks out; after eight in a row they take the new level for the noise. So eight in a row are
motion here, if the samples in them follow each other smoothly, as those of noise that has grown do not. So is
what stays away from the usual offset by as many deviations as the live fit limits samples to.
"""

import math
from collections.abc import Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from fltea.identification.gaps import Stretch
from fltea.identification.sums import CHUNK, MOST_DEVIATIONS
from fltea.records.arrays import Array
from fltea.spectrum.wording import duration, listed

KNOCK, IN_A_ROW = 16.0, 8
"""The same numbers as in gate.hpp: power over the usual, chunks."""
SMOOTH = 0.5
"""Mean square of the steps over that of neighbours that know nothing of each other."""
MOST_TOLD = 3


class Motion(msgspec.Struct, frozen=True):
    """Begin and end in s of each time, and the largest sample then, over the noise at rest."""

    spans_s: tuple[tuple[float, float], ...]
    deviations: float

    @property
    def when(self) -> str:
        """The seconds in words."""
        told = [f"{begin:.0f} to {end:.0f} s" for begin, end in self.spans_s[:MOST_TOLD]]
        if len(self.spans_s) > MOST_TOLD:
            told.append(f"{len(self.spans_s) - MOST_TOLD} times more")
        return f"from {listed(told)}"


def motion(stretches: Sequence[Stretch], h: float) -> Motion | None:
    """Return when there was motion, or None; h: sampling period in s."""
    parts = [_chunks(one.y) for one in stretches]
    mean, power, steps, largest, resolution = (np.concatenate(one) for one in zip(*parts, strict=True))
    if len(power) < 2 * IN_A_ROW:
        return None
    # As the live fit's running mean, which knows of no knock.
    usual = float(power[power <= KNOCK * np.median(power)].mean())
    usual = max(usual, float(np.min(resolution)) ** 2 / 12)
    apart = np.abs(mean - np.median(mean))
    knock = power > KNOCK * usual
    moved = knock | (apart > MOST_DEVIATIONS * math.sqrt(usual))
    spans, top, at, start = [], 0.0, 0, 0
    for one in stretches:
        start += one.missing
        count = len(one.y) // CHUNK
        for begin, end in _runs(moved[at : at + count]):
            inside = slice(at + begin, at + end)
            smooth = steps[inside].sum() < SMOOTH * 2 * (power + apart**2)[inside].sum()
            # Drift goes far, too, but not by a knock.
            if smooth and knock[inside].any():
                spans.append(((start + begin * CHUNK) * h, (start + end * CHUNK) * h))
                top = max(top, float((largest + apart)[inside].max()))
        at, start = at + count, start + len(one.y)
    return Motion(tuple(spans), top / math.sqrt(usual)) if spans else None


def _chunks(y: Array) -> tuple[Array, Array, Array, Array, Array]:
    """Return of each chunk: mean, power, mean square of steps, farthest sample from the mean, least step."""
    whole = y[: len(y) // CHUNK * CHUNK].reshape(-1, CHUNK)
    mean = whole.mean(axis=1)
    apart = np.abs(whole - mean[:, np.newaxis])
    largest = apart.max(axis=1, initial=0.0)
    power = ((apart**2).sum(axis=1) - largest**2) / (CHUNK - 1)
    steps = np.abs(np.diff(whole, axis=1))
    least = np.where(steps > 0, steps, np.inf).min(axis=1, initial=np.inf)
    return mean, power, (steps**2).mean(axis=1), largest, np.where(np.isfinite(least), least, largest)


def _runs(knock: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return begin and end of where knocks are at most IN_A_ROW chunks apart, and take that many in all."""
    at = np.flatnonzero(knock)
    if not len(at):
        return []
    new = np.flatnonzero(np.diff(at) > IN_A_ROW) + 1
    runs = [(int(run[0]), int(run[-1]) + 1) for run in np.split(at, new)]
    return [(begin, end) for begin, end in runs if end - begin >= IN_A_ROW]


def told(found: Motion, duration_s: float) -> str:
    """Return a sentence on it, of a record of so many seconds."""
    return (
        f"The sensor was moved, {found.when} of {duration(duration_s)}: up to {found.deviations:.0f} times "
        "the noise at rest."
    )
