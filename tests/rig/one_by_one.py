"""The oracles of fltea.stream.place and fltea.stream.time: the same, a sample and an arrival at a time."""

from collections import deque
from operator import itemgetter
from typing import NamedTuple

import numpy as np
from fltea.records.events import SEQUENCE_WRAP, TIME_WRAP_US, RawSample
from fltea.records.records import EpochReason, Hello
from fltea.stream.place import CLOCK_TOLERANCE, MAX_HOST_DISAGREEMENT_US, MAX_SILENCE_NS


class Placed(NamedTuple):
    """A sample with its place; missing, new_epoch: what was lost or broke just before it."""

    raw: RawSample
    seq: int
    device_us: int
    missing: int = 0
    new_epoch: EpochReason | None = None


class Continuity:
    """Turns wrapped samples into an unbroken count, or says where it broke; max_gap in samples."""

    def __init__(self, max_gap: int) -> None:
        self.max_gap = max_gap
        self.hello: Hello | None = None
        self.delivered = self.lost = self.gaps = self.duplicates = self.before_hello = 0
        self._boot: tuple[int | None, str | None] | None = None
        self._sensor_starts: int | None = None
        self._pending: EpochReason | None = "start"
        self._last: RawSample | None = None
        self._seq = self._device_us = 0

    def on_hello(self, hello: Hello) -> bool:
        boot = (hello.boot_id, hello.device_id)
        another_boot, another_sensor = boot != self._boot, hello.sensor_starts != self._sensor_starts
        news = another_boot or another_sensor or self.hello is None
        if another_boot and self._boot is not None:
            self._pending = "restart"
        elif another_sensor and self._pending is None:
            self._pending = "sensor_restart"
        self._boot, self._sensor_starts = boot, hello.sensor_starts
        self.hello = hello
        return news

    def on_link_down(self) -> None:
        self.hello = None

    def on_break(self, reason: EpochReason) -> None:
        if self._pending in (None, "sensor_restart"):
            self._pending = reason

    def on_sample(self, raw: RawSample) -> Placed | None:
        """Place one sample; None for one that cannot be used (duplicate, or its HELLO is not known)."""
        if self.hello is None:
            self.before_hello += 1
            return None
        if self._last is None or self._pending not in (None, "sensor_restart"):
            return self._begin(raw, self._pending or "start")
        if raw.host_ns - self._last.host_ns > MAX_SILENCE_NS:
            return self._begin(raw, self._pending or "silence")
        sequence_step = (raw.sequence - self._last.sequence) % SEQUENCE_WRAP
        time_step_us = (raw.device_us - self._last.device_us) % TIME_WRAP_US
        if sequence_step == 0 and time_step_us == 0:
            self.duplicates += 1
            return None
        period_us = 1e6 / self.hello.rate_hz
        wraps = round((time_step_us / period_us - sequence_step) / SEQUENCE_WRAP)
        step = sequence_step + wraps * SEQUENCE_WRAP
        disagreement_us = abs(time_step_us - step * period_us)
        host_step_us = (raw.host_ns - self._last.host_ns) / 1000
        if (
            step < 1
            or disagreement_us > CLOCK_TOLERANCE * step * period_us + period_us
            or abs(time_step_us - host_step_us) > MAX_HOST_DISAGREEMENT_US
        ):
            self._pending = "discontinuity"
            self.on_link_down()
            self.before_hello += 1
            return None
        missing = step - 1
        self.lost += missing
        self.gaps += missing > 0
        self.delivered += 1
        self._seq += step
        self._device_us += time_step_us
        self._last = raw
        reason = self._pending or ("gap" if missing > self.max_gap else None)
        self._pending = None
        return Placed(raw, self._seq, self._device_us, missing, reason)

    def _begin(self, raw: RawSample, reason: EpochReason) -> Placed:
        self._pending = None
        self._last = raw
        self._seq, self._device_us = raw.sequence, raw.device_us
        self.delivered += 1
        return Placed(raw, self._seq, self._device_us, 0, reason)


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
