"""The stage of the live fit: spectrum of each sensor's axes, and a record `fit` in samples' own time.

The sums go on for as long as the sensor is the same: a gap of any length, a restart of the board or of its
sensor, and the time between two runs (`--state`) break the spectrum's stretches and lose none of its sums.
Another device, scale, filter, rate or set of axes begins again. So `samples` of a fit may be of several
epochs, where the filters begin with each.
"""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fltea.records.block import Block
from fltea.records.events import Event, Ints
from fltea.records.fit import AxisFit
from fltea.records.records import ACCEL_UNIT, GYRO_UNIT, Fit, Hello, Whiteness
from fltea.settings.config import Config
from fltea.spectrum.evidence import ANYTIME_LEVEL
from fltea.spectrum.live_axes import LiveAxes
from fltea.stream.fit_times import CURVES_S, FitTimes, period_s
from fltea.stream.stages import Beginning, Item, Saved, SavedFits, Standing

BREAK = 9
"""Lost samples that are not bridged: where nobody knows how many are missing, so many are counted."""


class Said(NamedTuple):
    """What estimates of an axis go by and say of its fit; null_p to three digits, None before the first fit.

    A fit that is begun elsewhere, as that of a replay is, may differ in the last digits of its figures.
    """

    null_p: float | None = None
    whiteness: Whiteness | None = None
    fit: AxisFit | None = None


class _Sensor(NamedTuple):
    """Axes of one sensor, which are the columns `places` of a block's samples."""

    live: LiveAxes
    places: list[int]

    def add(self, values: NDArray[np.float64]) -> None:
        self.live.add(values if len(self.places) == values.shape[1] else values[:, self.places])


class _Place(NamedTuple):
    """Of a sample."""

    seq: int
    epoch: int
    device_us: int
    host_ns: int


class LiveFits:
    """Fits the axes of both sensors, whoever estimates them.

    prompt: samples come at their own pace. devices: how many run in this program.
    """

    def __init__(self, config: Config, *, prompt: bool = True, devices: int = 1) -> None:
        self._config = config
        self._period_s = period_s(config, devices)
        self._prompt = prompt
        self._sensors: dict[str, _Sensor] = {}
        self._of: tuple[object, ...] | None = None
        self._resumed = False
        self._times = FitTimes(1, 1, grows=False, every=False)
        self._first: int | None = None
        self._at: _Place | None = None
        self._settled: dict[str, Said] = {}
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
            self._sensors, self._settled = {}, {}
            for name, axes, unit, data in (
                ("gyro", gyro, GYRO_UNIT, kept.gyro),
                ("accel", accel, ACCEL_UNIT, kept.accel),
            ):
                if axes:
                    live = LiveAxes(tuple(axes), h, of_live, unit, data)
                    self._sensors[name] = _Sensor(live, list(axes.values()))
            self._of, self._resumed = identity, saved is not None
            period = max(1, round(self._period_s * hello.rate_hz))
            grows, curves = self._config.live.period_s is None, round(CURVES_S * hello.rate_hz)
            self._times = FitTimes(period, curves, grows=grows, every=self._prompt)
        else:
            self.bridge(beginning.missing)
        self._times.begin()
        self._first = self._at = None

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
            end = min(n, begin + 1 + max(0, self._times.due - number))
            part = block if (begin, end) == (0, n) else block.rows(begin, end)
            self._take(part)
            yield part
            number += end - begin - 1
            if number >= self._times.due:
                done = self._times.done(number, self._samples)
                # A fit that settles does not depend on those between, which a replay does not make.
                fit = self._fit(curves=done.curves, fresh=done.settles)
                if done.settles:
                    self._settled = {axis: _said_of(one) for axis, one in fit.axes.items()}
                yield fit
            begin = end

    def on_event(self, event: Event) -> Iterator[Item]:
        """Nothing else matters here."""
        return iter(())

    def forget(self) -> None:
        """What the next epoch is of says whether anything is kept."""

    def last(self) -> Iterator[Item]:
        """A fit of everything with its curves, at the end; none if that has just been published.

        Of a recording it is the one look that counts, so it says what `fltea identify` says.
        """
        if self._at is not None and (not self._prompt or self._samples != self._drawn_samples):
            fit = self._fit(curves=True, last=not self._prompt)
            self._at = None
            yield fit

    def said(self, axis: str) -> Said:
        """What the next estimates of an axis say of its noise."""
        return self._settled.get(axis, NOTHING)

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
        self._at = _Place(seq, block.epoch, device_us, host_ns)

    def _fit(self, *, curves: bool, last: bool = False, fresh: bool = False) -> Fit:
        """The fit after the sample that was taken last."""
        assert self._at is not None
        found: dict[str, AxisFit] = {}
        for sensor in self._sensors.values():
            found |= sensor.live.fit(curves=curves, last=last, fresh=fresh)
        if curves:
            self._drawn_samples = self._samples
        return Fit(*self._at, self._samples, found, device=self._config.name)


NOTHING = Said()


def _said_of(fit: AxisFit) -> Said:
    if fit.null_p is None:
        return Said(fit=fit)
    p = float(f"{fit.null_p:.3g}")
    return Said(p, "rejected" if p < ANYTIME_LEVEL else "not rejected", fit)


def said_by(fits: LiveFits | None) -> Callable[[str], Said]:
    """What is said of each axis; nothing where nothing is fitted."""
    return (lambda axis: NOTHING) if fits is None else fits.said


def _sensor_of(hello: Hello) -> tuple[object, ...]:
    """What has to be the same for its noise to be the same."""
    scales = hello.gyro_lsb_per_dps, hello.gyro_range_dps, hello.accel_lsb_per_g
    return hello.device_id, hello.who_am_i, hello.sensor, *scales, hello.gyro_dlpf_hz, hello.rate_hz
