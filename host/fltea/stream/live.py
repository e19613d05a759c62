"""The stage of the live fit: spectrum of each sensor's axes, and a record `fit` in samples' own time.

The sums go on for as long as the sensor is the same: a gap of any length, a restart of the board or of its
sensor, and the time between two runs (`--state`) break the spectrum's stretches and lose none of its sums.
Another device, scale, filter, rate or set of axes begins again. So `samples` of a fit may be of several
epochs, where the filters begin with each.

A look takes milliseconds, for which no sample waits: it takes a copy of the sums, is made beside the walk,
and counts from a sample on that is fixed when it begins. Only if it is late the walk waits for it, there. So
nothing depends on how fast anybody is.

What a sensor that moves says is no noise. So the tracker takes the samples up to where a look begins or
counts before the sums do, and these leave out what it calls motion.
"""

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, NamedTuple, Protocol

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from fltea.records.block import Block, Tracked, with_tracked
from fltea.records.events import Ints
from fltea.records.fit import AxisFit
from fltea.records.records import ACCEL_UNIT, GYRO_UNIT, Fit, Hello, Whiteness
from fltea.settings.config import Config
from fltea.spectrum.evidence import ANYTIME_LEVEL
from fltea.spectrum.live_axes import LiveAxes, Looked
from fltea.stream.beside import Beside
from fltea.stream.fit_times import Look, LookTimes, period_s, turn
from fltea.stream.learning import Learned, Learner
from fltea.stream.stages import NEVER, Beginning, Item, Moment, Saved, Stage, Standing

NO_VERDICT = ("too few samples",)
"""Kinds that say nothing of the noise."""
BREAK = 9
"""Lost samples that are not bridged: where nobody knows how many are missing, so many are counted."""


class SettledFit(NamedTuple):
    """The live fit that estimates of an axis go by; null_p to three digits, None before the first fit.

    Another kind of processor may differ in the last digits of its figures.
    stands: the newest whose verdict is stable, which is one that two settled fits in a row have agreed on.
    learned: what the tracker goes by.
    """

    null_p: float | None = None
    whiteness: Whiteness | None = None
    fit: AxisFit | None = None
    stands: AxisFit | None = None
    learned: Learned | None = None

    def followed_by(self, looked: Looked, learner: Learner) -> "SettledFit":
        """Return the next one."""
        fit, learned = looked.fit, learner.learned(looked.noise, self.learned)
        agreed = self.fit is not None and self.fit.verdict == fit.verdict and fit.verdict not in NO_VERDICT
        stands = fit if agreed or (self.stands and self.stands.verdict == fit.verdict) else self.stands
        if fit.null_p is None:
            return SettledFit(fit=fit, stands=stands, learned=learned)
        p = float(f"{fit.null_p:.3g}")
        whiteness: Whiteness = "rejected" if p < ANYTIME_LEVEL else "not rejected"
        return SettledFit(p, whiteness, fit, stands, learned)


class TrackedPart(Protocol):
    """What is known of a part of a block; left_out: by unit, samples that are no noise, (n, axes)."""

    @property
    def tracked(self) -> Tracked:
        """Biases after each sample."""

    @property
    def left_out(self) -> dict[str, NDArray[np.bool_]]:
        """Samples that sums of the noise leave out."""


class Tracks(Protocol):
    """Who takes the samples of a walk."""

    def track(self, block: Block) -> TrackedPart:
        """Take a part of a block, by the fits that count by now."""

    def learner(self, axis: str) -> Learner:
        """Return what is to learn from the samples of an axis until now."""


class _Sensor(NamedTuple):
    """Axes of one sensor, which are the columns `places` of a block's samples."""

    live: LiveAxes
    places: list[int]

    def add(self, values: NDArray[np.float64], moving: NDArray[np.bool_]) -> None:
        self.live.add(values if len(self.places) == values.shape[1] else values[:, self.places], moving)


class _Begun(NamedTuple):
    """A look that began after the sample at `moment`, and does not count yet."""

    moment: Moment
    samples: int
    look: Look
    looks: dict[str, Callable[[], tuple[AxisFit, SettledFit]]]
    """Of each axis what gives the fit, and what is settled from then on."""


class LiveFits(Stage):
    """Fits the axes of both sensors, whoever estimates them; the next HELLO decides whether anything is kept.

    prompt: samples come at their own pace. watched: somebody takes the fits, so that there are also those by
    which no estimate goes. beside: what looks of this program share. number: which of its devices this is.
    """

    def __init__(
        self,
        config: Config,
        *,
        prompt: bool = True,
        watched: bool = True,
        beside: Beside | None = None,
        number: int = 0,
    ) -> None:
        self._config, self._number, self._turn = config, number, 0
        self._beside = beside or Beside()
        self._prompt, self._watched = prompt, watched
        self._rate_hz = 1.0
        self._begun: _Begun | None = None
        self._sensors: dict[str, _Sensor] = {}
        self._of: tuple[object, ...] | None = None
        self._resumed = False
        self._times = LookTimes(1.0, grows=False, every=False)
        self._noticed = 0
        self._first: int | None = None
        self._at: Moment | None = None
        self._settled: dict[str, SettledFit] = {}
        self._drawn_samples = 0

    def begin(self, beginning: Beginning) -> None:
        """Begin an epoch, with the sums of the one before or of what was saved if the sensor is the same."""
        if self._resumed:  # what was saved has been refused by another stage
            self._of, self._resumed = None, False
        hello, saved = beginning.hello, beginning.saved or Saved()
        gyro, accel = beginning.axes(self._config.channels)
        identity = (_sensor_of(hello), tuple(gyro), tuple(accel))
        if beginning.saved is not None or identity != self._of:
            h, of_live = 1.0 / hello.rate_hz, self._config.live
            self._sensors, self._settled, self._begun = {}, {}, None
            for name, axes, unit, data in (
                ("gyro", gyro, GYRO_UNIT, saved.gyro_fit),
                ("accel", accel, ACCEL_UNIT, saved.accel_fit),
            ):
                if axes:
                    live = LiveAxes(tuple(axes), h, of_live, unit, data)
                    self._sensors[name] = _Sensor(live, list(axes.values()))
            self._of, self._resumed = identity, beginning.saved is not None
            self._rate_hz = hello.rate_hz
            grows = self._config.live.period_s is None
            self._times = LookTimes(hello.rate_hz, grows=grows, every=self._watched)
            self._noticed = self._notices()
        else:
            self.bridge(beginning.missing)
        period = self._period()
        self._times.begin(period)
        self._turn = turn(self._beside, self._number, period)
        self._first = self._at = None
        if self._begun is not None:  # it counts from the first sample on
            self._begun = self._begun._replace(look=self._begun.look._replace(counts=1))

    def bridge(self, count: int) -> None:
        """Break all stretches: at least so many samples are missing."""
        for sensor in self._sensors.values():
            sensor.live.skip(max(count, BREAK))

    def on_block(self, block: Block, host_ns: Ints, missing: int) -> Iterator[Item]:
        """Give the samples on: they come through `walk`."""
        yield block

    def walk(self, block: Block, missing: int, tracks: Tracks) -> Iterator[Item]:
        """Give the samples on, tracked, and a fit after those with which one is due."""
        if not self._sensors:
            yield block
            return
        self._resumed = False
        if missing:
            for sensor in self._sensors.values():
                sensor.live.skip(missing)
        if self._first is None:
            self._first = int(block.seq[0]) + self._turn
        given = taken = 0
        n = len(block)
        tracked: list[Tracked] = []
        while taken < n:
            number = int(block.seq[taken]) - self._first + 1
            stop = min(self._times.check, self._begun.look.counts) if self._begun else self._times.check
            end = min(n, taken + 1 + max(0, stop - number))
            part = _rows(block, taken, end)
            found = tracks.track(part)
            tracked.append(found.tracked)
            self._take(part, found.left_out)
            number += end - taken - 1
            taken = end
            if self._begun is not None and number >= self._begun.look.counts:
                yield with_tracked(_rows(block, given, end), tracked)
                given, tracked = end, []
                yield self._counted(self._begun)
            self._look(number, tracks)
        if given < n:
            yield with_tracked(_rows(block, given, n), tracked)

    @property
    def stop(self) -> int:
        """The number of the next sample that has to come through `walk`: with which a look counts."""
        if self._first is None or self._resumed:
            return 0
        return NEVER if self._begun is None else self._first - 1 + self._begun.look.counts

    @property
    def check(self) -> int:
        """The number of the next sample behind which a look may begin, so `went_on` has to be called."""
        return 0 if self._first is None else self._first - 1 + self._times.check

    def live(self, name: str) -> LiveAxes:
        """Return the sums of a sensor."""
        return self._sensors[name].live

    def went_on(self, moment: Moment, tracks: Tracks) -> None:
        """Take note of samples before `stop`, up to this one, which its sums and the tracks have taken."""
        self._at = moment
        assert self._first is not None
        self._look(moment.seq - self._first + 1, tracks)

    def last(self) -> Iterator[Item]:
        """A fit of everything with its curves, at the end; none if that has just been published.

        Of a recording it is the one look that counts, so it finds what `fltea identify` finds.
        """
        if self._begun is not None:
            yield self._counted(self._begun)
        if self._at is not None and (not self._prompt or self._samples != self._drawn_samples):
            found: dict[str, AxisFit] = {}
            for sensor in self._sensors.values():
                found |= sensor.live.fit(curves=True, last=not self._prompt)
            if self._prompt:
                found = {axis: self._with_stability(axis, one) for axis, one in found.items()}
            else:
                found = {axis: replace(one, stable=True) for axis, one in found.items()}
            fit = Fit(*self._at, self._samples, found, device=self._config.name)
            self._at = None
            yield fit

    def settled(self, axis: str) -> SettledFit:
        """Return the fit that the next estimates of an axis go by."""
        return self._settled.get(axis, NO_FIT)

    def standing(self) -> Standing:
        """How often it fits."""
        return Standing(fit_period_s=period_s(self._config, self._beside) if self._sensors else None)

    def save(self) -> dict[str, Any]:
        """The sums of both sensors."""
        return {f"{name}_fit": sensor.live.save() for name, sensor in self._sensors.items()}

    @property
    def _samples(self) -> int:
        return next(iter(self._sensors.values())).live.samples

    def _take(self, block: Block, left_out: dict[str, NDArray[np.bool_]]) -> None:
        for name, unit, values in (
            ("gyro", GYRO_UNIT, block.gyro_dps),
            ("accel", ACCEL_UNIT, block.accel_ms2),
        ):
            if name in self._sensors and values is not None:
                self._sensors[name].add(values, left_out[unit])
        last = (int(column[-1]) for column in (block.seq, block.device_us, block.host_ns))
        seq, device_us, host_ns = last
        self._at = Moment(seq, block.epoch, device_us, host_ns)

    def _period(self) -> int:
        """The samples from look to look at least."""
        return max(1, round(period_s(self._config, self._beside) * self._rate_hz))

    def _notices(self) -> int:
        return sum(sensor.live.noticed for sensor in self._sensors.values())

    def _look(self, number: int, tracks: Tracks) -> None:
        """Begin a look after sample `number` of the epoch if one is due."""
        if number < self._times.check:
            return
        assert self._at is not None
        noticed, samples = self._notices(), self._samples
        busy, news = self._begun is not None, noticed != self._noticed
        look = self._times.at(number, samples, self._period(), noticed=news, busy=busy)
        if look is None:
            return
        self._noticed = noticed
        looks = {
            axis: self._beside.begin(
                partial(_looked, make, self.settled(axis), tracks.learner(axis) if look.settles else None)
            )
            for sensor in self._sensors.values()
            for axis, make in sensor.live.look(curves=look.curves, fresh=look.fresh).items()
        }
        self._begun = _Begun(self._at, samples, look, looks)
        if look.curves:
            self._drawn_samples = samples

    def _counted(self, begun: _Begun) -> Fit:
        """From here on a look counts."""
        self._begun = None
        # The last first: whoever makes them has begun with the others.
        looked = {axis: begun.looks[axis]() for axis in reversed(begun.looks)}
        self._settled = {axis: settled for axis, (_, settled) in looked.items()}
        found = {axis: self._with_stability(axis, looked[axis][0]) for axis in begun.looks}
        return Fit(*begun.moment, begun.samples, found, device=self._config.name)

    def _with_stability(self, axis: str, fit: AxisFit) -> AxisFit:
        stands = self.settled(axis).stands
        return replace(fit, stable=stands is not None and stands.verdict == fit.verdict)


NO_FIT = SettledFit()


def _looked(
    make: Callable[[], Looked], settled: SettledFit, learner: Learner | None
) -> tuple[AxisFit, SettledFit]:
    looked = make()
    return looked.fit, settled if learner is None else settled.followed_by(looked, learner)


def _rows(block: Block, begin: int, end: int) -> Block:
    return block if (begin, end) == (0, len(block)) else block.rows(begin, end)


def settled_by(fits: LiveFits | None) -> Callable[[str], SettledFit]:
    """Return what gives the fit of an axis; no fit where nothing is fitted."""
    return (lambda axis: NO_FIT) if fits is None else fits.settled


def _sensor_of(hello: Hello) -> tuple[object, ...]:
    """What has to be the same for its noise to be the same."""
    scales = hello.gyro_lsb_per_dps, hello.gyro_range_dps, hello.accel_lsb_per_g
    return hello.device_id, hello.who_am_i, hello.sensor, *scales, hello.gyro_dlpf_hz, hello.rate_hz
