"""Numbers samples by their times, by the rules of `sample_times`: a long step lacks samples (pure)."""

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
"""How much of what is left over goes on to the next step: the rate is known to 0.1 %, or better."""

FEW, STRETCH, FADED = 8, 256, 2048
"""More steps than the first are numbered together; LEAK to the second is a number, to the third 0."""

NO_DOUBT = 0.499
"""Of a period: what is left over does not change a number."""

DOUBT_OF_ROUNDED = 0.6
"""Of a period: more than this has to be left over before a sample counts as missing, else half. Of times
rounded to 0.99 of a period the steps that are longer leave some 0.5 over, wherever the first of them was."""


class Numbered(NamedTuple):
    """Numbers of samples. kept: (rows,) marks those that are one; the others are (samples,).

    begins: marks the samples that begin a new run. elapsed: their times, which always increase.
    """

    kept: Marks
    sequence: Ints
    begins: Marks
    elapsed: Floats


class Numbering:
    """Numbers samples by elapsed times, from 0. period: from one to the next. rate_hz: of the same.

    is_rounded: the times are, to a good part of the period.
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
        """Number the next rows, at least one; marks as of `Elapsed.add`."""
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
        """Steps as numbers of periods, at least 1; what is left over goes on to the next one."""
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
        if len(periods) > FEW:  # where rounding each by itself leaves less than half over, it is right
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
