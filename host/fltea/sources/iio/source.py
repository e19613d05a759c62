"""Reads a gyroscope or IMU that has a driver in the Linux kernel: `iio:NAME_OR_PATH`.

Samples come from the driver's triggered buffer, with time stamps. From these, the samples' numbers are
computed. A time stamp that is too late for the next number shows that samples were lost. The time stamps also
give the sampling rate.
"""

import math
import os
import select
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple
from urllib.parse import parse_qsl

import numpy as np

from fltea.process.wake_up import WakeUp
from fltea.recording.sample_times import TimeColumn
from fltea.recording.session import HIGHEST_RATE_HZ, LOWEST_RATE_HZ
from fltea.records import clock
from fltea.records.errors import UsageError
from fltea.records.events import SEQUENCE_WRAP, TIME_WRAP_US, Event, LinkDown, RawBlock, Tick, Trouble
from fltea.records.records import Hello
from fltea.records.repeat import OnceAMinute
from fltea.records.stats import LinkStats
from fltea.records.units import STANDARD_GRAVITY_MS2
from fltea.settings.config import Config
from fltea.sources.iio.buffer import Buffer, Unusable, Wishes, rate_of
from fltea.sources.iio.conversion import Conversion, conversion, parse_mount
from fltea.sources.iio.sysfs import ACCEL, GYRO, SENSORS, Attributes, devices, find, root_of
from fltea.sources.numbering import Arrived, ByOrder, ByTime, Numbered
from fltea.sources.opening import Named
from fltea.sources.silence import PATIENCE_NS, Silence
from fltea.wire.ports import TICK_S

READ_BYTES = 1 << 16
BACKOFF_S = (0.25, 0.5, 1.0, 2.0, 5.0)
RATE_TOLERANCE = 0.05
"""If the measured rate differs from the driver's stated rate by more than this proportion, the user is
warned. A chip's own oscillator is accurate only to a few percent.
"""


class Place(NamedTuple):
    """Parts of the URL: the device, the requested settings, and whether to apply the mount matrix."""

    device: str
    wishes: Wishes
    mount: bool = True


def parse_url(rest: str) -> Place:
    """Return the parts of the URL after `iio:`.

    Raises:
        UsageError: the URL names no device, has an unknown key, or gives an impossible rate.
    """
    what, _, query = rest.partition("?")
    usual = "Give for instance iio:bmi088_gyro or 'iio:iio:device0?rate_hz=200'; 'fltea devices' lists them"
    if not what:
        raise UsageError(f"iio:{rest}: no device is named. {usual}.")
    rate_hz, trigger, mount = None, None, True
    for key, value in parse_qsl(query, keep_blank_values=True):
        if key == "rate_hz":
            try:
                rate_hz = float(value)
            except ValueError:
                rate_hz = math.nan
            if not LOWEST_RATE_HZ <= rate_hz <= HIGHEST_RATE_HZ:
                raise UsageError(f"iio:{rest}: rate_hz={value} is not a rate of a gyroscope.")
        elif key == "trigger":
            trigger = value
        elif (key, value) == ("mount", "off"):
            mount = False
        else:
            raise UsageError(
                f"iio:{rest}: there is no '{key}={value}'; it takes rate_hz, trigger and mount=off. {usual}."
            )
    return Place(what, Wishes(rate_hz, trigger), mount)


class Counts:
    """Counts of one source since its beginning.

    `openings`: how often the device was opened. `duplicates`, `unrated`: samples that were left out, see
    `ByTime`.
    """

    def __init__(self) -> None:
        self.bytes = self.samples = self.openings = self.duplicates = self.unrated = 0

    def link_stats(self) -> LinkStats:
        """Return the counts of the connection, in which samples count as frames."""
        counts = {"duplicate_time": self.duplicates, "no_rate": self.unrated}
        return LinkStats(
            bytes=self.bytes,
            frames=self.samples,
            bad_frames={reason: n for reason, n in counts.items() if n},
            reconnects=max(0, self.openings - 1),
        )


class IioSource:
    """Reads the samples of one device. Each failure becomes a `Trouble`, and then the device is opened again.

    `rest`: the part of the URL after `iio:`. `unix_offset_ns`: offset from the monotonic clock to Unix time
    at the last event [ns].

    Raises:
        UsageError: `parse_url` refuses the URL.
    """

    live = prompt = has_clock = True

    def __init__(self, rest: str) -> None:
        self._place = parse_url(rest)
        self._root = root_of(self._place.device)
        self.url = f"iio:{rest}"
        self._boot = int.from_bytes(os.urandom(4), "big")
        self._wake_up = WakeUp()
        self._closed = False
        self._reported = OnceAMinute()
        self._counts = Counts()
        self.unix_offset_ns = clock.unix_offset_ns()

    def events(self) -> Iterator[Event]:
        """Yield the device's events until `close`."""
        failures = 0
        while not self._closed:
            before = self._counts.samples
            try:
                for event in self._use():
                    self.unix_offset_ns = clock.unix_offset_ns()
                    yield event
            except Unusable as unusable:
                yield from self._report(unusable.kind, str(unusable))
            except OSError as error:
                yield LinkDown(clock.host_ns())
                yield from self._report(
                    "unplugged",
                    f"the device was lost ({error.strerror}): it was unplugged, its driver was unloaded, or "
                    "somebody switched its buffer off. It is opened again.",
                )
            failures = 0 if self._counts.samples > before else failures + 1
            yield from self._pause(BACKOFF_S[min(failures, len(BACKOFF_S) - 1)])

    def link_stats(self) -> LinkStats:
        """Return the counts of the connection, in which samples count as frames.

        Samples that were lost are not counted here, since gaps in the samples' numbers show them.
        """
        return self._counts.link_stats()

    def close(self) -> None:
        """Let the iteration of `events` end, which also restores the device's settings."""
        self._closed = True
        self._wake_up.ring()

    def _use(self) -> Iterator[Event]:
        """Open the device, and read samples until the device is lost."""
        device = self._find()
        channels = {kind: device.channels(kind) for kind in (GYRO, ACCEL)}
        if not channels[GYRO]:
            raise Unusable("open_failed", f"{device.id} ({device.name}) {_what_it_has(device)}.")
        if len(channels[ACCEL]) != 3:
            channels[ACCEL] = []
        buffer = Buffer(self._root, device, channels[GYRO] + channels[ACCEL], self._place.wishes)
        try:
            convert = {
                kind: conversion_of(device, kind, channels[kind], self._place.mount)
                for kind in channels
                if channels[kind]
            }
            self._counts.openings += 1
            reader = _Reader(device, self._root, buffer, channels, convert)
            lost: OSError | None = None
            try:
                yield from self._read(reader, buffer)
            except OSError as error:
                lost = error
            # samples may still wait until their rate is known
            yield from self._hand_on(reader, reader.numbers.finish(), clock.host_ns())
            if lost is not None:
                raise lost
        finally:
            buffer.close()

    def _find(self) -> Attributes:
        found = find(self._root, self._place.device)
        if len(found) == 1:
            return found[0]
        if found:
            names = ", ".join(one.id for one in found)
            raise Unusable("open_failed", f"several devices are called '{self._place.device}': {names}.")
        there = ", ".join(f"{one.name} ({one.id})" for one in devices(self._root) if one.is_imu)
        raise Unusable(
            "no_port",
            f"there is no IIO device '{self._place.device}'. "
            + (
                f"There is {there}."
                if there
                else "This machine has no gyroscope with a driver of the kernel: "
                "is its module loaded (lsmod), and its device-tree overlay in config.txt?"
            ),
        )

    def _read(self, reader: "_Reader", buffer: Buffer) -> Iterator[Event]:
        ready = select.poll()
        ready.register(buffer.fd, select.POLLIN)
        ready.register(self._wake_up, select.POLLIN)
        silence, rest = Silence(clock.host_ns()), b""
        while not self._closed:
            found = {fd for fd, _ in ready.poll(TICK_S * 1000)}
            now_ns = clock.host_ns()
            data = b""
            if buffer.fd in found and not self._closed:
                try:
                    data = os.read(buffer.fd, READ_BYTES)
                except BlockingIOError:
                    continue
                if not data:
                    raise OSError(0, "its buffer has ended")
            if not data:
                yield Tick(now_ns)
                if silence.lasts(now_ns, PATIENCE_NS):
                    text = f"no sample came for {PATIENCE_NS // 10**9} s; {reader.why_silent()}."
                    yield from self._report("silent", text)
                continue
            silence.heard(now_ns)
            self._counts.bytes += len(data)
            rest += data
            whole = len(rest) // buffer.layout.size * buffer.layout.size
            if not whole:
                continue
            yield from self._hand_on(reader, reader.take(rest[:whole], now_ns), now_ns)
            rest = rest[whole:]

    def _hand_on(self, reader: "_Reader", pieces: Iterator[Numbered], now_ns: int) -> Iterator[Event]:
        """Yield the events of samples that got a sequence number, and count those that were left out."""
        numbers = reader.numbers
        duplicates, unrated = numbers.duplicates, numbers.unrated
        for piece in pieces:
            if piece.begins:
                self._boot = (self._boot + 1) % (1 << 32)
            if piece.begins or reader.hello_due:
                reader.hello_due = False
                yield reader.hello(self.url, self._boot, now_ns)
                yield from self._judge_rate(reader)
            self._counts.samples += len(piece.sequence)
            yield reader.block(piece)
        self._counts.duplicates += numbers.duplicates - duplicates
        self._counts.unrated += numbers.unrated - unrated
        if numbers.unrated and numbers.rate_hz is None:
            yield from self._report("no_rate", "from the time stamps of its samples no rate can be told.")

    def _judge_rate(self, reader: "_Reader") -> Iterator[Trouble]:
        said, found = reader.said_hz, reader.numbers.rate_hz
        if said is not None and found is not None and abs(found / said - 1) > RATE_TOLERANCE:
            text = f"the driver says {said:g} Hz, but samples come at {found:.4g} Hz; the latter is used."
            yield from self._report("rate_differs", text, fatal=False)

    def _report(self, kind: str, text: str, *, fatal: bool = True) -> Iterator[Trouble]:
        now_ns = clock.host_ns()
        if self._reported.is_due((kind, text), now_ns):
            yield Trouble(kind, f"{self.url}: {text}", now_ns, fatal)

    def _pause(self, seconds: float) -> Iterator[Event]:
        end_ns = clock.host_ns() + round(seconds * 1e9)
        while not self._closed and (left_ns := end_ns - clock.host_ns()) > 0:
            self._wake_up.wait(min(TICK_S, left_ns * 1e-9))
            yield Tick(clock.host_ns())


class _Reader:
    """Turns the scans that are read after one opening of a device into blocks of samples.

    `hello_due`: whether no HELLO was given yet.
    """

    def __init__(
        self,
        device: Attributes,
        root: Path,
        buffer: Buffer,
        channels: dict[str, list[str]],
        convert: dict[str, Conversion],
    ) -> None:
        self._device, self._layout, self._channels, self._convert = device, buffer.layout, channels, convert
        self.said_hz = rate_of(root, device)
        self.hello_due = True
        self.numbers: ByTime | ByOrder
        self._origin_ns: int | None = None
        self._ordinal = 0
        self._has_time = buffer.has_time
        if buffer.has_time:
            self.numbers = ByTime(device.id, TimeColumn("timestamp", "ns"))
        elif self.said_hz is not None:
            self.numbers = ByOrder(self.said_hz)
        else:
            raise Unusable(
                "no_rate",
                f"{device.id} has no time stamps, and its driver does not say its rate: give it, "
                "'iio:NAME?rate_hz=100'.",
            )

    def take(self, data: bytes, now_ns: int) -> Iterator[Numbered]:
        """Number the samples of whole scans, and yield the samples' counts with their sequence numbers."""
        counts = self._layout.decode(data)
        names = self._channels[GYRO] + self._channels[ACCEL]
        values = np.stack([counts[name] for name in names], axis=1).astype(np.float64)
        time = None
        if self._has_time:
            if self._origin_ns is None:
                self._origin_ns = int(counts["timestamp"][0])
            time = (counts["timestamp"] - self._origin_ns).astype(np.float64)
        ordinal = self._ordinal + np.arange(len(values), dtype=np.int64)
        self._ordinal += len(values)
        return self.numbers.add(Arrived(values, time, ordinal), now_ns)

    def block(self, piece: Numbered) -> RawBlock:
        """Return numbered samples as a block, in which their counts are converted."""
        axes = len(self._channels[GYRO])
        return RawBlock(
            piece.sequence % SEQUENCE_WRAP,
            piece.device_us % TIME_WRAP_US,
            piece.host_ns,
            self._convert[GYRO](piece.values[:, :axes]),
            self._convert[ACCEL](piece.values[:, axes:]) if ACCEL in self._convert else None,
        )

    def hello(self, source: str, boot_id: int, now_ns: int) -> Hello:
        """Return the HELLO of the device."""
        assert self.numbers.rate_hz is not None
        accel = self._convert.get(ACCEL)
        return Hello(
            source=source,
            host_ns=now_ns,
            rate_hz=self.numbers.rate_hz,
            sampling_mode="iio",
            boot_id=boot_id,
            sensor=self._device.name,
            gyro_lsb_per_dps=self._convert[GYRO].lsb,
            accel_lsb_per_g=None if accel is None or accel.lsb is None else accel.lsb * STANDARD_GRAVITY_MS2,
        )

    def why_silent(self) -> str:
        """Return what the user should check if no samples come."""
        trigger = self._device.text("trigger/current_trigger")
        if trigger:
            return (
                f"its trigger '{trigger}' does not fire: is its interrupt wired, and its rate set "
                "(sampling_frequency)? 'grep iio /proc/interrupts' shows its count"
            )
        return "is its interrupt wired, and its rate set (sampling_frequency)?"


def conversion_of(device: Attributes, kind: str, channels: list[str], mounted: bool) -> Conversion:
    """Return the conversion of a sensor's channels. It is computed from the files of the sensor's driver.

    `kind`: sensor, "anglvel" or "accel". `mounted`: whether to apply the mount matrix.

    Raises:
        Unusable: the sensor has no scale, or one of its files has an impossible value.
    """
    unit = math.pi / 180 if kind == GYRO else 1.0  # drivers give scales in rad/s and m/s²
    scales = [device.of_channel(channel, "scale") for channel in channels]
    if None in scales:
        raise Unusable("open_failed", f"{device.id} does not say the scale of its {SENSORS[kind]}.")
    offsets = [device.of_channel(channel, "offset") or 0.0 for channel in channels]
    try:
        mount = parse_mount(device.mount_matrix(kind)) if mounted else None
        return conversion([scale / unit for scale in scales if scale is not None], offsets, mount)
    except ValueError as error:
        raise Unusable("open_failed", f"{device.id}: {SENSORS[kind]}: {error}.") from error


def _what_it_has(device: Attributes) -> str:
    if device.channels(ACCEL):
        return "has an accelerometer and no gyroscope; the gyroscope may be another device of the same chip"
    if any(device.folder.glob("in_anglvel*_raw")):
        return (
            "has a gyroscope, but no buffer: 'sudo modprobe industrialio-triggered-buffer', or a newer kernel"
        )
    return "has no gyroscope"


def open_named(named: Named, config: Config) -> IioSource:
    """Return the source that reads a device of the kernel."""
    return IioSource(named.place)


def only_reader_of(named: Named) -> str:
    """Return the device, by the name that the URL gives it."""
    return f"iio:{named.place.partition('?')[0]}"
