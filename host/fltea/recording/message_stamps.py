"""Measures sampling rate and lost samples by the time stamps of messages, and how reliable the stamps are.

A driver stamps samples with the sensor's clock or with its computer's clock. The sensor samples evenly, but
the computer's stamps may be milliseconds late. So one late stamp does not mean a lost sample: the next stamps
may be in time again. If a sample was lost, all later stamps are a period later than without the loss. Only
then it counts as lost. Messages are numbered in the order of arrival.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fltea.recording.sample_times import EVEN_SHARE, EVENNESS

Times = NDArray[np.int64]

AROUND = 64
"""Number of samples before and after a gap from which the number of lost samples is found. A driver may
deliver up to this many samples at once.
"""

LATE = 1.5
"""Steps longer than this many periods are examined as gaps."""

ALIKE = 0.1
"""If a stamp follows the previous one in less than this many periods, it is taken as a repetition. A repeated
stamp may be earlier than its sample, so no gap is measured from it.
"""

SET_BACK = 10
"""A step backwards by more than this many periods means that the clock was set."""

SET_FORWARD_NS = 1_000_000_000
"""If the stamps jump forward by more than this [ns], and the arrival times show no gap, the clock was
changed.
"""

STEPS, MORE = 1000, 1.05
"""If samples come in batches, the mean step is measured over STEPS steps. It is increased by the factor MORE,
so that pauses between batches do not count as gaps.
"""

MOST_PASSES, SAME = 5, 1e-6
"""The iteration for the period ends after MOST_PASSES rounds, or when the period changes by at most the
proportion SAME.
"""

LEAST_IN_BATCHES = 3
"""Smallest number of lost samples that can be detected if samples come in batches."""

SURE = 100
"""The number of samples lost in a gap is the gap's length divided by the period. Up to this number, it is
certain even if the period is only nearly right. So such gaps are used to measure the period.
"""

MANY = 1 << 20
"""Medians of the steps between time stamps are taken from at most this number of steps. If there are more,
evenly spaced ones are used.
"""

WILD_NS = 60_000_000_000
"""Arrival times are not used if a step between two of them is wrong by more than this [ns].

The right step is the difference of the two sequence numbers, times the sampling period.
"""


class Stamps(NamedTuple):
    """What the time stamps of n samples show.

    `period_ns`: sampling period [ns].
    `gap_row`: rows before which samples were lost. `missing`: number of samples lost before each of them.
    `epoch_row`: rows before which the clock was set. The number of samples lost there is unknown.
    `uneven`: number of steps between stamps that differ from the period by over a fifth of it.
    `alike`: number of stamps that equal the previous one. `backward`: number of steps backwards.
    `spread_ns`: root mean square deviation of the steps from the period, without gaps [ns].
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
        """Return the sequence numbers of the rows from `begin` to `end`, without those of lost samples."""
        lost = np.concatenate([[0], np.cumsum(self.missing)])
        rows = np.arange(begin, end)
        return np.asarray(rows + lost[np.searchsorted(self.gap_row, rows, "right")])

    def epoch(self, begin: int, end: int) -> Times:
        """Return the epoch number of each row from `begin` to `end`.

        The epoch number rises where the clock was set.
        """
        return np.searchsorted(self.epoch_row, np.arange(begin, end), "right").astype(np.int64)


def even(period_ns: float) -> Stamps:
    """Return `Stamps` for evenly spaced samples of which only the sampling period is known."""
    none = np.empty(0, np.int64)
    return Stamps(period_ns, none, none, none, 0, 0, 0, 0.0)


def judge(times_ns: Times, arrival_ns: Times | None) -> Stamps:
    """Analyse the stamps (n,), n > 1, of messages, and their arrival times if these are known.

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
    """Return whether too many steps between stamps differ from the period for a sensor's clock."""
    return stamps.uneven > (1 - EVEN_SHARE) * max(samples - 1, 1)


def is_arrival(arrival_ns: Times, sequence: Times, period_ns: float) -> bool:
    """Return whether arrival times advance about as sequence numbers times the period do (see WILD_NS)."""
    off = np.abs(np.diff(arrival_ns) - np.diff(sequence) * period_ns)
    return bool(len(off) == 0 or off.max() <= WILD_NS)


def _first_guess(times_ns: Times, steps: Times) -> tuple[float, bool]:
    """Return a first value of the period, and whether samples come in batches.

    The period is the median step between stamps. In batches, most steps are too short, so the mean step is
    used. It is slightly increased, so that pauses between batches do not count as gaps.
    """
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
    """Return the rows before which the clock was set back or forward.

    It was set forward where the stamps jump and the arrival times do not.
    """
    was_set = steps < -SET_BACK * period_ns
    if arrival_ns is not None:
        arrivals = np.diff(arrival_ns)
        ahead = steps > max(SET_FORWARD_NS, LATE * period_ns)
        was_set |= ahead & (arrivals >= 0) & (arrivals < steps // 2)
    return np.flatnonzero(was_set) + 1


def _gaps(
    times_ns: Times, steps: Times, period_ns: float, epoch_row: Times, in_batches: bool
) -> tuple[Times, Times]:
    """Return the rows before which samples were lost, and the number of samples lost before each.

    Stamps may be late by different times, which changes the length of a gap. So the length is measured from
    the least late stamp shortly before the gap to the least late one shortly after it. Stamps that repeat the
    previous stamp are not used for this, except in batches, where most stamps repeat.
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
        if row == of_epochs[epoch]:  # the step before this row comes from setting the clock, not from a loss
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
    """Return the sampling period [ns]: the duration of all stretches, divided by their number of periods.

    Stretches end at gaps of more than SURE samples, and where the clock was set. A shorter gap of n lost
    samples counts as n + 1 periods.
    """
    sure = missing <= SURE
    breaks = np.union1d(gap_row[~sure], epoch_row)
    begin = np.concatenate([[0], breaks]).astype(np.int64)
    end = np.concatenate([breaks, [len(times_ns)]]).astype(np.int64) - 1
    count = int((end - begin).sum()) + int(missing[sure].sum())
    span_ns = float((times_ns[end] - times_ns[begin]).astype(np.float64).sum())
    return span_ns / count if count and span_ns > 0 else period_ns
