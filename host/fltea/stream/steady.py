"""Samples with which nothing happens but themselves: all that is done with them, in one native call.

Nearly all that a live device says is one sample or two that follow on: no gap, no statistics that are due, no
look that counts. One stage after another costs them five times what their estimates do, and more where the
processor has slept: nothing of it is in its caches then. What comes out is the same, to the bit, as by the
stages, which take all else (tests/stream/test_steady.py).
"""

from typing import NamedTuple

from fltea import _native
from fltea.estimator.tracker import TrackerEvent, events_of
from fltea.records.block import COLUMNS, AxisColumns, Block, TrackedColumns
from fltea.records.events import RawBlock
from fltea.records.records import GYRO_UNIT
from fltea.stream.decode import Decoder
from fltea.stream.happenings import Happened
from fltea.stream.host import Channels, HostEstimates, Loss
from fltea.stream.live import LiveFits
from fltea.stream.place import FollowRule, Newest, Place
from fltea.stream.stages import NEVER, Moment
from fltea.stream.time import OpenSecond, Timebase
from fltea.stream.tracking import SensorTracks, Tracking
from fltea.wire.sample_scaling import Scales


class Taken(NamedTuple):
    """What came of samples: of those in the block.

    newest: the last. lost: which axes became invalid. happened: steps of the bias, and motion.
    """

    block: Block
    newest: Newest
    lost: list[Loss]
    happened: list[Happened]


class _Sensor(NamedTuple):
    """The parts of the stages that are one sensor's; channels: None where nothing estimates it."""

    tracks: SensorTracks
    channels: Channels | None


class Steady:
    """Takes samples of the epoch that goes on. block: of the samples before them, as the stages gave it."""

    def __init__(
        self,
        native: _native.Steady,
        sensors: list[_Sensor],
        place: Place,
        timebase: Timebase,
        fits: LiveFits | None,
        tracking: Tracking,
        block: Block,
    ) -> None:
        self._native, self._sensors, self._block = native, sensors, block
        self._place, self._timebase, self._fits, self._hello = place, timebase, fits, place.hello
        self._tracking, self._filled = tracking, NEVER
        for _, channels in sensors:
            if channels is not None and channels.startup_remaining and place.newest is not None:
                self._filled = min(self._filled, place.newest.seq + channels.startup_remaining)

    @property
    def _stop(self) -> int:
        """The number of the next sample that may not come; a look begins behind the one before it."""
        fits = self._fits
        return self._filled if fits is None else min(self._filled, fits.stop, fits.check + 1)

    @classmethod
    def after(
        cls, block: Block, decoder: Decoder, tracking: Tracking, fits: LiveFits | None, host: HostEstimates
    ) -> "Steady | None":
        """Return what takes the samples after a block; None where more is to be done with them."""
        place, timebase = decoder.place, decoder.timebase
        line = None if timebase is None else timebase.line
        if timebase is None or line is None or place.hello is None or not tracking.is_steady:
            return None
        sensors: list[_Sensor] = []
        parts: list[_native.SteadySensor] = []
        for name, tracks in tracking.sensors.items():
            channels, sums = host.sensors.get(name), None if fits is None else fits.live(name)
            if channels is not None and not channels.is_steady:
                return None
            sensors.append(_Sensor(tracks, channels))
            part = name == "accel", tracks.places, tracks.tracker.native
            of_sums = (None, 0) if sums is None else (sums.octaves.native, sums.longest_motion)
            of_bank = (None, []) if channels is None else (channels.bank.native, channels.waiting)
            parts.append((*part, *of_sums, *of_bank))
        rule, scales = FollowRule.at(place.hello.rate_hz), Scales.of(place.hello)
        return cls(_native.Steady(rule, scales, line, parts), sensors, place, timebase, fits, tracking, block)

    def take(self, raw: RawBlock, until_ns: int) -> Taken | None:
        """Take samples that arrived before until_ns, up to one with which more is to be done.

        None, and nothing has changed, if that is the first.
        """
        newest, hello = self._place.newest, self._place.hello
        if newest is None or hello is None or self._hello is None:
            return None
        if hello is not self._hello:  # as a device says once a second
            if hello.rate_hz != self._hello.rate_hz or Scales.of(hello) != Scales.of(self._hello):
                return None
            self._hello = hello
        timebase, stop = self._timebase, self._stop
        found = self._native.run(raw, newest, stop, until_ns, *timebase.second)
        if isinstance(found, int):
            timebase.begin_second(found)
            assert timebase.line is not None
            self._native.time_by(timebase.line)
            found = self._native.run(raw, newest, stop, until_ns, *timebase.second)
        if found is None:
            return None
        columns, of_sensors, last, second = found
        newest, n = Newest._make(last), len(columns[0])
        self._place.go_on(n, newest)
        timebase.go_on(OpenSecond._make(second), newest.seq, newest.epoch_us)
        tracked: list[TrackedColumns] = []
        estimates: list[AxisColumns] = []
        lost: list[Loss] = []
        events: list[list[TrackerEvent]] = []
        for (tracks, channels), (of_tracks, of_bank, losses, told) in zip(
            self._sensors, of_sensors, strict=True
        ):
            events.append(events_of(told) if told else [])
            tracked.append(tracks.columns(of_tracks))
            if channels is None:
                continue
            if channels.startup_remaining:
                channels.filled(n)
            else:
                estimates.append(channels.columns(*of_bank))
                lost += channels.losses(losses)
        flags = None if raw.flags is None else raw.flags[:n]
        fields = dict(zip(COLUMNS, (*columns, flags), strict=True))
        block = self._block.but(**fields, estimates=tuple(estimates), tracked=tuple(tracked))
        happened: list[Happened] = []
        for (tracks, _), one in zip(self._sensors, events, strict=True):
            if one:
                name = "gyro" if tracks.unit == GYRO_UNIT else "accel"
                happened += self._tracking.records_of(name, one, block)
        if self._fits is not None:
            self._fits.went_on(Moment(newest.seq, block.epoch, newest.epoch_us, second[0]), self._tracking)
        return Taken(block, newest, lost, happened)
