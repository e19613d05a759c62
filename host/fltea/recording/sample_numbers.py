"""Gives each sample a sequence number that follows from the sample's time.

If the step from one time to the next is several sampling periods long, samples were lost between the two. The
module `sample_times` states the rules.
"""

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
"""The step from one time to the next is a whole number of sampling periods, plus a remainder. The remainders
are summed, and the sum is added to the next step before it is rounded. The sampling rate has an error of up
to 0.1 %, so the sum would grow without end. Therefore it is multiplied at each step by LEAK, or by
LEAK_OF_ROUNDED if the times are rounded.
"""

FEW, STRETCH, FADED = 8, 256, 2048
"""Numbers of steps between times. FEW: up to this many steps are processed one by one. STRETCH: more steps
are processed with numpy, this many at a time. FADED: after this many steps, a remainder is negligible,
since it is multiplied by LEAK (or LEAK_OF_ROUNDED) at each step.
"""

NO_DOUBT = 0.499
"""A limit for the sum of remainders (see LEAK) [periods]. If the sum stays below it at all steps, then each
step may be rounded by itself, which is faster and gives the same numbers.
"""

DOUBT_OF_ROUNDED = 0.6
"""A step between two times is rounded up to one more period, and so to one more lost sample, if its remainder
exceeds this number of periods. This holds for rounded times; for others, the limit is 0.5.

The limit 0.5 would find false losses in rounded times. For example, times that are rounded to multiples of
0.99 periods may give a remainder of about 0.5 although no sample is lost.
"""


class Numbered(NamedTuple):
    """Samples with their sequence numbers.

    `kept`: an array (rows,) that is True for the rows that are samples.

    All other fields have one item for each sample.

    `begins`: True for the first sample after a restart of the sender. `elapsed`: strictly increasing times of
    the samples.
    """

    kept: Marks
    sequence: Ints
    begins: Marks
    elapsed: Floats


class Numbering:
    """Numbers samples, from 0 on, by their times since the first row.

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

        `elapsed`: times since the first row. `begins`: True for the first row after a restart of the sender.
        Both arguments are what `Elapsed.add` returns.
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
        """Return steps between times as whole numbers of periods, at least 1.

        The remainder of a step is added to the next step.
        """
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
        # each step may be rounded by itself if all sums of remainders stay below half a period
        if len(periods) > FEW:
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
