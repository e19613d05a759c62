"""Numbers and device times of samples that come without numbers: by their times, or by their order (pure)."""

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fltea.recording.files import EVEN_SHARE, EVENNESS
from fltea.recording.session import HIGHEST_RATE_HZ, LOWEST_RATE_HZ
from fltea.records.events import Ints, Trouble

UNIT_US = {"s": 1e6, "ms": 1e3, "us": 1.0, "ns": 1e-3}
COUNTER_WRAP = 1 << 32
"""Of millis() and micros(), which are what boards send as time in ms and in us."""

LONGEST_STEP_US = 60 * 10**6
"""After a longer one nobody knows whether it is the same run of the sender."""

RATE_US, FEWEST, MOST = 2 * 10**6, 8, 20_000
"""The rate is taken from samples of so long a time, so many at least and at most."""

PATIENCE_NS = 10 * 10**9
"""By the host's clock; after so long times that advance by less are in another unit."""

LEAK = 0.98
"""How much of the difference between times and numbers a sample hands on to the next: times in whole ms lie
on a grain, and the rate is known to 0.1 %."""


class Rows(NamedTuple):
    """Samples that arrived together.

    values: (n, columns) in deg/s, counts or what the source has. time: (n,) as the sender counts it, None
    without such a column. ordinal: (n,) number of each among the samples and the lost ones, from 0.
    """

    values: NDArray[np.float64]
    time: NDArray[np.float64] | None
    ordinal: Ints


class Numbered(NamedTuple):
    """Successive samples. begins: they do not follow on those before them, a new run of the sender begins."""

    begins: bool
    sequence: Ints
    device_us: Ints
    values: NDArray[np.float64]
    host_ns: Ints


class ByOrder:
    """Without times: the order of the lines numbers the samples, at a rate that the user gives."""

    def __init__(self, rate_hz: float) -> None:
        self.rate_hz: float | None = rate_hz
        self.uneven = False
        self.duplicates = self.unrated = 0
        self._rate_hz = rate_hz
        self._base: int | None = None
        self._last_ns = 0

    def begin(self) -> None:
        """What comes next does not follow on what came before."""
        self._base = None

    def add(self, rows: Rows, host_ns: int) -> Iterator[Numbered]:
        """Number rows that arrived together."""
        begins = self._base is None or host_ns - self._last_ns > LONGEST_STEP_US * 1000
        if begins:
            self._base = int(rows.ordinal[0])
        assert self._base is not None
        self._last_ns = host_ns
        sequence = rows.ordinal - self._base
        device_us = np.rint(sequence * (1e6 / self._rate_hz)).astype(np.int64)
        yield Numbered(begins, sequence, device_us, rows.values, np.full(len(sequence), host_ns))

    def finish(self) -> Iterator[Numbered]:
        """Nothing is kept back."""
        yield from ()


class ByTime:
    """A column of times numbers the samples: where it runs ahead of the rate, samples are missing.

    rate_hz: None until it is found, unless the user gives it. uneven: the steps are not those of a device's
    clock. duplicates: samples left out, for the time before them is the same. unrated: samples left out, for
    their times tell no rate.
    """

    def __init__(self, unit: str, rate_hz: float | None) -> None:
        self.rate_hz = rate_hz
        self.uneven = False
        self.duplicates = self.unrated = 0
        self._unit_us = UNIT_US[unit]
        self._wrap_us = round(COUNTER_WRAP * self._unit_us) if unit in ("ms", "us") else None
        self._begins = True
        self._last_us: int | None = None
        self._sequence = self._device_us = 0
        self._ahead = 0.0
        self._waiting: list[tuple[Ints, NDArray[np.float64], Ints]] = []
        self._newest_us: int | None = None
        self._heard_us = 0

    def begin(self) -> None:
        """The sender was lost; its times say whether it went on meanwhile."""

    def add(self, rows: Rows, host_ns: int) -> Iterator[Numbered]:
        """Number rows that arrived together; until the rate is known they wait."""
        assert rows.time is not None
        time_us = np.rint(rows.time * self._unit_us).astype(np.int64)
        self._waiting.append((time_us, rows.values, np.full(len(time_us), host_ns)))
        if self.rate_hz is None:
            count = sum(len(entry[0]) for entry in self._waiting)
            steps = np.diff(time_us, prepend=time_us[0] if self._newest_us is None else self._newest_us)
            self._newest_us = int(time_us[-1])
            self._heard_us += int(steps[(steps > 0) & (steps <= LONGEST_STEP_US)].sum())  # times may run back
            waited_ns = host_ns - int(self._waiting[0][2][0])
            enough = self._heard_us >= RATE_US or waited_ns >= PATIENCE_NS
            if count < MOST and not (count >= FEWEST and enough):
                return
        yield from self.finish()

    def finish(self) -> Iterator[Numbered]:
        """Number what waits, if it tells a rate."""
        if not self._waiting:
            return
        axes = self._waiting[-1][1].shape[1]
        waiting = [entry for entry in self._waiting if entry[1].shape[1] == axes]
        self._waiting = []
        time_us, values, host_ns = (np.concatenate(column) for column in zip(*waiting, strict=True))
        if self.rate_hz is None:
            self.rate_hz, self.uneven = rate_of(time_us)
        if self.rate_hz is None:
            self.unrated += len(time_us)
            return
        yield from self._numbered(time_us, values, host_ns)

    def _numbered(self, time_us: Ints, values: NDArray[np.float64], host_ns: Ints) -> Iterator[Numbered]:
        assert self.rate_hz is not None
        steps = np.diff(time_us, prepend=time_us[0] if self._last_us is None else self._last_us)
        if self._wrap_us is not None:
            wrapped = (steps < 0) & (steps + self._wrap_us <= LONGEST_STEP_US) & (steps + self._wrap_us > 0)
            steps[wrapped] += self._wrap_us
        same = steps == 0
        same[0] &= self._last_us is not None
        self.duplicates += int(same.sum())
        self._last_us = int(time_us[-1])
        kept = ~same
        steps, values, host_ns = steps[kept], values[kept], host_ns[kept]
        if not len(steps):
            return
        broken = (steps < 0) | (steps > LONGEST_STEP_US)
        broken[0] |= self._begins
        self._begins = False
        begins = np.flatnonzero(broken).tolist()
        for begin, end in zip([0, *begins], [*begins, len(steps)], strict=True):
            if end > begin:
                yield self._piece(
                    bool(broken[begin]), steps[begin:end], values[begin:end], host_ns[begin:end]
                )

    def _piece(self, begins: bool, steps_us: Ints, values: NDArray[np.float64], host_ns: Ints) -> Numbered:
        assert self.rate_hz is not None
        if begins:
            steps_us = np.concatenate(([0], steps_us[1:]))
            self._sequence, self._device_us, self._ahead = -1, 0, 1.0
        numbers = []
        for periods in (steps_us * (self.rate_hz * 1e-6)).tolist():
            ahead = self._ahead * LEAK + periods
            numbers.append(max(1, round(ahead)))
            self._ahead = min(0.5, max(-0.5, ahead - numbers[-1]))
        sequence = self._sequence + np.cumsum(numbers)
        device_us = self._device_us + np.cumsum(steps_us)
        self._sequence, self._device_us = int(sequence[-1]), int(device_us[-1])
        return Numbered(begins, sequence, device_us, values, host_ns)


def rate_of(time_us: Ints) -> tuple[float | None, bool]:
    """Samples per second of successive times, and whether their steps are uneven; None if they tell none.

    Times in whole ms make steps of 1 and 2 at 800 Hz: those are even enough.
    """
    steps = np.diff(time_us)
    steps = steps[(steps > 0) & (steps <= LONGEST_STEP_US)]
    if not len(steps):
        return None, True
    grain_us = int(np.gcd.reduce(steps))
    typical_us = float(np.median(steps))
    even = np.abs(steps - typical_us) <= np.maximum(EVENNESS * typical_us, grain_us if grain_us > 1 else 0)
    rate_hz = 1e6 / float(steps[even].mean())
    if not LOWEST_RATE_HZ <= rate_hz <= HIGHEST_RATE_HZ:
        return None, True
    return rate_hz, bool(even.mean() < EVEN_SHARE)


class ArrivalWatch:
    """Whether samples that are numbered by their order also come as their rate says.

    A buffer makes samples late, and then they come all at once: of a while, the earliest counts. What stays
    late was lost, or the sender paused.
    """

    WHILE_S, CHUNKS, LEAST_JUMP_S = 1.0, 3, 0.1
    NEEDED, RATE_S, RATE_TOLERANCE = 4, 10.0, 0.02

    def __init__(self, url: str, rate_hz: float) -> None:
        self._url, self._rate_hz = url, rate_hz
        self._told_rate = False
        self.begin()

    def begin(self) -> None:
        """A new run of the sender."""
        self._origin: tuple[float, float] | None = None
        self._whiles: list[tuple[float, float]] = []
        self._doubt: tuple[float, float] | None = None
        self._open: list[tuple[float, float]] = []
        self._pauses_s: list[float] = []

    def add(self, device_us: int, host_ns: int) -> Trouble | None:
        """Take the last sample of what arrived together; what there is to tell."""
        host_s, device_s = host_ns * 1e-9, device_us * 1e-6
        if self._origin is None:
            self._origin = (host_s, device_s)
        host_s, device_s = host_s - self._origin[0], device_s - self._origin[1]
        self._open.append((host_s - device_s, host_s))
        if len(self._open) < self.CHUNKS or host_s - self._open[0][1] < self.WHILE_S:
            return None
        late_s = min(late for late, _ in self._open)
        chunks_s = [at for _, at in self._open]
        self._open = []
        return self._judge(host_ns, late_s, host_s, max(b - a for a, b in pairwise(chunks_s)))

    def _judge(self, now_ns: int, late_s: float, host_s: float, longest_s: float) -> Trouble | None:
        if len(self._whiles) >= self.NEEDED:
            slope = self._slope()
            reference = self._whiles[-1]
            jump_s = late_s - reference[0] - slope * (host_s - reference[1])
            least_s = max(self.LEAST_JUMP_S, 3 / self._rate_hz, float(np.median(self._pauses_s)))
            if jump_s > least_s and self._doubt is None:
                self._doubt = late_s, host_s  # the next while tells whether it stays
                return None
            if jump_s > least_s:
                self._whiles, self._doubt = [(late_s, host_s)], None
                text = (
                    f"{self._url}: samples come {jump_s:.3g} s later than before, and stay late: about "
                    f"{jump_s * self._rate_hz:.0f} were lost on the way, or the sender paused. Nobody can "
                    "tell which ones, so the numbers of the samples go on as if none were missing. Let the "
                    "sender write its own time (--time-column), and gaps are seen."
                )
                return Trouble("arrival_jump", text, now_ns, fatal=False)
            self._doubt = None
        self._whiles = [*self._whiles[-29:], (late_s, host_s)]
        self._pauses_s = [*self._pauses_s[-29:], longest_s]
        return self._rate(now_ns)

    def _slope(self) -> float:
        late, host = np.array(self._whiles).T
        return float(np.median(np.diff(late) / np.diff(host)))

    def _rate(self, now_ns: int) -> Trouble | None:
        span_s = self._whiles[-1][1] - self._whiles[0][1]
        if self._told_rate or len(self._whiles) < 2 * self.NEEDED or span_s < self.RATE_S:
            return None
        slope = self._slope()
        if abs(slope) <= self.RATE_TOLERANCE:
            return None
        self._told_rate = True
        text = (
            f"{self._url}: samples come at {self._rate_hz * (1 - slope):.4g} Hz, and --rate says "
            f"{self._rate_hz:g}: all that is in seconds or Hz is off by as much. Give the true rate, "
            "or a column of times (--time-column). A stored file comes as fast as it can: let it be read "
            "with replay:/dev/stdin."
        )
        return Trouble("rate_differs", text, now_ns, fatal=False)
