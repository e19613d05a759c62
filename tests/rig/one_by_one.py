"""Compute the regression of host time on device time (host/native/timebase.hpp) one arrival at a time, as an
oracle.
"""

from collections import deque
from collections.abc import Iterable
from functools import reduce
from operator import add, itemgetter, mul

BLOCK_US = 1_000_000
BLOCKS_KEPT = 600
BLOCKS_FOR_PPM = 10
DELAY_STD_S = 1e-3
CLOCK_STD = 1e-2

DELAY = itemgetter(1)


def total(values: Iterable[float]) -> float:
    """Return the sum of the values, added in order. It equals the sum by a plain loop to the bit, which
    Python's `sum` may not.
    """
    return reduce(add, values, 0.0)


class Timebase:
    """Fits a straight line through the earliest arrival of each second.

    The straight line gives the host time of every sample.
    """

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
        """Include the arrival of one sample in the fit. Return the sample's host time [ns].

        Returned times never decrease.
        """
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
        device_s, delay_s = zip(*self._blocks, strict=True)
        self._centre = x0, y0 = total(device_s) / len(device_s), total(delay_s) / len(delay_s)
        x, y = [one - x0 for one in device_s], [one - y0 for one in delay_s]
        squares, products = total(map(mul, x, x)), total(map(mul, x, y))
        self._slope_error = products / (squares + (DELAY_STD_S / CLOCK_STD) ** 2)

    @property
    def clock_ppm(self) -> float | None:
        # If all delays are exactly 0, the host times were computed from the device's times, and show no error
        # of the device's clock.
        if len(self._blocks) < BLOCKS_FOR_PPM or not any(map(DELAY, self._blocks)):
            return None
        if not self._is_real_time:
            return None
        return (1.0 / (1.0 + self._slope_error) - 1.0) * 1e6

    @property
    def rate_hz(self) -> float | None:
        samples, device_us = self._latest[0] - self._first[0], self._latest[1] - self._first[1]
        if not device_us or not self._is_real_time:
            return None
        return samples / (device_us * 1e-6) / (1.0 + self._slope_error)

    @property
    def _is_real_time(self) -> bool:
        # No device's clock runs twice as fast as the host's, but a file is read in an instant.
        return 1.0 + self._slope_error >= 0.5
