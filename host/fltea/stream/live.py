"""The stage of the live fit: spectrum of each sensor's axes, and a record `fit` in samples' own time.

The sums go on for as long as the sensor is the same: a gap of any length, a restart of the board or of its
sensor, and the time between two runs (`--state`) break the spectrum's stretches and lose none of its sums.
Another device, scale, filter, rate or set of axes begins again. So `samples` of a fit may be of several
epochs, where the filters begin with each.

An axis takes milliseconds, for which all samples wait. So a fit is of the samples there are when it is due,
but one axis is fitted then, and the others a few samples later, one by one; the record goes out with the
last. Each device has turns of its own. Both are counted in samples: nothing depends on the clock.
"""

import itertools
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from fltea.records.block import Block
from fltea.records.events import Ints
from fltea.records.fit import AxisFit
from fltea.records.records import ACCEL_UNIT, GYRO_UNIT, Fit, Hello, Whiteness
from fltea.settings.config import Config
from fltea.spectrum.evidence import ANYTIME_LEVEL
from fltea.spectrum.live_axes import LiveAxes, Noise
from fltea.stream.fit_times import CURVES_S, Done, FitLoad, FitTimes, Turns, period_s, turns
from fltea.stream.stages import Beginning, Item, Moment, Saved, SavedFits, Stage, Standing

NO_VERDICT = ("too few samples",)
"""Kinds that say nothing of the noise."""
BREAK = 9
"""Lost samples that are not bridged: where nobody knows how many are missing, so many are counted."""


class SettledFit(NamedTuple):
    """The live fit that estimates of an axis go by; null_p to three digits, None before the first fit.

    A fit that is begun elsewhere, as that of a replay is, may differ in the last digits of its figures.
    stands: the newest whose verdict is stable, which is one that two settled fits in a row have agreed on.
    """

    null_p: float | None = None
    whiteness: Whiteness | None = None
    fit: AxisFit | None = None
    stands: AxisFit | None = None
    noise: Noise | None = None

    def followed_by(self, fit: AxisFit, noise: Noise | None) -> "SettledFit":
        """Return the next one."""
        agreed = self.fit is not None and self.fit.verdict == fit.verdict and fit.verdict not in NO_VERDICT
        stands = fit if agreed or (self.stands and self.stands.verdict == fit.verdict) else self.stands
        if fit.null_p is None:
            return SettledFit(fit=fit, stands=stands, noise=noise)
        p = float(f"{fit.null_p:.3g}")
        whiteness: Whiteness = "rejected" if p < ANYTIME_LEVEL else "not rejected"
        return SettledFit(p, whiteness, fit, stands, noise)


class _Sensor(NamedTuple):
    """Axes of one sensor, which are the columns `places` of a block's samples."""

    live: LiveAxes
    places: list[int]

    def add(self, values: NDArray[np.float64]) -> None:
        self.live.add(values if len(self.places) == values.shape[1] else values[:, self.places])


class _Begun(NamedTuple):
    """A fit that was due after the sample at `moment`, of which some axes may be left to do."""

    moment: Moment
    samples: int
    done: Done
    found: dict[str, AxisFit]
    left: Iterator[tuple[str, AxisFit]]


class LiveFits(Stage):
    """Fits the axes of both sensors, whoever estimates them; the next HELLO decides whether anything is kept.

    prompt: samples come at their own pace. load: what the fits of this program share. number: which of its
    devices this is, from 0.
    """

    def __init__(
        self, config: Config, *, prompt: bool = True, load: FitLoad | None = None, number: int = 0
    ) -> None:
        self._config = config
        self._load = load or FitLoad()
        self._period_s = period_s(config, self._load)
        self._rate_hz = 1.0
        self._prompt = prompt
        # Nobody waits at full speed, and what is found there is of the recording alone.
        self._number = number if prompt else 0
        self._turns = Turns(0, 0)
        self._begun: _Begun | None = None
        self._turn = 0
        self._sensors: dict[str, _Sensor] = {}
        self._of: tuple[object, ...] | None = None
        self._resumed = False
        self._times = FitTimes(1, 1, grows=False, every=False)
        self._first: int | None = None
        self._at: Moment | None = None
        self._settled: dict[str, SettledFit] = {}
        self._drawn_samples = 0

    def begin(self, beginning: Beginning) -> None:
        """Begin an epoch, with the sums of the one before or of what was saved if the sensor is the same."""
        if self._resumed:  # what was saved has been refused by another stage
            self._of, self._resumed = None, False
        hello, saved = beginning.hello, beginning.saved
        gyro, accel = beginning.axes(self._config.channels)
        identity = (_sensor_of(hello), tuple(gyro), tuple(accel))
        if saved is not None or identity != self._of:
            h, of_live = 1.0 / hello.rate_hz, self._config.live
            kept = (saved.fits if saved else None) or SavedFits(None, None)
            self._sensors, self._settled, self._begun = {}, {}, None
            for name, axes, unit, data in (
                ("gyro", gyro, GYRO_UNIT, kept.gyro),
                ("accel", accel, ACCEL_UNIT, kept.accel),
            ):
                if axes:
                    live = LiveAxes(tuple(axes), h, of_live, unit, data)
                    self._sensors[name] = _Sensor(live, list(axes.values()))
            self._of, self._resumed = identity, saved is not None
            self._rate_hz = hello.rate_hz
            grows, curves = self._config.live.period_s is None, round(CURVES_S * hello.rate_hz)
            period = self._pace()
            offset = self._turns.offset
            self._times = FitTimes(period, curves, grows=grows, every=self._prompt, offset=offset)
        else:
            self.bridge(beginning.missing)
        self._times.begin()
        self._first = self._at = None
        self._turn = 0  # the axes that are left of a fit go on from the first sample

    def bridge(self, count: int) -> None:
        """Break all stretches: at least so many samples are missing."""
        for sensor in self._sensors.values():
            sensor.live.skip(max(count, BREAK))

    def on_block(self, block: Block, host_ns: Ints, missing: int) -> Iterator[Item]:
        """Give the samples on, and a fit after those with which one is due."""
        if not self._sensors:
            yield block
            return
        self._resumed = False
        if missing:
            for sensor in self._sensors.values():
                sensor.live.skip(missing)
        if self._first is None:
            self._first = int(block.seq[0])
        begin, n = 0, len(block)
        while begin < n:
            number = int(block.seq[begin]) - self._first + 1
            due = self._times.due if self._begun is None else min(self._times.due, self._turn)
            end = min(n, begin + 1 + max(0, due - number))
            part = block if (begin, end) == (0, n) else block.rows(begin, end)
            self._take(part)
            yield part
            yield from self._after(number + end - begin - 1)
            begin = end

    def last(self) -> Iterator[Item]:
        """A fit of everything with its curves, at the end; none if that has just been published.

        Of a recording it is the one look that counts, so it finds what `fltea identify` finds.
        """
        yield from self._go_on()
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
        return Standing(fit_period_s=self._period_s if self._sensors else None)

    def save(self) -> Saved | None:
        """The sums of both sensors."""
        found = {name: sensor.live.save() for name, sensor in self._sensors.items()}
        return Saved(None, None, SavedFits(found.get("gyro"), found.get("accel"))) if found else None

    @property
    def _samples(self) -> int:
        return next(iter(self._sensors.values())).live.samples

    def _take(self, block: Block) -> None:
        for name, values in (("gyro", block.gyro_dps), ("accel", block.accel_ms2)):
            if name in self._sensors and values is not None:
                self._sensors[name].add(values)
        last = (int(column[-1]) for column in (block.seq, block.device_us, block.host_ns))
        seq, device_us, host_ns = last
        self._at = Moment(seq, block.epoch, device_us, host_ns)

    def _pace(self) -> int:
        """Take note of what this program's fits share now; the samples from fit to fit."""
        load = self._load
        self._period_s = period_s(self._config, load)
        period = max(1, round(self._period_s * self._rate_hz))
        axes = sum(len(sensor.places) for sensor in self._sensors.values())
        self._turns = turns(period, self._rate_hz, axes, load.devices, self._number % load.devices)
        return period

    def _after(self, number: int) -> Iterator[Item]:
        """What is to be done after sample `number` of the epoch."""
        yield from self._go_on(number)
        if number < self._times.due:
            return
        if self._period_s != period_s(self._config, self._load):
            self._times.pace(self._pace(), self._turns.offset, number)
            if number < self._times.due:
                return
        # One that settles waits for none of those between, which a replay does not make.
        if self._begun is None or self._times.settles(number):
            yield from self._go_on()
            self._begun, self._turn = self._begin_fit(number), number
            yield from self._go_on(number)

    def _begin_fit(self, number: int) -> _Begun:
        assert self._at is not None
        done = self._times.done(number, self._samples)
        # A fit that settles does not depend on those between.
        left = [s.live.one_by_one(curves=done.curves, fresh=done.settles) for s in self._sensors.values()]
        if done.curves:
            self._drawn_samples = self._samples
        return _Begun(self._at, self._samples, done, {}, itertools.chain(*left))

    def _go_on(self, number: int | None = None) -> Iterator[Item]:
        """Fit the axes whose turn has come after sample `number`; without it all that are left."""
        begun = self._begun
        if begun is None:
            return
        axes = sum(len(sensor.places) for sensor in self._sensors.values())
        while len(begun.found) < axes and (number is None or number >= self._turn):
            axis, fit = next(begun.left)
            begun.found[axis] = fit
            self._turn += self._turns.step
        if len(begun.found) == axes:
            self._begun = None
            if begun.done.settles:
                self._settle(begun.found)
            found = {axis: self._with_stability(axis, one) for axis, one in begun.found.items()}
            yield Fit(*begun.moment, begun.samples, found, device=self._config.name)

    def _settle(self, found: dict[str, AxisFit]) -> None:
        noises = {axis: one for s in self._sensors.values() for axis, one in s.live.noises.items()}
        before = self._settled
        self._settled = {
            axis: before.get(axis, NO_FIT).followed_by(fit, noises.get(axis)) for axis, fit in found.items()
        }

    def _with_stability(self, axis: str, fit: AxisFit) -> AxisFit:
        stands = self.settled(axis).stands
        return replace(fit, stable=stands is not None and stands.verdict == fit.verdict)


NO_FIT = SettledFit()


def settled_by(fits: LiveFits | None) -> Callable[[str], SettledFit]:
    """Return what gives the fit of an axis; no fit where nothing is fitted."""
    return (lambda axis: NO_FIT) if fits is None else fits.settled


def _sensor_of(hello: Hello) -> tuple[object, ...]:
    """What has to be the same for its noise to be the same."""
    scales = hello.gyro_lsb_per_dps, hello.gyro_range_dps, hello.accel_lsb_per_g
    return hello.device_id, hello.who_am_i, hello.sensor, *scales, hello.gyro_dlpf_hz, hello.rate_hz
