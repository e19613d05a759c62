"""The sensors of a device in one epoch: what tracks their biases, sums their noise and filters their axes."""

from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple

from fltea.estimator.lanes import Reason
from fltea.estimator.tracker import events_of
from fltea.records.block import Block
from fltea.records.errors import UsageError
from fltea.records.records import ACCEL_UNIT, GYRO_UNIT, Motion, Step
from fltea.settings.config import Config
from fltea.settings.estimator import EstimatorConfig
from fltea.spectrum.live_axes import LiveAxes
from fltea.stream.channels import Channels
from fltea.stream.decode import OfSensors
from fltea.stream.epoch import Beginning, Moment, Saved, Standing
from fltea.stream.happenings import record_of
from fltea.stream.live import LiveFits
from fltea.stream.tracking import SensorTracks
from fltea.wire.sample_scaling import accel_resolution_ms2, resolution_dps


class Sensor(NamedTuple):
    """One sensor. sums: None where nothing is fitted; channels: None where nothing is estimated here."""

    name: str
    unit: str
    tracks: SensorTracks
    sums: LiveAxes | None
    channels: Channels | None

    def native(self) -> tuple[Any, ...]:
        """Return what `_native.Device.begin` takes of it."""
        sums, channels = self.sums, self.channels
        of_sums = (None, 0) if sums is None else (sums.octaves.native, sums.longest_motion)
        of_bank: tuple[Any, int, list[bool]] = (None, 0, [False] * len(self.tracks.names))
        if channels is not None:
            of_bank = channels.bank.native, channels.bank.startup_remaining, channels.waiting
        return self.name == "accel", self.tracks.places, self.tracks.tracker.native, *of_sums, *of_bank

    def go_by(self, fits: LiveFits | None) -> None:
        """Take the fits that count from the next sample on."""
        if fits is None:
            return
        accepted = [fits.accepted(axis) for axis in self.tracks.names]
        for axis, one in zip(self.tracks.names, accepted, strict=True):
            self.tracks.go_by(axis, one)
        if self.channels is not None:
            self.channels.go_by(accepted)

    def bridge(self, count: int) -> None:
        """Predict over the time for which the program stood still."""
        self.tracks.skip(count)
        if self.channels is not None:
            self.channels.bridge(count)


class Sensors:
    """Both sensors of the epoch that goes on.

    settings: gives those of the gyroscope's filters, asked for whenever an epoch begins; None if a board
    alone estimates. fits: the live fits, None where there are none.
    """

    def __init__(
        self, config: Config, settings: Callable[[], EstimatorConfig | None], fits: LiveFits | None
    ) -> None:
        self._config, self._settings, self._fits = config, settings, fits
        self._all: list[Sensor] = []

    def begin(self, beginning: Beginning) -> list[tuple[Any, ...]]:
        """Begin an epoch, from what was saved if it fits; what `_native.Device.begin` takes.

        Raises:
            ValueError: settings, or a snapshot, that it cannot begin with; nothing has changed then.
            UsageError: more samples than there may be.
        """
        config, hello, saved = self._config, beginning.hello, beginning.saved or Saved()
        gyro, accel = beginning.axes(config.channels)
        h = 1 / hello.rate_hz
        of_gyro = None
        if gyro and (here := self._settings()) is not None:
            settings = _at(here, "estimator", hello.rate_hz)
            of_gyro = Channels(gyro, settings, h, resolution_dps(hello), GYRO_UNIT, saved.gyro)
        of_accel = None
        if accel:
            settings = _at(config.accel, "accel", hello.rate_hz)
            of_accel = Channels(accel, settings, h, accel_resolution_ms2(hello), ACCEL_UNIT, saved.accel)
        tracks: dict[str, SensorTracks] = {}
        for name, axes, estimator, unit, data in (
            ("gyro", gyro, config.estimator, GYRO_UNIT, saved.gyro_track),
            ("accel", accel, config.accel, ACCEL_UNIT, saved.accel_track),
        ):
            if axes:
                tracks[name] = SensorTracks(axes, estimator, config.live, h, unit)
                if data is not None:
                    tracks[name].load(data)
        sums = {} if self._fits is None else self._fits.begin(beginning)
        channels = {"gyro": of_gyro, "accel": of_accel}
        self._all = [
            Sensor(name, one.unit, one, sums.get(name), channels[name]) for name, one in tracks.items()
        ]
        for one in self._all:
            one.go_by(self._fits)
        return [one.native() for one in self._all]

    def go_by_fits(self, device: Any) -> None:
        """Take the fits that count from the next sample on. device: the native one."""
        for number, one in enumerate(self._all):
            one.go_by(self._fits)
            if one.channels is not None:
                device.set_waits(number, one.channels.waiting)

    def fill(self, device: Any) -> Iterator[Channels]:
        """Let those begin to estimate whose start-up window is full, and yield them."""
        for number, one in enumerate(self._all):
            channels = one.channels
            if channels is not None and channels.bank.startup_remaining and not device.window_left(number):
                channels.fill()
                device.set_waits(number, channels.waiting)
                yield channels

    def bridge(self, count: int) -> None:
        """Predict over the time for which the program stood still."""
        if self._fits is not None:
            self._fits.bridge(count)
        for one in self._all:
            one.bridge(count)

    def block(self, block: Block, of_sensors: OfSensors) -> Block:
        """Return samples with what the sensors made of them."""
        tracked, estimates, variant = [], [], ""
        for one, found in zip(self._all, of_sensors, strict=True):
            if found is None:
                continue
            of_tracker, of_bank = found
            tracked.append(one.tracks.columns(of_tracker))
            if of_bank is not None and one.channels is not None:
                estimates.append(one.channels.columns(of_bank))
                variant = variant or one.channels.config.variant
        return block.but(tracked=tuple(tracked), estimates=tuple(estimates), variant=variant)

    def lost(self, number: int, losses: Iterable[tuple[int, int, Reason]]) -> list[tuple[str, Reason]]:
        """Return the names of axes of a sensor that became invalid, and why."""
        channels = self._all[number].channels
        return [] if channels is None else channels.losses(losses)

    def happened(self, number: int, event: Any, moment: Moment) -> Step | Motion:
        """Return the record of what has happened to a sensor with a sample; event: as of `events_of`."""
        tracks = self._all[number].tracks
        (found,) = events_of([event])
        return record_of(found, moment, tracks.names, tracks.unit, tracks.h, self._config.name)

    @property
    def words(self) -> object:
        """What stands in all records of samples until a fit changes it."""
        return [(one.tracks.words, None if one.channels is None else one.channels.words) for one in self._all]

    def tracks(self, axis: str) -> SensorTracks:
        """Return what tracks the bias of an axis."""
        return next(one.tracks for one in self._all if axis in one.tracks.names)

    def standing(self, device: Any) -> Standing:
        """Return how they get on. device: the native one."""
        standing = Standing(fit_period_s=self._fits.period_s() if self._fits is not None else None)
        for number, one in enumerate(self._all):
            standing.tracker |= dict(one.tracks.stats())
            if one.channels is None:
                continue
            left = device.window_left(number)
            standing.startup_remaining = max(standing.startup_remaining, left)
            standing.axes |= dict(one.channels.stats())
            if one.name == "gyro":
                standing.gyro = one.channels.info
            else:
                standing.accel = one.channels.info
        return standing

    def save(self) -> dict[str, Any]:
        """Return what a later run needs to go on, by the fields of `Saved`; nothing while a window fills."""
        filters = {one.name: one.channels.save() for one in self._all if one.channels is not None}
        if not filters or not all(filters.values()):
            return {}
        tracks = {f"{one.name}_track": one.tracks.save() for one in self._all}
        sums = {f"{one.name}_fit": one.sums.save() for one in self._all if one.sums is not None}
        return filters | tracks | sums


def _at(config: EstimatorConfig, table: str, rate_hz: float) -> EstimatorConfig:
    """Return the settings with times as samples.

    Raises:
        UsageError: more samples than there may be.
    """
    try:
        return config.at(rate_hz)
    except ValueError as error:
        raise UsageError(f"{table}: at {rate_hz:g} Hz: {error}.") from error
