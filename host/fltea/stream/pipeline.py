"""The walk of one sample: source → decode (continuity → timebase → units) → estimator → records.

The sources stand before it (transport, framing and messages inside the serial one), the sinks behind it.
"""

from collections.abc import Callable, Generator, Iterable, Iterator

import msgspec

from fltea.lab.reference.gyroscope import AxisEstimate
from fltea.records.errors import UsageError
from fltea.records.events import DeviceAxis, DeviceEstimator, Event, LinkDown, RawSample, Trouble
from fltea.records.ports import Source
from fltea.records.records import (
    ACCEL_AXES,
    AXES,
    AnyRecord,
    DeviceStatus,
    Epoch,
    EpochReason,
    Error,
    Estimate,
    EstimatorInfo,
    Gap,
    Hello,
    OutputStats,
    SampleStats,
    Stats,
)
from fltea.service.state import DeviceState, sensor_of, why_unused
from fltea.settings.config import BY_DEVICE, Config
from fltea.stream.board import DeviceFollower, Notice
from fltea.stream.board_settings import info_of, unused_settings
from fltea.stream.channels import Channels, explain_lost
from fltea.stream.decode import Decoded, Decoder
from fltea.wire.sample_scaling import accel_resolution_ms2, resolution_dps

STATS_PERIOD_NS = 10**9
LOST_PERIOD_NS = 60 * 10**9
LONGEST_BRIDGE = 30_000
"""Missing samples that a resumed estimator of unlimited memory predicts: half a second's work."""


def no_outputs() -> dict[str, OutputStats]:
    """Counts of the outputs where there are none."""
    return {}


class Pipeline:
    """Turns the events of one source into records, in order.

    outputs: gives the counts of the outputs for `stats`, which shows them of sources with a pace of their
    own: of others they would only tell how fast this machine was. state: a snapshot of an earlier run.
    """

    def __init__(
        self,
        source: Source,
        config: Config,
        outputs: Callable[[], dict[str, OutputStats]] = no_outputs,
        state: DeviceState | None = None,
    ) -> None:
        self._source = source
        self._config = config
        self._outputs = outputs
        self._state = state
        self._decoder = Decoder(lambda: source.unix_offset_ns, config.link.max_gap, config.name)
        who = config.estimator.estimate_on
        self._follower = DeviceFollower(who, config.name) if who in BY_DEVICE else None
        self._gyro: Channels | None = None
        self._accel: Channels | None = None
        self._sample_ns: int | None = None
        self._board: DeviceStatus | None = None
        self._now_ns = 0
        self._told_lost: dict[str, int] = {}
        self._told_no_axis = self._told_unused = False
        self._offset_ns = source.unix_offset_ns
        self._stats_due_ns: int | None = None

    def feed(self, event: Event) -> Iterator[AnyRecord]:
        """Yield what one event leads to.

        Raises:
            UsageError: a fixed bias or R that does not fit the axes.
        """
        if not isinstance(event, DeviceStatus):
            self._now_ns = event.host_ns
        if self._decoder.timebase is None:  # the source may not have known the date before
            self._offset_ns = self._source.unix_offset_ns
        match event:
            case DeviceStatus():
                self._board = event
            case LinkDown():
                self._board = None
            case Trouble():
                yield self._error(event.kind, event.message)
        if self._follower is not None:
            yield from self._follow(self._follower, event)
        match self._decoder.feed(event):
            case Hello() as hello:
                if self._follower is not None:
                    self._follower.forget_samples()
                yield msgspec.structs.replace(hello, host_ns=self._unix_ns(), device=self._config.name)
            case Decoded() as decoded:
                yield from self._on_sample(decoded)
        if self._stats_due_ns is None:
            self._stats_due_ns = self._now_ns + STATS_PERIOD_NS
        elif self._now_ns >= self._stats_due_ns:
            yield self.stats()

    def _follow(self, follower: DeviceFollower, event: Event) -> Iterator[AnyRecord]:
        """Let what the device says of its own estimates lead to records."""
        if isinstance(event, LinkDown):
            follower.forget_device()
        elif self._decoder.continuity.hello is None:
            follower.forget_samples()
        if isinstance(event, DeviceAxis):
            yield from self._told(follower.on_axis(event))
        elif isinstance(event, DeviceEstimator) and self._decoder.continuity.hello is not None:
            yield from self._told(follower.on_estimator(event))

    def _told(self, items: Iterable[AnyRecord | Notice]) -> Iterator[AnyRecord]:
        for item in items:
            yield self._error(item.kind, item.message) if isinstance(item, Notice) else item

    def save(self) -> DeviceState | None:
        """A snapshot of the estimators, for a later run; None while there is nothing to keep."""
        hello, sample_ns = self._decoder.continuity.hello, self._sample_ns
        gyro = self._gyro.save() if self._gyro else None
        accel = self._accel.save() if self._accel else None
        unfinished = (self._gyro and not gyro) or (self._accel and not accel)
        if hello is None or sample_ns is None or unfinished or not (gyro or accel):
            return None
        unix_ns = sample_ns + self._source.unix_offset_ns  # the epoch's own would keep a date set since
        return DeviceState(sensor_of(hello, self._config), unix_ns, gyro, accel)

    def _on_sample(self, decoded: Decoded) -> Iterator[AnyRecord]:
        sample, raw, hello, missing, reason = decoded
        name, resumed_after_s = self._config.name, None
        if reason is not None:
            self._offset_ns = self._source.unix_offset_ns
            reason, resumed_after_s = yield from self._begin(raw, hello, reason)
        else:
            for channels in self._channels():
                channels.on_missing(missing)
            if self._follower is not None:
                self._follower.on_missing(missing)
        if missing:
            epoch = sample.epoch - (reason is not None)
            yield Gap(sample.seq - missing, missing, epoch, sample.host_ns, device=name)
        if reason is not None:
            yield Epoch(
                sample.epoch,
                reason,
                sample.seq,
                sample.device_us,
                sample.host_ns,
                hello.boot_id,
                self._gyro_info(),
                self._accel.info() if self._accel else None,
                resumed_after_s,
                device=name,
            )
        self._sample_ns = raw.host_ns
        yield sample
        gyro = yield from self._estimate(self._gyro, sample.gyro_dps)
        accel = yield from self._estimate(self._accel, sample.accel_ms2 or ())
        if gyro or accel:
            yield Estimate(
                sample.seq,
                sample.epoch,
                sample.device_us,
                sample.host_ns,
                self._gyro.config.variant if self._gyro and gyro else self._config.accel.variant,
                self._gyro.gyro_estimates(gyro) if self._gyro and gyro else {},
                self._accel.accel_estimates(accel) if self._accel and accel else None,
                device=name,
            )
        if self._follower is not None:
            yield from self._told(self._follower.on_sample(sample, raw.host_ns, gyro))

    def _gyro_info(self) -> EstimatorInfo | None:
        if self._follower is not None and self._follower.alone:
            return info_of(self._follower.stated) if self._follower.stated else None
        return self._gyro.info() if self._gyro else None

    def _estimate(
        self, channels: Channels | None, values: tuple[float, ...]
    ) -> Generator[AnyRecord, None, dict[str, AxisEstimate] | None]:
        """Let one sensor's channels take a sample; yield what there is to tell, return their estimates."""
        if channels is None:
            return None
        waited = channels.constant_axes is None
        estimates = channels.on_sample(values)
        if waited and channels.constant_axes is not None:
            yield from self._on_baseline(channels.constant_axes)
        for axis, why in channels.lost.items():
            told_ns = self._told_lost.get(axis)
            if told_ns is None or self._now_ns - told_ns >= LOST_PERIOD_NS:
                self._told_lost[axis] = self._now_ns
                yield self._error(*explain_lost(axis, why))
        return estimates

    def _on_baseline(self, constant_axes: tuple[str, ...]) -> Iterator[AnyRecord]:
        for axis in constant_axes:
            remedy = "--set accel.R=9e-4" if axis in ACCEL_AXES else "--r 0.02"
            text = (
                f"{axis} did not change over the start-up window, so R cannot be drawn from it, and the axis "
                f"stays invalid. Is the sensor alive? If such data are meant, give R: {remedy}."
            )
            yield self._error("constant_axis", text)
        yield self.stats()

    def stats(self) -> Stats:
        """Sum up the whole walk so far."""
        self._stats_due_ns = self._now_ns + STATS_PERIOD_NS
        c, timebase = self._decoder.continuity, self._decoder.timebase
        of_device = self._follower.stats() if self._follower else None
        remaining = [one.startup_remaining for one in self._channels()]
        if self._follower is not None and self._follower.alone:
            remaining.append(of_device.startup_remaining if of_device else 0)
            axes = self._follower.axes_stats()
        else:
            axes = self._gyro.gyro_stats() if self._gyro else {}
        return Stats(
            epoch=self._decoder.epoch,
            host_ns=self._unix_ns(),
            rate_hz=timebase.rate_hz if timebase else None,
            clock_ppm=timebase.clock_ppm if timebase else None,
            startup_remaining=max(remaining, default=0),
            link=self._source.link_stats(),
            samples=SampleStats(c.delivered, c.lost, c.gaps, c.duplicates, c.before_hello),
            axes=axes,
            board=self._board,
            accel_axes=self._accel.accel_stats() if self._accel else None,
            outputs=self._outputs() if self._source.prompt else {},
            device_estimator=of_device,
            device=self._config.name,
        )

    def _channels(self) -> list[Channels]:
        return [one for one in (self._gyro, self._accel) if one is not None]

    def _begin(
        self, raw: RawSample, hello: Hello, reason: EpochReason
    ) -> Generator[Error, None, tuple[EpochReason, float | None]]:
        """Begin to estimate, from the snapshot if there is one that fits.

        Returns why the epoch begins, and how old the snapshot is.
        """
        yield from self._tell_absent(raw, hello)
        yield from self._tell_unused()
        state, self._state = self._state, None
        if state is not None:
            now_unix_ns = raw.host_ns + self._offset_ns
            problem = why_unused(state, hello, self._config, now_unix_ns)
            if problem is None:
                try:
                    self._open(raw, hello, state)
                except ValueError as error:
                    problem = str(error)
                else:
                    age_s = (now_unix_ns - state.unix_ns) * 1e-9
                    missing = max(0, round(age_s * hello.rate_hz) - 1)
                    for channels in self._channels():
                        channels.on_missing(min(missing, channels.config.window or LONGEST_BRIDGE))
                    return "resumed", age_s
            text = f"the snapshot is not used, so the start-up window begins: {problem}."
            yield self._error("state_unused", text)
        try:
            self._open(raw, hello, None)
        except ValueError as error:
            raise UsageError(f"estimator: {error}.") from error
        return reason, None

    def _open(self, raw: RawSample, hello: Hello, state: DeviceState | None) -> None:
        """Make the estimators; raises ValueError for settings, or a snapshot, that they cannot begin with."""
        wanted, config, h = self._config.channels, self._config, 1.0 / hello.rate_hz
        gyro = [i for i, axis in enumerate(AXES[: len(raw.gyro)]) if wanted is None or axis in wanted]
        accel = [i for i, axis in enumerate(ACCEL_AXES) if axis in (wanted or ())]
        self._gyro = self._accel = None
        names, estimator = [AXES[i] for i in gyro], config.estimator
        if self._follower is not None:
            self._follower.begin(names)
            estimator = self._follower.settings(estimator)
        if gyro and not (self._follower and self._follower.alone):
            saved = state.gyro if state else None
            self._gyro = Channels(names, gyro, estimator, h, resolution_dps(hello), saved)
        if accel and _has_accel(raw, hello):
            names, resolution = [ACCEL_AXES[i] for i in accel], accel_resolution_ms2(hello)
            saved = state.accel if state else None
            self._accel = Channels(names, accel, config.accel, h, resolution, saved)

    def _tell_absent(self, raw: RawSample, hello: Hello) -> Iterator[Error]:
        """Tell once which of the channels asked for the source does not have."""
        available = AXES[: len(raw.gyro)] + (ACCEL_AXES if _has_accel(raw, hello) else ())
        absent = [axis for axis in self._config.channels or () if axis not in available]
        if absent and not self._told_no_axis:
            self._told_no_axis = True
            text = (
                f"channels names {', '.join(absent)}, which this source does not have, or has no scale for."
            )
            yield self._error("no_axis", text)

    def _tell_unused(self) -> Iterator[Error]:
        """Tell once which settings were changed for nothing, since the device has its own."""
        who = self._config.estimator.estimate_on
        if self._follower is None or self._told_unused:
            return
        self._told_unused = True
        unused = unused_settings(self._config.estimator)
        if unused:
            text = (
                f"{', '.join(unused)}: not used with --estimate-on {who}, since the device estimates with "
                "the settings of its firmware" + (", and so does this computer." if who == "both" else ".")
            )
            yield self._error("settings_unused", text)

    def _error(self, kind: str, message: str) -> Error:
        return Error(kind, message, self._unix_ns(), device=self._config.name)

    def _unix_ns(self) -> int:
        return self._now_ns + self._offset_ns


def _has_accel(raw: RawSample, hello: Hello) -> bool:
    return raw.accel is not None and bool(hello.accel_lsb_per_g)
