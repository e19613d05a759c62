"""Estimates a sensor's clock from the fill levels of its FIFO at known times, and numbers the samples.

The sensor does not count lost samples. Their number is computed from the time between the samples before and
after the loss.
"""

import math
from collections import deque
from typing import NamedTuple

from fltea.sources.clock_fit import fit_clock

NS_PER_S = 1_000_000_000
BLOCKS_KEPT = 60
"""The clock fit uses one arrival of each second, over the last so many seconds. A longer time would be worse,
since the sensor's clock drifts as the sensor warms up.
"""

DRIFT = 1e-4
SPREAD_NS = 5_000_000
"""The delays of two kept arrivals differ by at most this [ns]. So the relative error of the sampling period
is at most `SPREAD_NS` / (time between the first and the last kept arrival) + `DRIFT`.
"""
PHASE_NS = 2_000_000
"""Upper bound of the smallest delay of all samples of a second, between the sensor's measurement and the
arrival [ns].
"""
SLACK = 0.5
"""The number of samples in the FIFO may differ from the number that the elapsed time predicts by this much
[samples], plus the largest possible error of the prediction. This error follows from DRIFT, SPREAD_NS and
PHASE_NS.
"""


class Resumed(NamedTuple):
    """Number of samples that were lost before those that wait in the FIFO.

    The true number differs from `missing` by at most `doubt`.
    """

    missing: int
    doubt: int


class Span(NamedTuple):
    """A time between two readings of the host's clock [ns], during which a transfer took place."""

    before_ns: int
    after_ns: int


class FifoClock:
    """Numbers samples from 0 on, and relates these numbers to the host's time.

    `rate_hz`: nominal sampling rate. `clock_error`: largest relative error of this rate before any
    measurement. `next`: sequence number of the next sample. A sample always arrives later than the sensor
    measured it, by a varying delay. So only the arrival with the smallest delay in every second is used for
    the clock fit (`clock_fit`).
    """

    def __init__(self, rate_hz: float, clock_error: float) -> None:
        self.next = 0
        self._last_ns: float | None = None
        self.begin(rate_hz, clock_error)

    def begin(self, rate_hz: float, clock_error: float) -> None:
        """Start to estimate the clock of a sensor that was just set up. It may be another sensor than before.

        The sequence numbers of the samples continue.
        """
        self._nominal_ns = NS_PER_S / rate_hz
        self._block_samples = round(rate_hz)
        self._first_error = clock_error
        self.forget()

    def forget(self) -> None:
        """Forget all measurements of the sensor's clock. The sequence numbers of the samples continue."""
        self._blocks: deque[tuple[int, int]] = deque(maxlen=BLOCKS_KEPT)
        self._earliest: tuple[int, int] | None = None
        self._block_end = 0
        self._period_ns = self._nominal_ns
        self._reference: tuple[int, float] | None = None

    def out_of_step(self, waiting: int, before_ns: int, after_ns: int) -> bool:
        """Return whether the elapsed time contradicts the number of samples that wait in the FIFO.

        `waiting`: number of samples that wait. It was read between `before_ns` and `after_ns`.
        """
        if self._reference is None or self._last_ns is None:
            return False
        least = (before_ns - self._last_ns) / self._period_ns - 1 - self._error(before_ns)
        most = (after_ns - self._last_ns) / self._period_ns + self._error(after_ns)
        return not least - SLACK <= waiting <= most + SLACK

    def resume(self, waiting: int, empty: Span, seen_ns: int) -> Resumed:
        """Skip the sequence numbers of the samples that were lost, and return how many samples these are.

        The time from the last sample before the loss to the first one after it says how many. `empty`:
        interval in which the FIFO was last empty. `waiting`: number of samples in the FIFO at `seen_ns`.
        """
        empty_ns = empty.before_ns
        first_ns = seen_ns - (waiting - 1) * self._period_ns
        latest_ns = max(float(empty_ns), min(first_ns, empty.after_ns + self._period_ns))
        if self._last_ns is None:
            return Resumed(0, 0)
        steps = ((empty_ns + latest_ns) / 2 - self._last_ns) / self._period_ns
        step = max(1, round(steps))
        doubt = 0
        if self._reference is not None:
            error = self._error(seen_ns)
            fewest = math.ceil((empty_ns - self._last_ns) / self._period_ns - error)
            most = math.floor((latest_ns - self._last_ns) / self._period_ns + error)
            doubt = max(0, step - max(1, fewest), most - step)
            if doubt:
                self.forget()
        self.next += step - 1
        if self._reference is None:
            # The first waiting sample arrived at `latest_ns` or earlier. If the program was delayed, the time
            # at which the samples were seen is much later, and relates the clocks less exactly.
            self._learn(self.next, math.floor(latest_ns))
        return Resumed(step - 1, doubt)

    def take(self, n: int, waiting: int, seen_ns: int, *, timely: bool) -> list[tuple[int, int]]:
        """Return sequence number and arrival time of the `n` samples that are taken from the FIFO.

        `waiting`: number of samples that the FIFO held at `seen_ns`; the oldest `n` of them are taken.
        `timely`: whether they were counted so quickly that `seen_ns` can be used to estimate the clock.

        The newest of the waiting samples counts as arrived at `seen_ns`, and each older sample one sampling
        period before the next. The shortest possible period is used. So no sample seems to arrive before the
        sensor measured it.
        """
        shortest_ns = self._period_ns * (1 - self._clock_error())
        newest = self.next + waiting - 1
        if timely or self._reference is None:
            self._learn(newest, seen_ns)
        taken = [
            (number, seen_ns - math.floor((newest - number) * shortest_ns))
            for number in range(self.next, self.next + n)
        ]
        self.next += n
        self._last_ns = self._time_of(self.next - 1)
        return taken

    def _learn(self, number: int, seen_ns: int) -> None:
        if self._reference is None:
            self._reference = (number, float(seen_ns))
            self._block_end = number + self._block_samples
        if number >= self._block_end and self._earliest is not None:
            self._blocks.append(self._earliest)
            self._earliest = None
            self._block_end = number + self._block_samples
            self._fit()
        if self._earliest is None or self._delay(number, seen_ns) < self._delay(*self._earliest):
            self._earliest = (number, seen_ns)
        if len(self._blocks) < 2 and seen_ns < self._time_of(number):
            self._reference = (number, float(seen_ns))

    def _delay(self, number: int, seen_ns: int) -> float:
        return seen_ns - number * self._period_ns

    def _fit(self) -> None:
        if len(self._blocks) < 2:
            return
        (first, first_ns), (last, _) = self._blocks[0], self._blocks[-1]
        fit = fit_clock(
            [number - first for number, _ in self._blocks],
            [seen_ns - first_ns for _, seen_ns in self._blocks],
        )
        self._period_ns = fit.slope
        self._reference = (last, first_ns + fit.at(last - first))

    def _time_of(self, number: int) -> float:
        assert self._reference is not None
        known, known_ns = self._reference
        return known_ns + (number - known) * self._period_ns

    def _clock_error(self) -> float:
        """Return an upper bound of the relative error of the estimated sampling period."""
        if len(self._blocks) < 2:
            return self._first_error
        span_ns = self._blocks[-1][1] - self._blocks[0][1]
        return min(self._first_error, DRIFT + SPREAD_NS / span_ns)

    def _error(self, at_ns: int) -> float:
        """Return an upper bound of the error of the sample number that is predicted for a time [samples]."""
        known_ns = self._reference[1] if self._reference is not None else at_ns
        return (PHASE_NS + abs(at_ns - known_ns) * self._clock_error()) / self._period_ns
