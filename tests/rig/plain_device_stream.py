"""Process samples as the host does, in plain Python, one sample at a time, from top to bottom.

This module is the oracle of `fltea.stream.pipeline`, and shows the steps of the pipeline.
`PlainDeviceStream.feed` takes a sample. Then:

1. `PlainSequenceTracker` computes the sample's number and device time without wraps, and counts lost samples.
2. `one_by_one.Timebase` computes its host time from a line through the earliest arrivals of ten minutes.
3. `in_units` converts its counts into deg/s, m/s² and °C, by the scales of the newest HELLO.
4. `plain_tracks.SensorTracks` estimates the bias of each axis, and detects motion of the sensor.
5. `plain_sensor.Sensor` computes bias and R in the start-up window, and filters all later samples.
6. `PlainDeviceStream` yields the resulting records, in order, and statistics once a second.

The oracle has no live fits, and does not process estimates that boards compute.
"""

from collections.abc import Iterator
from typing import NamedTuple

import msgspec
from fltea.records.estimate import AxisEstimate
from fltea.records.events import Break, Event, LinkDown, RawBlock, RawSample, Trouble, host_ns_of
from fltea.records.ports import Source
from fltea.records.records import (
    ACCEL_AXES,
    ACCEL_UNIT,
    AXES,
    GYRO_UNIT,
    AnyRecord,
    Epoch,
    EpochReason,
    Error,
    Estimate,
    Gap,
    Hello,
    Motion,
    Sample,
    Stats,
    Step,
)
from fltea.records.stats import DeviceStatus, SampleStats
from fltea.settings.config import Config
from fltea.settings.estimator import EstimatorConfig

from tests.rig.one_by_one import Timebase
from tests.rig.plain_sensor import Loss, Sensor, Vector
from tests.rig.plain_sequence_tracker import LONGEST_SILENCE_NS, PlainSequenceTracker, steps_between
from tests.rig.plain_tracks import SampleTimes, SensorTracks, with_tracks

SECOND_NS = 10**9
MINUTE_NS = 60 * SECOND_NS


def in_units(raw: RawSample, hello: Hello) -> tuple[Vector, Vector | None, float | None]:
    """Convert a sample's counts. Return rates [deg/s], specific forces [m/s²] and temperature [°C].

    A scale of None means that the values are in these units already.
    """
    lsb, per_g = hello.gyro_lsb_per_dps, hello.accel_lsb_per_g
    gyro_dps = tuple(counts / (1.0 if lsb is None else lsb) for counts in raw.gyro)
    accel_ms2 = temperature_c = None
    if raw.accel is not None and per_g != 0:  # A scale of 0 means that the scale is unknown.
        ms2 = 1.0 if per_g is None else 9.80665 / per_g
        accel_ms2 = tuple(counts * ms2 for counts in raw.accel)
    if raw.temperature is not None:
        lsb_per_c, zero_c = (340.0, 36.53) if hello.who_am_i == 0x68 else (333.87, 21.0)
        temperature_c = raw.temperature / lsb_per_c + zero_c
    return gyro_dps, accel_ms2, temperature_c


class Saved(NamedTuple):
    """The state from which a later run resumes.

    Filters and trackers are handed over, not copied, so the saved run cannot continue.

    `sample`: the last sample before the snapshot.
    `unix_ns`: Unix time of the sample's arrival, by the machine's date when the snapshot was taken [ns].
    `made_with`: values that must be unchanged for the snapshot to be used.
    """

    made_with: dict[str, object]
    unix_ns: int
    boot_id: int | None
    sample: RawSample
    sensors: list[Sensor]
    tracks: dict[str, SensorTracks]


# Why more than 12 attributes: it mirrors the native pipeline, so that the two can be read side by side.
class PlainDeviceStream:
    """Turns the events of one source into records.

    `stats_s`: time between two statistics [s]. `watched`: whether the records are read live; otherwise
    statistics come only at the end.
    """

    def __init__(
        self,
        source: Source,
        config: Config,
        saved: Saved | None = None,
        *,
        stats_s: int = 1,
        watched: bool = True,
    ) -> None:
        self._source, self._config, self._saved, self._watched = source, config, saved, watched
        self._stats_ns = stats_s * SECOND_NS
        self._stats_due_ns: int | None = None
        self._sequence = PlainSequenceTracker(config)
        self._timebase: Timebase | None = None
        self._epoch = self._now_ns = 0
        # Within an epoch (a run without a restart), the offset from the host clock to Unix time is fixed, so
        # that setting the machine's date later does not change times.
        self._offset_ns = source.unix_offset_ns
        self._sensors: list[Sensor] = []
        self._tracks: dict[str, SensorTracks] = {}  # the bias trackers of each sensor, by the unit of values
        self._board: DeviceStatus | None = None
        self._newest: RawSample | None = None  # the newest sample that was not rejected
        self._lost_told_ns: dict[str, int] = {}
        self._absent_told = False

    def feed(self, event: Event) -> Iterator[AnyRecord]:
        """Yield the records of one event. Statistics come before the first event of a new second."""
        if isinstance(event, RawBlock):
            for raw in event.samples():
                yield from self._on_time(raw.host_ns)
                yield from self._on_sample(raw)
            return
        yield from self._on_time(host_ns_of(event))
        match event:
            case Hello() if self._sequence.on_hello(event):
                yield msgspec.structs.replace(event, host_ns=self._unix_ns, device=self._config.name)
            case LinkDown():
                self._sequence.on_link_down()
                self._board = None
            case Break(reason):
                self._sequence.on_break(reason)
            case DeviceStatus():
                self._board = event
            case Trouble(kind, message):
                yield self._error(kind, message)

    def finish(self) -> Stats:
        """Return the final statistics."""
        return self.stats()

    def _on_time(self, host_ns: int | None) -> Iterator[AnyRecord]:
        self._now_ns = self._now_ns if host_ns is None else host_ns
        # Before the first sample of an epoch the offset to Unix time is updated, since a source may learn the
        # date late.
        if self._timebase is None:
            self._offset_ns = self._source.unix_offset_ns
        if self._stats_due_ns is not None:
            if self._now_ns < self._stats_due_ns:
                return
            if self._watched:
                yield self.stats()
        self._stats_due_ns = (self._now_ns // self._stats_ns + 1) * self._stats_ns

    def _on_sample(self, raw: RawSample) -> Iterator[AnyRecord]:
        tracked, hello = self._sequence.track(raw), self._sequence.hello
        if tracked is None or hello is None:
            return
        seq, device_us, missing, reason = tracked
        gyro_dps, accel_ms2, temperature_c = in_units(raw, hello)
        resumed_after_s = None
        if reason is not None:
            self._offset_ns = self._source.unix_offset_ns
            self._timebase = Timebase(self._offset_ns)
            self._epoch += 1
            yield from self._absent(raw, accel_ms2)
            reason, resumed_after_s, why_not = self._begin(raw, hello, reason, accel_ms2)
            if why_not:
                text = f"the snapshot is not used: {why_not}. The start-up window begins anew."
                yield self._error("state_unused", text)
        assert self._timebase is not None
        host_ns, device = self._timebase.add(seq, device_us, raw.host_ns), self._config.name
        # The samples missing before this one belong to the epoch of the sample before them. So the gap is
        # published with the number of that epoch, even if this sample begins another epoch.
        if missing:
            of_epoch = self._epoch - (reason is not None)
            yield Gap(seq - missing, missing, of_epoch, host_ns, device=device)
        times = SampleTimes(seq, self._epoch, device_us, host_ns)
        if reason is not None:
            info = {sensor.unit: sensor.info() for sensor in self._sensors}
            of_both = info.get(GYRO_UNIT), info.get(ACCEL_UNIT)
            yield Epoch(
                self._epoch,
                reason,
                seq,
                device_us,
                host_ns,
                hello.boot_id,
                *of_both,
                resumed_after_s,
                device=device,
            )
        elif missing:
            for sensor in self._sensors:
                self._tracks[sensor.unit].miss(missing)
                yield from self._lost(sensor.miss(missing))
        self._newest = raw
        is_due = seq % self._config.output.every == 0
        if is_due:
            yield Sample(*times, gyro_dps, accel_ms2, temperature_c, raw.flags, device=device)
        yield from self._estimate(times, gyro_dps, accel_ms2, is_due=is_due)
        if self._sequence.news:
            self._sequence.news = False
            yield self._error("rate_differs", "rate_differs")

    def _estimate(
        self, times: SampleTimes, gyro_dps: Vector, accel_ms2: Vector | None, *, is_due: bool
    ) -> Iterator[AnyRecord]:
        """Run trackers and filters on a sample.

        Yield the estimate, steps of the bias and motion, and an error for each axis that became invalid or
        was constant over the start-up window.
        """
        axes: dict[str, AxisEstimate] = {}
        happened: list[Step | Motion] = []
        lost: list[Loss] = []
        full: list[Sensor] = []
        variant = ""
        for sensor in self._sensors:
            values = gyro_dps if sensor.unit == GYRO_UNIT else accel_ms2
            if values is None:
                continue
            tracks = self._tracks[sensor.unit]
            tracked = tracks.take(values, accel_ms2 if sensor.unit == GYRO_UNIT else None)
            happened += tracks.happened(times, self._config.name)
            filled = sensor.startup_remaining == 1
            found, lost_of_sensor = sensor.take(values)
            variant = variant or (sensor.config.variant if found else "")
            axes |= {axis: with_tracks(one, tracked[axis]) for axis, one in found.items()}
            lost += lost_of_sensor
            full += [sensor] if filled else []
        if axes and is_due:
            yield Estimate(*times, variant, axes, device=self._config.name)
        yield from self._lost(sorted(lost))
        yield from happened
        for axis in (axis for sensor in full for axis in sensor.constant_axes):
            yield self._error("constant_axis", axis)

    def _begin(
        self, raw: RawSample, hello: Hello, reason: EpochReason, accel_ms2: Vector | None
    ) -> tuple[EpochReason, float | None, str | None]:
        """Begin an epoch. If there is a snapshot of an earlier run that fits, continue from it.

        Returns:
            Reason why the epoch begins, age of the snapshot [s], and reason why the snapshot was not used.
        """
        saved, self._saved = self._saved, None
        self._sensors = list(self._sensors_of(raw, hello, accel_ms2))
        self._tracks = {
            one.unit: SensorTracks(
                one.axes, one.unit, self._settings_of(one.unit), self._config.live, one.rate_hz
            )
            for one in self._sensors
        }
        if saved is None:
            return reason, None, None
        now_unix_ns = raw.host_ns + self._offset_ns
        if why_not := why_unused(saved, hello, self._config, now_unix_ns):
            return reason, None, why_not
        age_s = (now_unix_ns - saved.unix_ns) * 1e-9
        known = {sensor.unit: sensor for sensor in saved.sensors}
        self._sensors = [known.get(sensor.unit, sensor) for sensor in self._sensors]
        self._tracks |= saved.tracks
        for sensor in self._sensors:
            missing = missing_since(saved, hello, raw, age_s)
            sensor.bridge(missing)
            self._tracks[sensor.unit].miss(missing)
        return "resumed", age_s, None

    def _sensors_of(self, raw: RawSample, hello: Hello, accel_ms2: Vector | None) -> Iterator[Sensor]:
        """Yield the sensors that have axes in the setting `channels`. By default, this is the gyroscope
        alone.
        """
        config, wanted, rate_hz = self._config, self._config.channels, hello.rate_hz
        lsb, per_g = hello.gyro_lsb_per_dps, hello.accel_lsb_per_g
        gyro = {axis: k for k, axis in enumerate(AXES[: len(raw.gyro)]) if wanted is None or axis in wanted}
        if gyro:
            yield Sensor(gyro, GYRO_UNIT, config.estimator, rate_hz, 0.0 if lsb is None else 1 / lsb)
        accel = {axis: k for k, axis in enumerate(ACCEL_AXES) if accel_ms2 and axis in (wanted or ())}
        if accel:
            yield Sensor(accel, ACCEL_UNIT, config.accel, rate_hz, 9.80665 / per_g if per_g else 0.0)

    def _settings_of(self, unit: str) -> EstimatorConfig:
        return self._config.estimator if unit == GYRO_UNIT else self._config.accel

    def _absent(self, raw: RawSample, accel_ms2: Vector | None) -> Iterator[Error]:
        """Report once which of the channels in the settings are missing."""
        there = AXES[: len(raw.gyro)] + (ACCEL_AXES if accel_ms2 else ())
        absent = [axis for axis in self._config.channels or () if axis not in there]
        if absent and not self._absent_told:
            self._absent_told = True
            yield self._error("no_axis", ", ".join(absent))

    def _lost(self, lost: list[Loss]) -> Iterator[Error]:
        """Report which axes became invalid, each at most once a minute."""
        for axis, why in lost:
            told_ns = self._lost_told_ns.get(axis)
            if told_ns is None or self._now_ns - told_ns >= MINUTE_NS:
                self._lost_told_ns[axis] = self._now_ns
                yield self._error(f"axis_{why}", axis)

    def stats(self) -> Stats:
        """Return the statistics so far."""
        sequence, timebase = self._sequence, self._timebase
        tracker = {axis: stats for one in self._tracks.values() for axis, stats in one.stats()}
        return Stats(
            epoch=self._epoch,
            host_ns=self._unix_ns,
            rate_hz=timebase.rate_hz if timebase else None,
            clock_ppm=timebase.clock_ppm if timebase else None,
            startup_remaining=max((one.startup_remaining for one in self._sensors), default=0),
            link=self._source.link_stats(),
            sample_counts=SampleStats(
                **{name: getattr(sequence, name) for name in SampleStats.__struct_fields__}
            ),
            axes={
                axis: msgspec.structs.replace(stats, tracker=tracker[axis])
                for one in self._sensors
                for axis, stats in one.stats()
            },
            board=self._board,
            device=self._config.name,
        )

    def save(self) -> Saved | None:
        """Return a snapshot of the state, from which a later run can resume.

        The result is None while a start-up window fills, if an axis is constant, or if the device is unknown.
        """
        # until the first epoch of this run begins, the snapshot of the earlier run is kept
        if self._saved is not None:
            return self._saved
        hello, newest = self._sequence.hello, self._newest
        if hello is None or newest is None or not self._sensors:
            return None
        if any(one.baseline is None or one.constant_axes for one in self._sensors):
            return None
        unix_ns = newest.host_ns + self._source.unix_offset_ns
        return Saved(
            made_with(hello, self._config), unix_ns, hello.boot_id, newest, self._sensors, self._tracks
        )

    @property
    def _unix_ns(self) -> int:
        return self._now_ns + self._offset_ns

    def _error(self, kind: str, message: str) -> Error:
        return Error(kind, message, self._unix_ns, device=self._config.name)


def made_with(hello: Hello, config: Config) -> dict[str, object]:
    """Return values that must not change between a snapshot and its use, by their names in messages."""
    return {
        "device_id": hello.device_id,
        "who_am_i": hello.who_am_i,
        "scales": (hello.gyro_lsb_per_dps, hello.accel_lsb_per_g),
        "filter_hz": hello.gyro_dlpf_hz,
        "rate_hz": hello.rate_hz,
        "channels": config.channels,
        "live.memory": config.live.memory,
        "settings": (config.estimator, config.accel),
    }


def why_unused(saved: Saved, hello: Hello, config: Config, now_unix_ns: int) -> str | None:
    """Return the reason why a snapshot cannot be used; None if it can be used."""
    age_s, longest_s = (now_unix_ns - saved.unix_ns) * 1e-9, config.state.max_age_s
    if age_s < 0:
        return "it is dated in the future, so the system's clock was probably set back"
    if age_s > longest_s:
        return f"it is {age_s:.0f} s old (state.max_age_s is {longest_s:g})"
    other = [key for key, value in made_with(hello, config).items() if saved.made_with[key] != value]
    if other:
        return f"it was made for a device or settings that differ in: {', '.join(other)}"
    # The filters keep the sampling rate with which their epoch began. A later HELLO of the same boot may
    # state another rate, which is then the one in `made_with`.
    is_other_rate = any(sensor.rate_hz != hello.rate_hz for sensor in saved.sensors)
    return "it was saved with other settings" if is_other_rate else None


def missing_since(saved: Saved, hello: Hello, raw: RawSample, age_s: float) -> int:
    """Return the number of samples between a snapshot and the sample `raw`.

    The sequence numbers give it if they agree with the device's clock; otherwise the snapshot's age does.
    """
    is_same_boot = saved.boot_id is not None and saved.boot_id == hello.boot_id
    if is_same_boot and age_s <= LONGEST_SILENCE_NS * 1e-9:
        steps = steps_between(saved.sample, raw, hello)
        if steps is not None:
            return steps - 1
    return max(0, round(age_s * hello.rate_hz) - 1)
