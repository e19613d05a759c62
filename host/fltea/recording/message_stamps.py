"""What the times of messages tell: the rate, what is missing, and how far they can be believed (pure).

A driver stamps samples with its computer's clock, late by milliseconds, or with the sensor's own. Either way
the sensor measures evenly. So messages are numbered in the order in which they came, and a sample is
missing only where the stamps are late and stay late.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fltea.recording.sample_times import EVEN_SHARE, EVENNESS

Times = NDArray[np.int64]

AROUND = 64
"""Samples before and after a gap that tell how long it is: as many as a driver hands over in one go."""

LATE = 1.5
"""Periods from which on a step is looked at."""

ALIKE = 0.1
"""Periods: a stamp so close behind the one before repeats it, and may be too early."""

SET_BACK = 10
"""Periods: a clock that jumps back by no more still leaves no doubt how many samples there are."""

SET_FORWARD_NS = 1_000_000_000
"""A jump of the stamps that arrivals know nothing of is of the clock, not a gap."""

STEPS, MORE = 1000, 1.05
"""Over so many a rate is found where one step tells nothing; a period too long takes no batch for a gap."""

MOST_PASSES, SAME = 5, 1e-6
"""Until the period does not change any more."""

LEAST_IN_BATCHES = 3
"""Missing samples that can be told where samples come in batches."""

SURE = 100
"""Missing samples whose number does not depend on how well the period is known."""

MANY = 1 << 20
"""Steps that are enough for a median."""

WILD_NS = 60_000_000_000
"""Arrivals whose steps are so far from those of the stamps are no times of arrival."""


class Stamps(NamedTuple):
    """What the stamps tell of n samples.

    period_ns: between two of them. gap_row, missing: rows before which samples are missing, and how many.
    epoch_row: rows before which the clock was set, so that nobody knows what is missing. uneven, alike,
    backward: steps that are off by more than a fifth, that are none, and that run backwards. spread_ns: of
    the steps that are no gaps, the root of the mean square.
    """

    period_ns: float
    gap_row: Times
    missing: Times
    epoch_row: Times
    uneven: int
    alike: int
    backward: int
    spread_ns: float

    def sequence(self, begin: int, end: int) -> Times:
        """Numbers of the samples in some rows, missing ones counted."""
        lost = np.concatenate([[0], np.cumsum(self.missing)])
        rows = np.arange(begin, end)
        return np.asarray(rows + lost[np.searchsorted(self.gap_row, rows, "right")])

    def epoch(self, begin: int, end: int) -> Times:
        """Number of the epoch of some rows."""
        return np.searchsorted(self.epoch_row, np.arange(begin, end), "right").astype(np.int64)


def even(period_ns: float) -> Stamps:
    """Return stamps of samples of which only the period is known."""
    none = np.empty(0, np.int64)
    return Stamps(period_ns, none, none, none, 0, 0, 0, 0.0)


def judge(times_ns: Times, arrival_ns: Times | None) -> Stamps:
    """Look at stamps (n,), n > 1, and at the arrivals of the same messages, if they are known.

    Raises:
        ValueError: the stamps do not advance.
    """
    steps = np.diff(times_ns)
    period_ns, in_batches = _first_guess(times_ns, steps)
    epoch_row = _clock_was_set(steps, arrival_ns, period_ns)
    for _ in range(MOST_PASSES):
        before_ns = period_ns
        gap_row, missing = _gaps(times_ns, steps, period_ns, epoch_row, in_batches)
        period_ns = _refined(times_ns, gap_row, missing, epoch_row, period_ns)
        if abs(period_ns - before_ns) <= SAME * period_ns:
            break
    off = np.abs(steps - period_ns)
    off[gap_row - 1] = 0
    off[epoch_row - 1] = 0
    return Stamps(
        period_ns,
        gap_row,
        missing,
        epoch_row,
        int(np.count_nonzero(off > EVENNESS * period_ns)),
        int(np.count_nonzero(steps == 0)),
        int(np.count_nonzero(steps < 0)),
        float(np.sqrt(np.mean(off * off))),
    )


def is_uneven(stamps: Stamps, samples: int) -> bool:
    """Whether the stamps are less even than a device's clock."""
    return stamps.uneven > (1 - EVEN_SHARE) * max(samples - 1, 1)


def is_arrival(arrival_ns: Times, sequence: Times, period_ns: float) -> bool:
    """Whether arrivals can be those of samples with these numbers."""
    off = np.abs(np.diff(arrival_ns) - np.diff(sequence) * period_ns)
    return bool(len(off) == 0 or off.max() <= WILD_NS)


def _first_guess(times_ns: Times, steps: Times) -> tuple[float, bool]:
    """The commonest step, or of samples that come in batches the mean of many; and whether they do."""
    thin = steps[:: -(-len(steps) // MANY)]
    typical = float(np.median(thin))
    far = min(STEPS, max(1, len(steps) // 4))
    mean = float(np.median((times_ns[far:] - times_ns[:-far])[:: -(-len(times_ns) // MANY)])) / far
    if mean <= 0:
        raise ValueError("the stamps do not advance")
    if typical > mean / 2 and np.mean(np.abs(thin - typical) <= EVENNESS * typical) >= 0.5:
        return typical, False
    return mean * MORE, True


def _clock_was_set(steps: Times, arrival_ns: Times | None, period_ns: float) -> Times:
    """Rows before which the clock jumped: back, or forward without a gap of the arrivals."""
    was_set = steps < -SET_BACK * period_ns
    if arrival_ns is not None:
        arrivals = np.diff(arrival_ns)
        ahead = steps > max(SET_FORWARD_NS, LATE * period_ns)
        was_set |= ahead & (arrivals >= 0) & (arrivals < steps // 2)
    return np.flatnonzero(was_set) + 1


def _gaps(
    times_ns: Times, steps: Times, period_ns: float, epoch_row: Times, in_batches: bool
) -> tuple[Times, Times]:
    """Rows before which samples are missing, and how many.

    Before and after a late step, the samples that are least late tell the time of theirs. A stamp that
    repeats the one before tells nothing, except in batches, where most do.
    """
    rows, missing = [], []
    of_epochs = [0, *epoch_row.tolist(), len(times_ns)]
    late = np.flatnonzero(steps > LATE * period_ns) + 1
    epochs = np.searchsorted(epoch_row, late, "right")
    begin = 0
    fewest, around = (LEAST_IN_BATCHES, AROUND) if in_batches else (1, 1)
    ahead = np.arange(AROUND) * period_ns
    tells = np.ones(len(times_ns), np.bool_)
    if not in_batches:
        tells[1:] = steps > ALIKE * period_ns
    for row, epoch in zip(late.tolist(), epochs.tolist(), strict=True):
        begin = max(begin, of_epochs[epoch], row - AROUND)
        if row == of_epochs[epoch]:  # the clock was set here
            continue
        end = min(row + AROUND, of_epochs[epoch + 1])
        after = times_ns[row:end] - times_ns[row - 1] - ahead[: end - row]
        before = times_ns[begin:row] - times_ns[row - 1] + ahead[: row - begin][::-1]
        told = before[tells[begin:row]]
        least = after[tells[row:end]].min() - (told if len(told) else before).min()
        lost = round(float(least) / period_ns) - 1
        if lost >= fewest and end - row >= around:
            rows.append(row)
            missing.append(lost)
            begin = row
    return np.array(rows, np.int64), np.array(missing, np.int64)


def _refined(times_ns: Times, gap_row: Times, missing: Times, epoch_row: Times, period_ns: float) -> float:
    """The mean step over all stretches without a long gap."""
    sure = missing <= SURE
    breaks = np.union1d(gap_row[~sure], epoch_row)
    begin = np.concatenate([[0], breaks]).astype(np.int64)
    end = np.concatenate([breaks, [len(times_ns)]]).astype(np.int64) - 1
    count = int((end - begin).sum()) + int(missing[sure].sum())
    span_ns = float((times_ns[end] - times_ns[begin]).astype(np.float64).sum())
    return span_ns / count if count and span_ns > 0 else period_ns
