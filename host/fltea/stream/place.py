"""Sequence and device time unwrapped; gaps and epochs found (pure).

The rules are those of protocol/README.md: SAMPLE's sequence numbers the sampling instants, so within a
boot delivered + lost = due, also where the sensor was set up again; where sequence and time disagree
the device was restarted or exchanged, and nothing is believed until its next HELLO.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from fltea.records.events import SEQUENCE_WRAP, TIME_WRAP_US, Ints, RawBlock
from fltea.records.records import EpochReason, Hello
from fltea.settings.duration import Duration, in_samples
from fltea.settings.estimator import LONGEST_GAP

MAX_SILENCE_NS = 30 * 60 * 10**9
"""After half an hour without a sample the wraps of device time (71.6 minutes) cannot be counted."""

MAX_HOST_DISAGREEMENT_US = 5 * 60 * 10**6
"""A reset can look like a gap of up to 71 minutes; the host's clock, late as it may be, knows better."""

CLOCK_TOLERANCE = 0.02
"""Sequence and time may differ by twice the ±1 % of the sensor's own clock, plus one period."""


class Piece(NamedTuple):
    """Samples that follow one another, with their place in the epoch.

    missing: samples lost just before the first one, by number `seq[0] - missing` to `seq[0] - 1`.
    new_epoch: why time is broken before it, None where it is not.
    """

    raw: RawBlock
    seq: Ints
    device_us: Ints
    missing: int = 0
    new_epoch: EpochReason | None = None


class FollowRule(NamedTuple):
    """What the next sample is of a device with this period."""

    period_us: float
    tolerance_us: float
    disagreement_ns: int
    silence_ns: int

    @classmethod
    def at(cls, rate_hz: float) -> "FollowRule":
        """Return that of a rate."""
        period_us = 1e6 / rate_hz
        tolerance_us = (CLOCK_TOLERANCE + 1) * period_us
        return cls(period_us, tolerance_us, MAX_HOST_DISAGREEMENT_US * 1000, MAX_SILENCE_NS)

    def follows(self, before: Any, after: Any) -> Any:
        """Whether a sample is the next after another; of columns of samples, of each."""
        sequence_step, host_step_ns = after[0] - before[0], after[2] - before[2]
        time_step_us = (after[1] - before[1]) % TIME_WRAP_US
        return (
            (sequence_step % SEQUENCE_WRAP == 1)
            & (abs(time_step_us - self.period_us) <= self.tolerance_us)
            & (abs(time_step_us * 1000 - host_step_ns) <= self.disagreement_ns)
            & (host_step_ns <= self.silence_ns)
        )


class Newest(NamedTuple):
    """The newest sample, as it came, and its number and time in the epoch."""

    sequence: int
    device_us: int
    host_ns: int
    seq: int
    epoch_us: int


class Place:
    """Turns wrapped samples into unbroken pieces, and states where they broke.

    max_gap: longest gap that an epoch survives, in samples or as a time.
    Counters: `delivered`, `lost`, `gaps`, `duplicates`, `before_hello` (samples that could not
    be used because their HELLO had not been heard).
    """

    def __init__(self, max_gap: Duration) -> None:
        self._max_gap = max_gap
        self.hello: Hello | None = None
        self.delivered = self.lost = self.gaps = self.duplicates = self.before_hello = 0
        self._boot: tuple[int | None, str | None] | None = None
        self._sensor_starts: int | None = None
        self._pending: EpochReason | None = "start"
        self._newest: Newest | None = None

    def on_hello(self, hello: Hello) -> bool:
        """Take note of a HELLO; True if it states something new (the first, or another boot or sensor)."""
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
        """Believe no sample until the next HELLO: it may come from another device."""
        self.hello = None

    def on_break(self, reason: EpochReason) -> None:
        """Begin a new epoch with the next sample, where a recording states that one began."""
        if self._pending in (None, "sensor_restart"):
            self._pending = reason

    @property
    def newest(self) -> Newest | None:
        """The sample on which the next one may follow; None where that one is no ordinary one."""
        return self._newest if self._pending is None and self.hello is not None else None

    def go_on(self, count: int, newest: Newest) -> None:
        """Take note of so many samples that followed on, up to this one."""
        self.delivered += count
        self._newest = newest

    def on_block(self, raw: RawBlock) -> Iterator[Piece]:
        """Cut samples into pieces without a gap; what cannot be used is counted and left out."""
        n = len(raw.sequence)
        plain = self._follow_on(raw)
        begin = 0
        while begin < n:
            if self.hello is None:
                self.before_hello += n - begin
                return
            breaks = np.flatnonzero(~plain[begin + 1 :])
            end = begin + 1 + int(breaks[0]) if len(breaks) else n
            piece = self._first(raw, begin, continues=bool(plain[begin]))
            if piece is not None:
                yield self._grown(piece, raw, begin, end)
            elif end > begin + 1:  # one that is left out: what follows is judged by itself
                plain[begin + 1] = False
                end = begin + 1
            begin = end

    def follow_on(self, raw: RawBlock) -> bool:
        """Tell whether all of them follow on what was there, without a gap or an epoch."""
        return bool(self._follow_on(raw).all())

    def _follow_on(self, raw: RawBlock) -> "np.ndarray[tuple[int], np.dtype[np.bool_]]":
        """Which samples are the next after the one before them by number, device's and host's clock; (n,)."""
        last, hello = self._newest, self.hello
        n = len(raw.sequence)
        plain = np.zeros(n, dtype=np.bool_)
        if hello is None:
            return plain
        rule = FollowRule.at(hello.rate_hz)
        columns = raw.sequence, raw.device_us, raw.host_ns
        before, after = [one[:-1] for one in columns], [one[1:] for one in columns]
        plain[1:] = rule.follows(before, after)
        if last is not None and self._pending is None:
            plain[0] = rule.follows(last, [int(one[0]) for one in columns])
        return plain

    def _first(self, raw: RawBlock, row: int, *, continues: bool) -> Piece | None:
        """Place the first sample of a piece; None for one that cannot be used."""
        one = [int(column[row]) for column in (raw.sequence, raw.device_us, raw.host_ns)]
        sequence, device_us, host_ns = one
        last, hello = self._newest, self.hello
        assert hello is not None
        missing, reason = 0, self._pending
        if last is None or reason not in (None, "sensor_restart"):
            return self._begin(raw, sequence, device_us, reason or "start")
        if host_ns - last.host_ns > MAX_SILENCE_NS:
            return self._begin(raw, sequence, device_us, reason or "silence")
        time_step_us = (device_us - last.device_us) % TIME_WRAP_US
        step = 1
        if not continues:
            sequence_step = (sequence - last.sequence) % SEQUENCE_WRAP
            if sequence_step == 0 and time_step_us == 0:
                self.duplicates += 1
                return None
            period_us = 1e6 / hello.rate_hz
            wraps = round((time_step_us / period_us - sequence_step) / SEQUENCE_WRAP)
            step = sequence_step + wraps * SEQUENCE_WRAP
            disagreement_us = abs(time_step_us - step * period_us)
            host_step_us = (host_ns - last.host_ns) / 1000
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
            longest = min(in_samples(self._max_gap, hello.rate_hz, 1), LONGEST_GAP)
            reason = reason or ("gap" if missing > longest else None)
        self._pending = None
        seq, epoch_us = last.seq + step, last.epoch_us + time_step_us
        return Piece(raw, np.array([seq]), np.array([epoch_us]), missing, reason)

    def _begin(self, raw: RawBlock, sequence: int, device_us: int, reason: EpochReason) -> Piece:
        self._pending = None
        return Piece(raw, np.array([sequence]), np.array([device_us]), 0, reason)

    def _grown(self, piece: Piece, raw: RawBlock, begin: int, end: int) -> Piece:
        """The piece with the samples that follow on its first one, and how far it has come."""
        rows = raw if (begin, end) == (0, len(raw.sequence)) else raw.rows(begin, end)
        seq, device_us = piece.seq, piece.device_us
        if end - begin > 1:
            steps_us: Ints = (rows.device_us[1:] - rows.device_us[:-1]) % TIME_WRAP_US
            seq = seq[0] + np.arange(end - begin, dtype=np.int64)
            device_us = np.concatenate((device_us, device_us[0] + np.cumsum(steps_us)))
        columns = rows.sequence, rows.device_us, rows.host_ns, seq, device_us
        self.go_on(end - begin, Newest(*(int(column[-1]) for column in columns)))
        return Piece(rows, seq, device_us, piece.missing, piece.new_epoch)
