"""The sensors of a device in one epoch.

Each sensor has bias trackers, sums of spectra to which noise models are fitted, and FLTEA's filters.
"""

from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple

from fltea.estimator.lanes import Reason
from fltea.estimator.tracker import events_of
from fltea.records.block import Block
from fltea.records.errors import UsageError
from fltea.records.records import Motion, Step
from fltea.records.sensor_kind import ACCELEROMETER, GYROSCOPE, SensorKind
from fltea.settings.config import Config
from fltea.settings.estimator import EstimatorConfig
from fltea.spectrum.live_axes import LiveAxes
from fltea.stream.channels import Channels
from fltea.stream.decode import OfSensors
from fltea.stream.epoch import SAVED_FIELDS, Beginning, Moment, Saved, Standing
from fltea.stream.happenings import record_of
from fltea.stream.live import LiveFits
from fltea.stream.tracking import SensorTracks


class Sensor(NamedTuple):
    """One sensor of a device.

    `tracks`: the trackers of the biases of its axes. `sums`: sums of its spectra, to which noise models are
    fitted; None if nothing is fitted. `channels`: FLTEA's filters; None if they do not run.
    """

    kind: SensorKind
    tracks: SensorTracks
    sums: LiveAxes | None
    channels: Channels | None

    def native(self) -> tuple[Any, ...]:
        """Return this sensor in the form that `_native.Device.begin` expects."""
        sums, channels = self.sums, self.channels
        of_sums = (None, 0) if sums is None else (sums.octaves.native, sums.longest_motion)
        of_bank: tuple[Any, int, list[bool]] = (None, 0, [False] * len(self.tracks.names))
        if channels is not None:
            of_bank = channels.bank.native, channels.bank.startup_remaining, channels.waiting
        return self.kind is ACCELEROMETER, self.tracks.places, self.tracks.tracker.native, *of_sums, *of_bank

    def use_model(self, fits: LiveFits | None) -> None:
        """Use the accepted fits from the next sample on."""
        if fits is None:
            return
        accepted = [fits.accepted(axis) for axis in self.tracks.names]
        for axis, fit in zip(self.tracks.names, accepted, strict=True):
            self.tracks.use_model(axis, fit)
        if self.channels is not None:
            self.channels.use_model(accepted)

    def bridge(self, count: int) -> None:
        """Let the estimators predict `count` samples that came while the program did not run."""
        self.tracks.skip(count)
        if self.channels is not None:
            self.channels.bridge(count)


class Sensors:
    """The sensors of a device, gyroscope and accelerometer, in the present epoch.

    `settings`: function that returns the settings of the gyroscope's filters, or None if only the board runs
    such filters. It is called when an epoch begins. `fits`: the live fits; None if nothing is fitted.
    """

    def __init__(
        self, config: Config, settings: Callable[[], EstimatorConfig | None], fits: LiveFits | None
    ) -> None:
        self._config, self._settings, self._fits = config, settings, fits
        self._all: list[Sensor] = []

    def begin(self, beginning: Beginning) -> list[tuple[Any, ...]]:
        """Begin an epoch, from the saved state if there is one.

        Return the sensors in the form that `_native.Device.begin` expects.

        Raises:
            ValueError: the settings or the snapshot cannot be used. In this case the sensors are unchanged.
            UsageError: a time in the settings corresponds, at the device's sampling rate, to more samples
            than allowed.
        """
        config, hello, saved = self._config, beginning.hello, beginning.saved or Saved()
        h = 1 / hello.rate_hz
        filters: dict[SensorKind, Channels] = {}
        tracks: dict[SensorKind, SensorTracks] = {}
        for kind, axes in beginning.axes(config.channels).items():
            estimator: EstimatorConfig = getattr(config, kind.settings)
            # if there are no settings, only the board filters the gyroscope's samples
            here = self._settings() if kind is GYROSCOPE else estimator
            if here is not None:
                settings = _at(here, kind.settings, hello.rate_hz)
                resolution = kind.resolution(hello)
                filters[kind] = Channels(axes, settings, h, resolution, kind.unit, saved.of(kind).filters)
            tracks[kind] = SensorTracks(axes, estimator, config.live, h, kind.unit)
            if (data := saved.of(kind).tracks) is not None:
                tracks[kind].load(data)
        sums = {} if self._fits is None else self._fits.begin(beginning)
        self._all = [
            Sensor(kind, track, sums.get(kind.name), filters.get(kind)) for kind, track in tracks.items()
        ]
        for sensor in self._all:
            sensor.use_model(self._fits)
        return [sensor.native() for sensor in self._all]

    def go_by_fits(self, device: Any) -> None:
        """Use the accepted fits from the next sample on. `device`: the native device."""
        for number, sensor in enumerate(self._all):
            sensor.use_model(self._fits)
            if sensor.channels is not None:
                device.set_waits(number, sensor.channels.waiting)

    def fill(self, device: Any) -> Iterator[Channels]:
        """Start the filters of each sensor whose start-up window has become full, and yield these filters."""
        for number, sensor in enumerate(self._all):
            channels = sensor.channels
            if channels is not None and channels.bank.startup_remaining and not device.window_left(number):
                channels.fill()
                device.set_waits(number, channels.waiting)
                yield channels

    def bridge(self, count: int) -> None:
        """Let the estimators predict `count` samples that came while the program did not run."""
        if self._fits is not None:
            self._fits.bridge(count)
        for sensor in self._all:
            sensor.bridge(count)

    def block(self, block: Block, of_sensors: OfSensors) -> Block:
        """Return the samples `block` together with the results of the trackers and filters."""
        tracked, estimates, variant = [], [], ""
        for sensor, found in zip(self._all, of_sensors, strict=True):
            if found is None:
                continue
            of_tracker, of_bank = found
            tracked.append(sensor.tracks.columns(of_tracker))
            if of_bank is not None and sensor.channels is not None:
                estimates.append(sensor.channels.columns(of_bank))
                variant = variant or sensor.channels.config.variant
        return block.but(tracked=tuple(tracked), estimates=tuple(estimates), variant=variant)

    def lost(self, number: int, losses: Iterable[tuple[int, int, Reason]]) -> list[tuple[str, Reason]]:
        """Return the names of a sensor's axes that became invalid, and why."""
        channels = self._all[number].channels
        return [] if channels is None else channels.losses(losses)

    def happened(self, number: int, event: Any, moment: Moment) -> Step | Motion:
        """Return the record of a step of a bias or of motion, noticed at the sample `moment`.

        `event`: the event as the native tracker reports it, which `events_of` converts.
        """
        tracks = self._all[number].tracks
        (found,) = events_of([event])
        return record_of(found, moment, tracks.names, tracks.unit, tracks.h, self._config.name)

    @property
    def words(self) -> object:
        """Values that are the same in the records of all samples until the next fit, such as the verdicts."""
        return [
            (sensor.tracks.words, None if sensor.channels is None else sensor.channels.words)
            for sensor in self._all
        ]

    def tracks(self, axis: str) -> SensorTracks:
        """Return the trackers of the sensor to which the axis belongs."""
        return next(sensor.tracks for sensor in self._all if axis in sensor.tracks.names)

    def standing(self, device: Any) -> Standing:
        """Return the present state of all estimators, to be published. `device`: the native device."""
        standing = Standing(fit_period_s=self._fits.period_s() if self._fits is not None else None)
        for number, sensor in enumerate(self._all):
            standing.tracker |= dict(sensor.tracks.stats())
            if sensor.channels is None:
                continue
            left = device.window_left(number)
            standing.startup_remaining = max(standing.startup_remaining, left)
            standing.axes |= dict(sensor.channels.stats())
            standing.filters[sensor.kind] = sensor.channels.info
        return standing

    def save(self) -> dict[str, Any]:
        """Return the estimators' state for a later run, as fields of `Saved`.

        The result is empty while a start-up window is not full.
        """
        saved: dict[str, Any] = {}
        for sensor in self._all:
            channels, sums = sensor.channels, sensor.sums
            filters = None if channels is None else channels.save()
            if channels is not None and filters is None:
                return {}
            parts = filters, None if sums is None else sums.save(), sensor.tracks.save()
            fields = (field.format(sensor.kind.name) for field in SAVED_FIELDS)
            saved |= {field: part for field, part in zip(fields, parts, strict=True) if part is not None}
        return saved if any(sensor.channels is not None for sensor in self._all) else {}


def _at(config: EstimatorConfig, table: str, rate_hz: float) -> EstimatorConfig:
    """Return the settings of the filters with all times converted to numbers of samples.

    Raises:
        UsageError: a time in the settings corresponds to more samples than allowed.
    """
    try:
        return config.at(rate_hz)
    except ValueError as error:
        raise UsageError(f"{table}: at {rate_hz:g} Hz: {error}.") from error
