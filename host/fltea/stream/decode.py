"""Convert the events of a source into samples in physical units, with sequence numbers and times.

The native device (host/native/device.hpp) makes the conversion. The native device also runs the estimators
that `fltea.stream.pipeline` gives it. When a recording is exported, it has no estimators. An epoch is a
stretch of samples without a restart of the estimators. Within an epoch, the sequence numbers and times of
samples do not wrap.
"""

from collections.abc import Callable, Iterator
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np

from fltea import _native
from fltea.records.block import Block
from fltea.records.events import Break, Event, LinkDown, RawBlock
from fltea.records.records import AXES, EpochReason, Hello
from fltea.records.stats import SampleStats
from fltea.settings.duration import Duration, in_samples
from fltea.settings.estimator import LONGEST_GAP
from fltea.settings.outputs import OutputConfig
from fltea.wire.sample_scaling import Scales


class Stop(IntEnum):
    """Reasons for which the native device stops while it processes samples (host/native/device.hpp)."""

    END = 0
    """All samples of the block are processed."""
    MORE = 1
    """Nothing has happened, but only a part of the samples has been processed so far."""
    STATS_DUE = 2
    """Statistics are due before the next sample is processed."""
    GAP = 3
    """The next sample follows a gap. Details: number of missing samples, sequence number and time of the next
    sample, and the axes that became invalid.
    """
    EPOCH = 4
    """The next sample begins an epoch, after a restart or a long gap. Details: the fields of `FirstSample`.
    """
    HAPPENED = 5
    """At the last processed sample there were events. Details: for each event, the sensor, and what happened:
    axes that became invalid, a step, or a motion.
    """
    WINDOW_FULL = 6
    """With the last processed sample, the start-up window of a sensor is full."""
    FIT_COUNTS = 7
    """A refit takes effect at the next sample."""
    FIT_DUE = 8
    """A refit has to begin after the last processed sample."""
    RATE_DIFFERS = 9
    """The device's clock contradicts its HELLO, so that further samples are not used. Details: sampling rate
    in the HELLO, and sampling rate by the device's clock [Hz].
    """


OfSensors = list[tuple[list[Any], list[Any] | None] | None]
"""For each sensor, the columns with the results of its bias tracker, and those with the results of its
filters. The latter are None if no filters run. For a sensor without samples, the whole entry is None.
"""

Rows = tuple[int, tuple[Any, ...], OfSensors]
"""Processed samples. The tuple has the index of the first of them in the source's block, the columns of the
samples, and the results of trackers and filters.
"""


class FirstSample(NamedTuple):
    """The first sample of an epoch.

    `missing`: number of samples lost just before this sample. `seq`, `epoch_us`: number and time [µs] of the
    sample within the epoch, which do not wrap. `sequence`, `device_us`: its number and time [µs] as received,
    which wrap. `gyro_axes`,
    `has_accel`: number of axes of the gyroscope, and whether the samples contain an accelerometer whose scale
    is known.
    """

    reason: EpochReason
    missing: int
    seq: int
    epoch_us: int
    sequence: int
    device_us: int
    gyro_axes: int
    has_accel: bool


class Decoded(NamedTuple):
    """Samples without a gap, in physical units and in counts.

    `missing`: number of samples that were lost just before these samples. `new_epoch`: reason why an epoch
    begins with these samples, or None.
    """

    block: Block
    raw: RawBlock
    hello: Hello
    missing: int
    new_epoch: EpochReason | None


class Decoder:
    """Converts the events of a source into samples.

    `unix_offset_ns`: function that returns the offset from the source's clock to Unix time [ns]. `max_gap`:
    longest gap that does not end an epoch, in samples or as a time. `device`, `output`: name of the device
    and settings of the output, for the blocks. `epoch`: number of the present epoch, from 1; 0 before the
    first epoch.
    """

    def __init__(
        self,
        unix_offset_ns: Callable[[], int],
        max_gap: Duration,
        device: str | None = None,
        output: OutputConfig | None = None,
    ) -> None:
        self.native = _native.Device()
        self.epoch = 0
        self._unix_offset_ns, self._max_gap = unix_offset_ns, max_gap
        self._hello: Hello | None = None
        self.contradiction: str | None = None
        """Message to the user if the device's clock contradicts its HELLO, else None. Only `feed` sets this.
        """
        self._template = _empty(device, output or OutputConfig())

    @property
    def hello(self) -> Hello | None:
        """The newest HELLO; None while the device is unknown."""
        return self._hello if self.native.knows_hello else None

    @property
    def source(self) -> str:
        """Name of the samples' source in the newest HELLO; empty before the first HELLO."""
        return "" if self._hello is None else self._hello.source

    @property
    def counts(self) -> SampleStats:
        """The numbers of samples that were used, lost and dropped until now."""
        return SampleStats(**self.native.counts)

    def on_hello(self, hello: Hello) -> bool:
        """Take over a HELLO, and return whether it is new.

        A HELLO is new if it is the first one (also after a lost connection), or states another boot or
        another start of the sensor.
        """
        before = self._hello
        another_boot = before is None or _boot(hello) != _boot(before)
        another_sensor = before is None or hello.sensor_starts != before.sensor_starts
        news = another_boot or another_sensor or not self.native.knows_hello
        self._hello = hello
        longest = min(in_samples(self._max_gap, hello.rate_hz, 1), LONGEST_GAP)
        self.native.on_hello(hello.rate_hz, longest, another_boot, another_sensor, Scales.of(hello))
        return news

    def on_other(self, event: Event) -> None:
        """Process an event that is neither a HELLO nor samples."""
        if isinstance(event, LinkDown):
            self.native.forget_hello()  # the next samples may come from another device
        elif isinstance(event, Break):
            self.native.on_break(event.reason)

    def feed(self, event: Event) -> Iterator[Decoded | Hello]:
        """Process one event.

        Yield the usable samples, and each HELLO that differs from the previous HELLO.
        """
        if isinstance(event, RawBlock):
            yield from self._decoded(event)
        elif not isinstance(event, Hello):
            self.on_other(event)
        elif self.on_hello(event):
            yield event

    def advance(self, raw: RawBlock) -> Iterator[tuple[Stop, int, Rows | None, Any]]:
        """Process samples, and yield each stop.

        A stop consists of its reason, the index of the next sample, the processed samples, and the details.

        The caller handles each stop before it asks for the next stop. For the reason `EPOCH` it calls
        `begin`.
        """
        stop, index = -1, 0
        while stop != Stop.END:
            stop, index, rows, details = self.native.advance(raw, index)
            yield stop, index, rows, details  # type: ignore[misc]

    def begin(self, sensors: list[Any]) -> None:
        """Begin an epoch. `sensors`: as `_native.Device.begin` takes them."""
        self.epoch += 1
        self._template = self._template.but(epoch=self.epoch)
        self.native.begin(self._unix_offset_ns(), sensors)

    def block(self, samples: tuple[Any, ...]) -> Block:
        """Return the samples, whose columns are given, as a block."""
        seq, device_us, host_ns, gyro_dps, accel_ms2, temperature_c, flags = samples
        return self._template.but(
            seq=seq,
            device_us=device_us,
            host_ns=host_ns,
            gyro_dps=gyro_dps,
            accel_ms2=accel_ms2,
            temperature_c=temperature_c,
            flags=flags,
        )

    def _decoded(self, raw: RawBlock) -> Iterator[Decoded]:
        missing, reason = 0, None
        for stop, _, rows, details in self.advance(raw):
            if stop == Stop.EPOCH:
                reason, missing, *_ = details  # here, `details` has the fields of `FirstSample`
                self.begin([])
            elif stop == Stop.GAP:
                missing, *_ = details
            elif stop == Stop.RATE_DIFFERS:
                self.contradiction = explain_rate(self.source, *details)
            if rows is None:
                continue
            first, samples, _ = rows
            own = raw.rows(first, first + len(samples[0]))
            assert self._hello is not None
            yield Decoded(self.block(samples), own, self._hello, missing, reason)
            missing, reason = 0, None


def explain_rate(source: str, stated_hz: float, measured_hz: float) -> str:
    """Return the message about a device whose clock contradicts its HELLO."""
    return (
        f"{source}: HELLO states {stated_hz:.4g} Hz, but by the device's own clock and numbers its samples "
        f"come at {measured_hz:.4g} Hz. One of the two is wrong, and so is each figure in seconds or Hz. So "
        "the samples are counted (rate_differs), but not used until both agree. Correct the rate, or the "
        "clock, in its firmware."
    )


def _empty(device: str | None, output: OutputConfig) -> Block:
    """Return a block without samples, from which other blocks are made."""
    whole = np.empty(0, dtype=np.int64)
    rates = np.empty((0, len(AXES)))
    return Block(device, 0, whole, whole, whole, rates, every=output.every, corrected=output.corrected)


def _boot(hello: Hello) -> tuple[int | None, str | None]:
    return hello.boot_id, hello.device_id
