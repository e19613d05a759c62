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


FEW = 8
"""Samples from which on columns cost less than one by one; live, a read has one or two."""


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


class _Row(NamedTuple):
    """A sample before the next one."""

    sequence: int
    device_us: int
    host_ns: int


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
        self._last: _Row | None = None
        self._seq = self._device_us = 0

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

    def on_block(self, raw: RawBlock) -> Iterator[Piece]:
        """Cut samples into pieces without a gap; what cannot be used is counted and left out."""
        n = len(raw.sequence)
        if n < FEW and (piece := self._few(raw)) is not None:
            yield piece
            return
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

    def _few(self, raw: RawBlock) -> Piece | None:
        """The few samples of a read if each follows on the one before it; in place of columns, for speed."""
        before, hello = self._last, self.hello
        if before is None or hello is None or self._pending is not None:
            return None
        period_us, device_us = 1e6 / hello.rate_hz, [self._device_us]
        for row in zip(raw.sequence.tolist(), raw.device_us.tolist(), raw.host_ns.tolist(), strict=True):
            if not _follows(before, row, period_us):
                return None
            device_us.append(device_us[-1] + (row[1] - before[1]) % TIME_WRAP_US)
            before = _Row._make(row)
        count = len(device_us) - 1
        seq = np.arange(self._seq + 1, self._seq + 1 + count)
        self.delivered += count
        self._seq, self._device_us, self._last = self._seq + count, device_us[-1], before
        return Piece(raw, seq, np.array(device_us[1:]))

    def follow_on(self, raw: RawBlock) -> bool:
        """Tell whether all of them follow on what was there, without a gap or an epoch."""
        return bool(self._follow_on(raw).all())

    def _follow_on(self, raw: RawBlock) -> "np.ndarray[tuple[int], np.dtype[np.bool_]]":
        """Which samples are the next after the one before them by number, device's and host's clock; (n,)."""
        last, hello = self._last, self.hello
        n = len(raw.sequence)
        plain = np.zeros(n, dtype=np.bool_)
        if hello is None:
            return plain
        period_us = 1e6 / hello.rate_hz
        columns = raw.sequence, raw.device_us, raw.host_ns
        before, after = [one[:-1] for one in columns], [one[1:] for one in columns]
        plain[1:] = _follows(before, after, period_us)
        if last is not None and self._pending is None:
            plain[0] = _follows(last, [int(one[0]) for one in columns], period_us)
        return plain

    def _first(self, raw: RawBlock, row: int, *, continues: bool) -> Piece | None:
        """Place the first sample of a piece; None for one that cannot be used."""
        one = _Row(int(raw.sequence[row]), int(raw.device_us[row]), int(raw.host_ns[row]))
        last, hello = self._last, self.hello
        assert hello is not None
        missing, reason = 0, self._pending
        if last is None or reason not in (None, "sensor_restart"):
            return self._begin(raw, row, one, reason or "start")
        if one.host_ns - last.host_ns > MAX_SILENCE_NS:
            return self._begin(raw, row, one, reason or "silence")
        time_step_us = (one.device_us - last.device_us) % TIME_WRAP_US
        step = 1
        if not continues:
            sequence_step = (one.sequence - last.sequence) % SEQUENCE_WRAP
            if sequence_step == 0 and time_step_us == 0:
                self.duplicates += 1
                return None
            period_us = 1e6 / hello.rate_hz
            wraps = round((time_step_us / period_us - sequence_step) / SEQUENCE_WRAP)
            step = sequence_step + wraps * SEQUENCE_WRAP
            disagreement_us = abs(time_step_us - step * period_us)
            host_step_us = (one.host_ns - last.host_ns) / 1000
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
        seq, device_us = self._seq + step, self._device_us + time_step_us
        return Piece(raw, np.array([seq]), np.array([device_us]), missing, reason)

    def _begin(self, raw: RawBlock, row: int, one: _Row, reason: EpochReason) -> Piece:
        self._pending = None
        return Piece(raw, np.array([one.sequence]), np.array([one.device_us]), 0, reason)

    def _grown(self, piece: Piece, raw: RawBlock, begin: int, end: int) -> Piece:
        """The piece with the samples that follow on its first one, and how far it has come."""
        rows = raw if (begin, end) == (0, len(raw.sequence)) else raw.rows(begin, end)
        seq, device_us = piece.seq, piece.device_us
        if end - begin > 1:
            steps_us: Ints = (rows.device_us[1:] - rows.device_us[:-1]) % TIME_WRAP_US
            seq = seq[0] + np.arange(end - begin, dtype=np.int64)
            device_us = np.concatenate((device_us, device_us[0] + np.cumsum(steps_us)))
        self.delivered += end - begin
        self._seq, self._device_us = int(seq[-1]), int(device_us[-1])
        self._last = _Row(int(rows.sequence[-1]), int(rows.device_us[-1]), int(rows.host_ns[-1]))
        return Piece(rows, seq, device_us, piece.missing, piece.new_epoch)


def _follows(before: Any, after: Any, period_us: float) -> Any:
    """Whether a sample is the next after another; of columns of samples, of each."""
    sequence_step, host_step_ns = after[0] - before[0], after[2] - before[2]
    time_step_us = (after[1] - before[1]) % TIME_WRAP_US
    return (
        (sequence_step % SEQUENCE_WRAP == 1)
        & (abs(time_step_us - period_us) <= (CLOCK_TOLERANCE + 1) * period_us)
        & (abs(time_step_us * 1000 - host_step_ns) <= MAX_HOST_DISAGREEMENT_US * 1000)
        & (host_step_ns <= MAX_SILENCE_NS)
    )
