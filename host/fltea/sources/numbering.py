"""Numbers live samples that come without numbers, by their times or by their order.

This module also gives the samples device times.

The rules for samples with times are those of `fltea.recording.sample_times`. Samples with times wait until
their times determine a sampling rate.
"""

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from fltea.recording.clocks import clock_of
from fltea.recording.sample_numbers import Numbering
from fltea.recording.sample_times import (
    LONGEST_GAP_S,
    SECONDS,
    Elapsed,
    Floats,
    Ints,
    Marks,
    TimeColumn,
)
from fltea.recording.timing import Timing, timing
from fltea.records.errors import UsageError

RATE_S, FEWEST, MOST = 2.0, 8, 20_000
"""The sampling rate is measured from the samples of the duration `RATE_S` [s], but from at least `FEWEST` and
at most `MOST` samples.
"""

PATIENCE_NS = 10 * 10**9
"""Samples wait for at most this time by the host's clock until their rate is known [ns]. Then the rate is
measured from the samples so far. Without this limit they might wait forever: if their times are in another
unit than expected, `RATE_S` may never be reached.
"""


class Arrived(NamedTuple):
    """Samples that arrived together.

    `values`: measured values, (n, columns), in deg/s, counts or the source's unit.
    `time`: times of the samples, (n,), in the sender's unit; None if there is no column of times.
    `ordinal`: number of each sample, (n,), counted from 0 over all samples of the source. These numbers also
    count samples that were lost, for example in damaged lines.
    `begins`: whether the sender restarted before the first of these samples.
    """

    values: Floats
    time: Floats | None
    ordinal: Ints
    begins: bool = False


class Numbered(NamedTuple):
    """Successive samples with their sequence numbers.

    `begins`: whether the sender restarted before these samples.
    """

    begins: bool
    sequence: Ints
    device_us: Ints
    values: Floats
    host_ns: Ints


class ByOrder:
    """Numbers samples without times by their order, at a rate that the user gives."""

    uneven = ""
    has_clock = False

    def __init__(self, rate_hz: float) -> None:
        self.rate_hz: float | None = rate_hz
        self.duplicates = self.unrated = 0
        self._period_us = 1e6 / rate_hz
        self._base: int | None = None
        self._last_ns = 0

    def begin(self) -> None:
        """Give the next sample the number 0 again, since the sender restarted."""
        self._base = None

    def add(self, rows: Arrived, host_ns: int) -> Iterator[Numbered]:
        """Number samples that arrived together, and yield them at once."""
        begins = rows.begins or self._base is None or host_ns - self._last_ns > LONGEST_GAP_S * 1e9
        if begins:
            self._base = int(rows.ordinal[0])
        assert self._base is not None
        self._last_ns = host_ns
        sequence = rows.ordinal - self._base
        device_us = np.rint(sequence * self._period_us).astype(np.int64)
        yield Numbered(begins, sequence, device_us, rows.values, np.full(len(sequence), host_ns))

    def finish(self) -> Iterator[Numbered]:
        """Yield nothing, since no sample waits here."""
        yield from ()


class _Waiting(NamedTuple):
    """Samples that wait until their sampling rate is known.

    `marks`: says of each sample whether it is the first one after a restart of the sender.
    """

    elapsed: Floats
    marks: Marks
    rows: Arrived
    host_ns: int


class ByTime:
    """Numbers samples by a column of times.

    A step of the times longer than the sampling period means that samples were lost.

    `where`: name of the source in messages. `duplicates`: number of samples that were left out because their
    time equals that of the previous sample. `unrated`: number of samples that were left out because no
    sampling rate could be found from their times. `why_no_rate`: the reason why none was found.
    """

    def __init__(self, where: str, column: TimeColumn) -> None:
        self.duplicates = self.unrated = 0
        self.why_no_rate = ""
        self._where, self._column = where, column
        self._elapsed = Elapsed(column.unit)
        self._waiting: list[_Waiting] = []
        self._timing: Timing | None = None
        self._numbering: Numbering | None = None
        self._by_order: ByOrder | None = None
        self._begins = True

    @property
    def rate_hz(self) -> float | None:
        """Sampling rate, measured or given by the user; None while it is still being measured."""
        return self._timing.rate_hz if self._timing is not None else None

    @property
    def has_clock(self) -> bool:
        """Whether the times are even enough to be those of a device's clock."""
        return self._numbering is not None

    @property
    def uneven(self) -> str:
        """Warning that the times are uneven, so that samples are numbered by their order; empty if not."""
        return self._timing.warning if self._timing is not None else ""

    @property
    def _given_hz(self) -> float | None:
        return self._column.rate_hz if self._column.is_given else None

    def begin(self) -> None:
        """Note that the connection to the sender was lost.

        If the numbers come from times, nothing changes, since the times will show whether the sender kept
        running.
        """
        if self._by_order is not None:
            self._by_order.begin()

    def add(self, rows: Arrived, host_ns: int) -> Iterator[Numbered]:
        """Number samples that arrived together, and yield them.

        As long as the sampling rate is unknown, yield nothing, and let the samples wait.
        """
        assert rows.time is not None
        if self._by_order is not None:
            yield from self._by_order.add(rows, host_ns)
            return
        waiting = _Waiting(*self._elapsed.add(rows.time, rows.values), rows, host_ns)
        if self._timing is not None:
            yield from self._numbered(waiting)
            return
        self._waiting.append(waiting)
        if self._is_enough(host_ns):
            yield from self.finish()

    def _is_enough(self, host_ns: int) -> bool:
        first = self._waiting[0]
        count = sum(len(one.elapsed) for one in self._waiting)
        heard_s = float(self._waiting[-1].elapsed[-1] - first.elapsed[0]) * SECONDS[self._column.unit or "s"]
        if self._given_hz is not None and self._column.unit is None:
            heard_s = count / self._given_hz
        long = heard_s >= RATE_S or host_ns - first.host_ns >= PATIENCE_NS
        return count >= MOST or (count >= FEWEST and long)

    def finish(self) -> Iterator[Numbered]:
        """Number the waiting samples if their times give a sampling rate."""
        waiting, self._waiting = self._waiting, []
        if not waiting:
            return
        elapsed = np.concatenate([one.elapsed for one in waiting])
        clock = clock_of(lambda: [elapsed], self._elapsed)
        try:
            found = timing(self._where, self._column, clock, self._elapsed)
        except UsageError as error:
            self.unrated += sum(len(one.elapsed) for one in waiting)
            self.why_no_rate = str(error)
            self._elapsed = Elapsed(self._column.unit)
            return
        self._timing = found
        if found.period is None:
            self._by_order = ByOrder(found.rate_hz)
            for one in waiting:
                yield from self._by_order.add(one.rows, one.host_ns)
            return
        self._numbering = Numbering(found.period, found.rate_hz, is_rounded=found.is_rounded)
        for one in waiting:
            yield from self._numbered(one)

    def _numbered(self, one: _Waiting) -> Iterator[Numbered]:
        assert self._numbering is not None
        assert self._timing is not None
        found = self._numbering.add(one.elapsed, one.marks)
        n = len(found.sequence)
        self.duplicates += len(one.elapsed) - n
        if not n:
            return
        values = one.rows.values if n == len(one.elapsed) else one.rows.values[found.kept]
        if self._given_hz is None:
            device_us = np.rint(found.elapsed * (self._timing.unit_s * 1e6)).astype(np.int64)
        else:
            device_us = np.rint(found.sequence * (1e6 / self._given_hz)).astype(np.int64)
        host_ns = np.full(n, one.host_ns)
        begins = np.flatnonzero(found.begins[1:]) + 1 if found.begins.any() else ()
        first, self._begins = bool(found.begins[0]) or self._begins, False
        edges = [0, *begins, n]
        for k, (begin, end) in enumerate(pairwise(edges)):
            part = slice(begin, end)
            yield Numbered(first or k > 0, found.sequence[part], device_us[part], values[part], host_ns[part])
