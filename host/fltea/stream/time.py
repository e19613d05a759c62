"""The device's clock against the host's, by regression (pure).

Delay between sampling and arrival is never negative but often large and in bursts (USB bridges,
schedulers), so of every second only the earliest arrival counts; a straight line through those of
the last ten minutes gives the host time of any sample, free of jitter.
"""

from typing import NamedTuple

import numpy as np

from fltea.records.arrays import Array
from fltea.records.events import Ints

SECOND_US = 1_000_000
SECONDS_KEPT = 600
SECONDS_FOR_PPM = 10
DELAY_STD_S = 1e-3
CLOCK_STD = 1e-2
"""Prior spread of the clocks' ratio: a sensor's own oscillator is within 1 %."""


class Line(NamedTuple):
    """Unix time of the device's clock until its second ends: a line through `centre`."""

    origin_us: int
    origin_ns: int
    offset_ns: int
    centre_s: float
    centre_delay_s: float
    slope: float
    end_us: int


class OpenSecond(NamedTuple):
    """Unix time of the newest sample, and device's time and delay of the earliest arrival of a second."""

    last_ns: int
    earliest: tuple[float, float] | None


class Timebase:
    """Regression of host time on device time within one epoch.

    `offset_ns` is added to the host's monotonic clock and stays fixed for the epoch, so that a step
    of the wall clock does not tear the time stamps.
    """

    def __init__(self, offset_ns: int) -> None:
        self._offset_ns = offset_ns
        # Of every second that is over: device's time and delay, in two rows. The last SECONDS_KEPT of
        # `_seconds` count; there is room for as many more, so that they seldom move.
        self._kept = np.empty((2, 2 * SECONDS_KEPT))
        self._seconds = 0
        self._origin: tuple[int, int] | None = None
        self._second_end_us = 0
        self._earliest: tuple[float, float] | None = None
        self._slope_error = 0.0
        self._centre = (0.0, 0.0)
        self._last_ns: int | None = None
        self._first: tuple[int, int] | None = None
        self._latest = (0, 0)

    def add(self, seq: Ints, device_us: Ints, host_ns: Ints) -> Ints:
        """Learn from arrivals, all (n,); return the samples' host times in ns, (n,).

        The result never runs backwards: where a new fit would, it goes on by one nanosecond.
        """
        if self._origin is None:
            self._origin = (int(device_us[0]), int(host_ns[0]))
            self._first = (int(seq[0]), int(device_us[0]))
            self._second_end_us = int(device_us[0]) + SECOND_US
        self._latest = (int(seq[-1]), int(device_us[-1]))
        device_s = (device_us - self._origin[0]) * np.float64(1e-6)
        delay_s = (host_ns - self._origin[1]) * np.float64(1e-9) - device_s
        n = len(seq)
        begin = 0
        found = np.empty(n, dtype=np.int64)
        while begin < n:
            if device_us[begin] >= self._second_end_us:
                self.begin_second(int(device_us[begin]))
            end = n
            if device_us[-1] >= self._second_end_us:
                end = int(np.searchsorted(device_us, self._second_end_us))
            found[begin:end] = self._within_second(device_s[begin:end], delay_s[begin:end])
            begin = end
        self._last_ns = int(found[-1])
        return found

    @property
    def line(self) -> Line | None:
        """The line by which samples of this second are timed; None in the first second."""
        if self._origin is None or not self._seconds:
            return None
        line = *self._origin, self._offset_ns, *self._centre, self._slope_error, self._second_end_us
        return Line(*line)

    @property
    def second(self) -> OpenSecond:
        """What the second that is open has come to."""
        assert self._last_ns is not None
        return OpenSecond(self._last_ns, self._earliest)

    def go_on(self, second: OpenSecond, seq: int, device_us: int) -> None:
        """Take note of samples that were timed by `line`, and of the number and time of the newest."""
        self._last_ns, self._earliest = second
        self._latest = seq, device_us

    def _within_second(self, device_s: Array, delay_s: Array) -> Ints:
        """Times of samples that all stand in the second that is open."""
        assert self._origin is not None
        best = int(delay_s.argmin())
        earliest = self._earliest
        if not self._seconds:  # in the first second every earlier arrival moves all that follow
            least = np.minimum.accumulate(delay_s)
            estimate_s = device_s + (least if earliest is None else np.minimum(least, earliest[1]))
        if earliest is None or delay_s[best] < earliest[1]:
            self._earliest = (float(device_s[best]), float(delay_s[best]))
        if self._seconds:
            centre_s, delay_of_centre_s = self._centre
            estimate_s = device_s + delay_of_centre_s + self._slope_error * (device_s - centre_s)
        now_ns = self._origin[1] + self._offset_ns + np.rint(estimate_s * 1e9).astype(np.int64)
        if self._last_ns is not None and now_ns[0] <= self._last_ns:
            now_ns[0] = self._last_ns + 1
        if len(now_ns) > 1:
            row = np.arange(len(now_ns))
            now_ns = np.maximum.accumulate(now_ns - row) + row
        self._last_ns = int(now_ns[-1])
        return now_ns

    def begin_second(self, device_us: int) -> None:
        """Let a second begin with a sample of this time: the line goes through the one before it, too."""
        self._close_second()
        self._second_end_us = device_us + SECOND_US

    def _close_second(self) -> None:
        if self._earliest is None:
            return
        if self._seconds == self._kept.shape[1]:
            self._kept[:, : SECONDS_KEPT - 1] = self._kept[:, 1 - SECONDS_KEPT :]
            self._seconds = SECONDS_KEPT - 1
        self._kept[:, self._seconds] = self._earliest
        self._seconds += 1
        self._earliest = None
        device_s, delay_s = self._window()
        n = len(device_s)
        self._centre = centre = (float(np.add.reduce(device_s)) / n, float(np.add.reduce(delay_s)) / n)
        x, y = device_s - centre[0], delay_s - centre[1]
        ridge = (DELAY_STD_S / CLOCK_STD) ** 2
        self._slope_error = float(x @ y / (x @ x + ridge))

    def _window(self) -> Array:
        """Device's times and delays of the seconds that count, (2, seconds)."""
        return self._kept[:, max(0, self._seconds - SECONDS_KEPT) : self._seconds]

    @property
    def clock_ppm(self) -> float | None:
        """How much faster the device's clock runs than the host's, in 1e-6; None at first."""
        if self._seconds < SECONDS_FOR_PPM:
            return None
        if not self._window()[1].any():
            return None  # to the nanosecond: times of arrival that were made from the device's
        return (1.0 / (1.0 + self._slope_error) - 1.0) * 1e6

    @property
    def rate_hz(self) -> float | None:
        """Samples per second of host time; None before the second sample."""
        if self._first is None or self._latest[1] == self._first[1]:
            return None
        samples = self._latest[0] - self._first[0]
        device_s = (self._latest[1] - self._first[1]) * 1e-6
        return samples / device_s / (1.0 + self._slope_error)
