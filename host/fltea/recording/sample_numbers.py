"""Numbers samples by their times, by the rules of `sample_times`: a long step means lost samples."""

import math
from typing import NamedTuple

import numpy as np

from fltea.recording.sample_times import (
    LONGEST_GAP_PERIODS,
    LONGEST_GAP_S,
    Floats,
    Ints,
    Marks,
    differences,
)

LEAK, LEAK_OF_ROUNDED = 0.98, 0.998
"""A step between times is a whole number of periods and a remainder, which is carried to the next step. Each
time it is multiplied by LEAK, or by LEAK_OF_ROUNDED if times are rounded, since the rate is known only to 0.1
% or better.
"""

FEW, STRETCH, FADED = 8, 256, 2048
"""Numbers of steps between times that are numbered together.

Up to FEW steps are numbered one by one, and more steps in stretches of STRETCH steps. After FADED steps, a
remainder has practically vanished.
"""

NO_DOUBT = 0.499
"""Largest remainder, in periods, with which rounding a step to whole periods is certain to be right."""

DOUBT_OF_ROUNDED = 0.6
"""Smallest remainder, in periods, that counts as a lost sample if times are rounded; otherwise it is 0.5.

Rounding a time by 0.99 of a period leaves a remainder of about 0.5 at longer steps.
"""


class Numbered(NamedTuple):
    """Numbered samples. `kept`: marks (rows,) of the rows that are samples.

    Other fields have an item per sample.

    `begins`: marks of samples that begin a new run of the sender. `elapsed`: strictly increasing times of the
    samples.
    """

    kept: Marks
    sequence: Ints
    begins: Marks
    elapsed: Floats


class Numbering:
    """Numbers samples from 0 by their elapsed times.

    `period`: sampling period in the unit of the times. `rate_hz`: sampling rate. `is_rounded`: whether the
    times are rounded to a large part of the period.
    """

    def __init__(self, period: float, rate_hz: float, *, is_rounded: bool = False) -> None:
        self._period = period
        self._leak = LEAK_OF_ROUNDED if is_rounded else LEAK
        self._doubt = DOUBT_OF_ROUNDED if is_rounded else 0.5
        self._longest = period * max(LONGEST_GAP_S * rate_hz, LONGEST_GAP_PERIODS)
        self._last: float | None = None
        self._sequence = -1
        self._ahead = self._shift = 0.0

    def add(self, elapsed: Floats, begins: Marks) -> Numbered:
        """Number the samples in the next rows (at least one).

        `begins`: marks of new runs, as from `Elapsed.add`.
        """
        before = elapsed[0] - self._period if self._last is None else self._last
        steps = differences(elapsed, before)
        self._last = float(elapsed[-1])
        begins = begins | (steps > self._longest)
        kept = begins | (steps > 0)
        if not kept.all():
            steps, elapsed, begins = steps[kept], elapsed[kept], begins[kept]
        periods = steps / self._period
        elapsed = elapsed + self._shift
        if begins.any():
            shift = self._period * np.cumsum(begins & (steps <= self._longest))
            elapsed, self._shift = elapsed + shift, self._shift + float(shift[-1])
            periods[begins] = 1.0
        sequence = self._sequence + np.cumsum(self._whole(periods))
        if len(sequence):
            self._sequence = int(sequence[-1])
        return Numbered(kept, sequence, begins, elapsed)

    def _whole(self, periods: Floats) -> Ints:
        """Return steps as whole numbers of periods, at least 1. A remainder is carried to the next step."""
        off = periods - 1
        if len(off) > FEW and abs(self._ahead) + np.abs(off).max() / (1 - self._leak) < NO_DOUBT:
            last = off[-FADED:]
            self._ahead = self._ahead * self._leak ** len(off) + float(
                last @ self._leak ** np.arange(len(last))[::-1]
            )
            return np.ones(len(off), dtype=np.int64)
        found = np.maximum(1, np.rint(periods)).astype(np.int64)
        for begin in range(0, len(periods), STRETCH):
            part = slice(begin, min(begin + STRETCH, len(periods)))
            found[part] = self._of_stretch(periods[part], found[part])
        return found

    def _of_stretch(self, periods: Floats, rounded: Ints) -> Ints:
        if len(periods) > FEW:  # rounding each step alone is right if all remainders stay below one half
            weights = self._leak ** np.arange(1, len(periods) + 1)
            ahead = weights * (self._ahead + np.cumsum((periods - rounded) / weights))
            if (np.abs(ahead) < NO_DOUBT).all():
                self._ahead = float(ahead[-1])
                return rounded
        found = []
        for step in periods.tolist():
            ahead_now = self._ahead * self._leak + step
            found.append(max(1, math.ceil(ahead_now - self._doubt)))
            self._ahead = max(-0.5, ahead_now - found[-1])
        return np.array(found, dtype=np.int64)
