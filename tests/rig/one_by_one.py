"""The oracle of fltea.stream.time: the same regression, an arrival at a time."""

from collections import deque
from operator import itemgetter

import numpy as np

BLOCK_US = 1_000_000
BLOCKS_KEPT = 600
BLOCKS_FOR_PPM = 10
DELAY_STD_S = 1e-3
CLOCK_STD = 1e-2

DELAY = itemgetter(1)


class Timebase:
    """Of every second the earliest arrival counts, and a line through them gives all times."""

    def __init__(self, offset_ns: int) -> None:
        self._offset_ns = offset_ns
        self._first = self._latest = (0, 0, 0)
        self._blocks: deque[tuple[float, float]] = deque(maxlen=BLOCKS_KEPT)
        self._open: list[tuple[float, float]] = []
        self._end_us = 0
        self._slope_error = 0.0
        self._centre = (0.0, 0.0)
        self._last_ns: int | None = None

    def add(self, seq: int, device_us: int, host_ns: int) -> int:
        """Learn from one arrival; return the sample's host time in ns, which never runs backwards."""
        self._latest = (seq, device_us, host_ns)
        if self._last_ns is None:
            self._first, self._end_us = self._latest, device_us + BLOCK_US
        device_s = (device_us - self._first[1]) * 1e-6
        delay_s = (host_ns - self._first[2]) * 1e-9 - device_s
        if device_us >= self._end_us:
            self._blocks.append(min(self._open, key=DELAY))
            self._open, self._end_us = [], device_us + BLOCK_US
            self._fit()
        self._open.append((device_s, delay_s))
        if not self._blocks:
            self._centre = min(self._open, key=DELAY)
        estimate_s = device_s + self._centre[1] + self._slope_error * (device_s - self._centre[0])
        now_ns = self._first[2] + self._offset_ns + round(estimate_s * 1e9)
        self._last_ns = now_ns if self._last_ns is None else max(now_ns, self._last_ns + 1)
        return self._last_ns

    def _fit(self) -> None:
        device_s, delay_s = np.array(self._blocks).T
        x, y = device_s - device_s.mean(), delay_s - delay_s.mean()
        self._slope_error = float(x @ y / (x @ x + (DELAY_STD_S / CLOCK_STD) ** 2))
        self._centre = (float(device_s.mean()), float(delay_s.mean()))

    @property
    def clock_ppm(self) -> float | None:
        # Delays that are all 0 to the nanosecond are of times that were made from the device's.
        if len(self._blocks) < BLOCKS_FOR_PPM or not any(map(DELAY, self._blocks)):
            return None
        return (1.0 / (1.0 + self._slope_error) - 1.0) * 1e6

    @property
    def rate_hz(self) -> float | None:
        samples, device_us = self._latest[0] - self._first[0], self._latest[1] - self._first[1]
        return samples / (device_us * 1e-6) / (1.0 + self._slope_error) if device_us else None
