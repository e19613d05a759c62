"""The oracle of `fltea.stream.time`: the same regression, an arrival at a time."""

from collections import deque

import numpy as np

BLOCK_US = 1_000_000
BLOCKS_KEPT = 600
BLOCKS_FOR_PPM = 10
DELAY_STD_S = 1e-3
CLOCK_STD = 1e-2


class Timebase:
    """Regression of host time on device time within one epoch.

    `offset_ns` is added to the host's monotonic clock and stays fixed for the epoch, so that a step
    of the wall clock does not tear the time stamps.
    """

    def __init__(self, offset_ns: int) -> None:
        self._offset_ns = offset_ns
        self._blocks: deque[tuple[float, float]] = deque(maxlen=BLOCKS_KEPT)
        self._origin: tuple[int, int] | None = None
        self._block_end_us = 0
        self._earliest: tuple[float, float] | None = None
        self._slope_error = 0.0
        self._centre = (0.0, 0.0)
        self._last_ns: int | None = None
        self._first: tuple[int, int] | None = None
        self._latest = (0, 0)

    def add(self, seq: int, device_us: int, host_ns: int) -> int:
        """Learn from one arrival; return the sample's host time in ns.

        The result never runs backwards: where a new fit would, it goes on by one nanosecond.
        """
        if self._origin is None:
            self._origin = (device_us, host_ns)
            self._first = (seq, device_us)
            self._block_end_us = device_us + BLOCK_US
        self._latest = (seq, device_us)
        device_s = (device_us - self._origin[0]) * 1e-6
        delay_s = (host_ns - self._origin[1]) * 1e-9 - device_s
        if device_us >= self._block_end_us:
            self._close_block()
            self._block_end_us = device_us + BLOCK_US
        if self._earliest is None or delay_s < self._earliest[1]:
            self._earliest = (device_s, delay_s)
            if not self._blocks:
                self._centre = self._earliest
        estimate_s = device_s + self._centre[1] + self._slope_error * (device_s - self._centre[0])
        now_ns = self._origin[1] + self._offset_ns + round(estimate_s * 1e9)
        if self._last_ns is not None and now_ns <= self._last_ns:
            now_ns = self._last_ns + 1
        self._last_ns = now_ns
        return now_ns

    def _close_block(self) -> None:
        if self._earliest is None:
            return
        self._blocks.append(self._earliest)
        self._earliest = None
        device_s, delay_s = np.array(self._blocks).T
        x, y = device_s - device_s.mean(), delay_s - delay_s.mean()
        ridge = (DELAY_STD_S / CLOCK_STD) ** 2
        self._slope_error = float(x @ y / (x @ x + ridge))
        self._centre = (float(device_s.mean()), float(delay_s.mean()))

    @property
    def clock_ppm(self) -> float | None:
        """How much faster the device's clock runs than the host's, in 1e-6; None at first."""
        if len(self._blocks) < BLOCKS_FOR_PPM:
            return None
        if not any(delay_s for _, delay_s in self._blocks):
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
