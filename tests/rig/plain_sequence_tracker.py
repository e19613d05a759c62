"""Compute each sample's sequence number and device time without wraps, and the number of lost samples.

The rules are those of protocol/README.md. The later steps are in `plain_device_stream`.
"""

from typing import NamedTuple

from fltea.records.events import RawSample
from fltea.records.records import EpochReason, Hello
from fltea.settings.config import Config
from fltea.settings.duration import in_samples

LONGEST_SILENCE_NS = 30 * 60 * 10**9
"""Longest silence between two samples of an epoch (a run with one numbering of samples).

Device time wraps every 71.6 minutes, so after a much longer silence the number of wraps is ambiguous.
"""
LONGEST_DISAGREEMENT_US = 5 * 60 * 10**6
"""Time since the last sample: largest accepted difference between the device's clock and the host's.

A larger difference shows a reset, after which device time begins again.
"""
CLOCK_TOLERANCE = 0.02
"""Largest accepted relative difference between two times since the last sample: the one that sequence numbers
give, and the one that the device's clock gives. It is twice the ±1 % of a sensor's own clock.
"""
LONGEST_GAP = 1_000_000
"""If more samples than this are lost, a new epoch begins, even if `link.max_gap` is longer."""


class Tracked(NamedTuple):
    """Number and device time of a sample, and the number of samples lost before it.

    `reason`: why the sample begins an epoch (samples with one numbering), or None.
    """

    seq: int
    device_us: int
    missing: int
    reason: EpochReason | None


def steps_between(last: RawSample, raw: RawSample, hello: Hello) -> int | None:
    """Return the number of sampling periods between two samples.

    Return None if sequence numbers and device times disagree.
    """
    elapsed_us, period_us = (raw.device_us - last.device_us) % 2**32, 1e6 / hello.rate_hz
    numbers = (raw.sequence - last.sequence) % 2**16
    # The elapsed time shows how often the 16-bit sequence number has wrapped.
    steps = numbers + 2**16 * round((elapsed_us / period_us - numbers) / 2**16)
    tolerance_us = CLOCK_TOLERANCE * steps * period_us + period_us
    return steps if steps >= 1 and abs(elapsed_us - steps * period_us) <= tolerance_us else None


class RateWatch:
    """Detects if times and sequence numbers of samples show another sampling rate than the HELLO states."""

    def __init__(self) -> None:
        self.begin()

    def begin(self) -> None:
        """Forget all earlier samples."""
        self._last: tuple[int, int] | None = None
        self._pairs: list[tuple[int, int]] = []
        self.says: str | None = None

    def add(self, sequence: int, device_us: int, period_us: float) -> str | None:
        """Compare a sample with the last sample.

        Returns:
            "agrees" if the sampling rate is that of the HELLO, "differs" if it is not, None if there are too
                few samples to decide.
        """
        last, self._last = self._last, (sequence, device_us)
        if last is None:
            return None
        step, step_us = (sequence - last[0]) % 2**16, (device_us - last[1]) % 2**32
        steps, us = (sum(column) for column in zip(*self._pairs, strict=True)) if self._pairs else (0, 0)
        is_alike = not self._pairs or 2 * abs(step_us * steps - us * step) <= us * step
        if not 1 <= step <= 64 or not step_us or not is_alike:
            self._pairs = []
            return None
        self._pairs.append((step, step_us))
        steps, us = steps + step, us + step_us
        found = None
        if len(self._pairs) >= 20:
            if abs(us - steps * period_us) > 0.05 * steps * period_us + 2 * period_us:
                found = "differs"
            elif steps >= 200:
                found = "agrees"
            self._pairs = [] if steps >= 200 else self._pairs
        self.says = found or self.says
        return found


# Why more than 12 attributes: it mirrors the native tracker, so that the two can be read side by side.
class PlainSequenceTracker:
    """Gives samples numbers that never wrap; counts used, rejected and lost samples (protocol/README.md)."""

    def __init__(self, config: Config) -> None:
        self._max_gap = config.link.max_gap
        self.hello: Hello | None = None
        self.delivered = self.lost = self.gaps = self.duplicates = self.before_hello = self.rate_differs = 0
        self._watch, self.contradicts, self._disagreed = RateWatch(), False, False
        self.news = False
        self._boot: tuple[int | None, str | None] | None = None
        self._sensor_starts: int | None = None
        self._rate_hz = 0.0
        # why the next sample begins an epoch; None if it begins none
        self._reason: EpochReason | None = "start"
        self._last: RawSample | None = None
        self._seq = self._device_us = 0

    def on_hello(self, hello: Hello) -> bool:
        """Accept the samples that follow this HELLO.

        Returns:
            True if this HELLO is the first one, or states another boot or another sensor.
        """
        boot, before = (hello.boot_id, hello.device_id), self._boot
        sensor_began = hello.sensor_starts != self._sensor_starts
        is_news = boot != before or sensor_began or self.hello is None
        is_another_rate = self._rate_hz != hello.rate_hz
        if before is not None and boot != before:
            self._reason = "restart"
        elif sensor_began and self._reason is None:
            self._reason = "sensor_restart"
        self._boot, self._sensor_starts, self.hello = boot, hello.sensor_starts, hello
        self._rate_hz = hello.rate_hz
        if boot != before or sensor_began or is_another_rate:
            self._watch.begin()
            self._set_filter_models()
        return is_news

    def on_link_down(self) -> None:
        """Reject samples until the next HELLO, since another device may have been plugged in."""
        self.hello, self._disagreed = None, False
        self._watch.begin()
        self._set_filter_models()

    def on_break(self, reason: EpochReason) -> None:
        """Begin an epoch (a new numbering of samples) at the next sample, because a recording says so.

        If another reason for a new epoch is known already, it is kept. Only "sensor_restart" is replaced.
        """
        if self._reason in (None, "sensor_restart"):
            self._reason = reason

    def track(self, raw: RawSample) -> Tracked | None:
        """Return number and device time of a sample; None for a sample that cannot be used."""
        last, hello, reason = self._last, self.hello, self._reason
        if self.contradicts:
            self.rate_differs += 1
            if self._compare(raw) == "agrees":
                self._set_filter_models()
            return None
        if hello is None:
            self.before_hello += 1
            if self._disagreed:
                self._compare(raw)
            return None
        # This sample begins an epoch for a known reason, so earlier samples no longer matter.
        if last is None or reason not in (None, "sensor_restart"):
            return self._used(raw, Tracked(raw.sequence, raw.device_us, 0, reason))
        if raw.host_ns - last.host_ns > LONGEST_SILENCE_NS:
            return self._used(raw, Tracked(raw.sequence, raw.device_us, 0, reason or "silence"))

        elapsed_us = (raw.device_us - last.device_us) % 2**32
        if elapsed_us == 0 and raw.sequence == last.sequence:
            self.duplicates += 1
            return None
        steps, elapsed_on_host_us = steps_between(last, raw, hello), (raw.host_ns - last.host_ns) / 1000
        if steps is None or abs(elapsed_us - elapsed_on_host_us) > LONGEST_DISAGREEMENT_US:
            # The device has restarted, or this is another device; the next HELLO states which.
            self._reason, self.hello = "discontinuity", None
            self.before_hello += 1
            self._disagreed = True
            self._compare(raw)
            return None
        missing = steps - 1
        self.lost += missing
        self.gaps += missing > 0
        if reason is None and missing > min(in_samples(self._max_gap, hello.rate_hz, 1), LONGEST_GAP):
            reason = "gap"
        return self._used(raw, Tracked(self._seq + steps, self._device_us + elapsed_us, missing, reason))

    def _used(self, raw: RawSample, tracked: Tracked) -> Tracked:
        self.delivered += 1
        self._last, self._reason = raw, None
        self._seq, self._device_us = tracked.seq, tracked.device_us
        self._compare(raw)
        return tracked

    def _compare(self, raw: RawSample) -> str | None:
        found = self._watch.add(raw.sequence, raw.device_us, 1e6 / self._rate_hz)
        # While a HELLO is awaited, the sample may come from another device.
        if self._watch.says == "differs" and self.hello is not None and not self.contradicts:
            self.contradicts = self.news = True
        return found

    def _set_filter_models(self) -> None:
        if self.contradicts and self._reason is None:
            self._reason = "discontinuity"
        self.contradicts = self.news = False
