"""The stage in which this computer estimates: the axes of both sensors, each sensor's in a bank."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cached_property
from typing import Any

import numpy as np

from fltea.estimator.bank import Bank
from fltea.estimator.lanes import Reason
from fltea.estimator.snapshot import OnlineState
from fltea.records.arrays import Array
from fltea.records.block import AxisColumns, Block, Bools
from fltea.records.errors import UsageError
from fltea.records.events import Ints
from fltea.records.records import ACCEL_AXES, ACCEL_UNIT, GYRO_UNIT, EstimatorInfo
from fltea.records.repeat import OnceAMinute
from fltea.records.stats import AxisStats
from fltea.settings.config import Config
from fltea.settings.estimator import EstimatorConfig
from fltea.spectrum.innovation_whiteness import describes_order
from fltea.stream.live import LiveFits, SettledFit, settled_by
from fltea.stream.stages import Beginning, Item, Notice, Saved, Stage, Standing
from fltea.stream.tuning import HandedOver, handed_over
from fltea.wire.sample_scaling import accel_resolution_ms2, resolution_dps

LONGEST_BRIDGE = 30_000
"""Missing samples that an estimator of unlimited memory predicts: half a second's work."""


Loss = tuple[int, str, Reason]
"""The row with which an axis became invalid, its name, and why."""


class Channels:
    """Estimates axes in the sensor's unit. axes: names, and the columns of each block that they are.

    h: sampling period in s. resolution: one LSB in the sensor's unit, None where unknown.
    settled: what the live fit found of each axis. state: what `save` returned, to go on from there.

    Raises:
        ValueError: settings that no filter can work with, or a state that does not fit them.
    """

    def __init__(
        self,
        axes: Mapping[str, int],
        config: EstimatorConfig,
        h: float,
        resolution: float | None,
        unit: str,
        settled: Callable[[str], SettledFit],
        state: OnlineState | None = None,
    ) -> None:
        self.config, self._settled = config, settled
        self._tuned = config.tuned_by == "live"
        self._names, self._places, self._unit = tuple(axes), list(axes.values()), unit
        self._fits: list[SettledFit] = []
        self._said: tuple[Any, ...] = ()
        self._known: dict[str, SettledFit] = {}
        self.bank = Bank(self._names, config, h, resolution, state)

    @property
    def startup_remaining(self) -> int:
        """Samples until the start-up window is full."""
        return self.bank.startup_remaining

    def run(self, values: Array) -> tuple[AxisColumns | None, list[Loss]]:
        """Take samples (n, axes of the sensor); no more than `startup_remaining` while the window fills.

        Returns the columns, None while the window fills, and which axes became invalid.
        """
        self._tune()
        own = values if len(self._places) == values.shape[1] else values[:, self._places]
        fills = self.startup_remaining > 0
        found = self.bank.run(own)
        if fills:
            return None, []
        assert found.white is not None
        columns = self.columns(*found[:6], found.valid, found.white & ~np.array(self.waiting))
        return columns, self.losses(found.lost)

    def columns(self, *found: Array | Bools) -> AxisColumns:
        """Return what the bank has found of samples as columns."""
        fits = [self._settled(axis) for axis in self._names]
        if self._fits != fits:
            self._fits = fits
            self._said = tuple(one.null_p for one in fits), tuple(one.whiteness for one in fits)
        return AxisColumns._make((self._names, self._unit, *self._said, *found))

    def losses(self, lost: Iterable[tuple[int, int, Reason]]) -> list[Loss]:
        """Return which axes became invalid, by name."""
        return [(row, self._names[lane], why) for row, lane, why in lost]

    @property
    def waiting(self) -> list[bool]:
        """Which axes wait for a fit to tune them."""
        return [self._tuned and axis not in self.bank.tuned for axis in self._names]

    @property
    def is_steady(self) -> bool:
        """Whether nothing is to be done but to take samples: no fit is news for the filters."""
        known = not self._tuned or all(self._settled(axis) is self._known.get(axis) for axis in self._names)
        return known or self.startup_remaining > 0

    def filled(self, count: int) -> None:
        """Take note of samples of the start-up window, which the bank has taken."""
        self.bank.startup_remaining -= count

    def _tune(self) -> None:
        """Hand what the fit knows of the noise to the filters."""
        if not self._tuned or self.startup_remaining:
            return
        new: dict[str, HandedOver] = {}
        for axis in self._names:
            settled = self._settled(axis)
            if settled is self._known.get(axis):
                continue
            self._known[axis] = settled
            if settled.fit is None or settled.whiteness != "rejected" or self._is_constant(axis):
                continue
            before = self.bank.variances[axis] if axis in self.bank.tuned else None
            handed = handed_over(settled.fit, before)
            if handed is not None:
                new[axis] = handed
        if new:
            self.bank.retune(
                {axis: one.variances for axis, one in new.items()},
                {axis: one.belief for axis, one in new.items()},
            )

    def _is_constant(self, axis: str) -> bool:
        return self.bank.baseline is None or axis in self.bank.baseline.constant_axes

    def on_missing(self, count: int) -> list[tuple[str, Reason]]:
        """Bridge lost samples; the axes that became invalid meanwhile, and why."""
        self._tune()
        return [(self._names[lane], why) for _, lane, why in self.bank.on_missing(count)]

    def bridge(self, count: int) -> None:
        """Bridge the time for which the program stood still, as far as the memory reaches."""
        self.on_missing(min(count, self.config.window_samples or LONGEST_BRIDGE))

    def notices(self, host_ns: int) -> Iterator[Notice]:
        """Return what is to be reported once the window is full."""
        baseline = self.bank.baseline
        for axis in baseline.constant_axes if baseline else ():
            remedy = "--set accel.R=9e-4" if axis in ACCEL_AXES else "--r 0.02"
            text = (
                f"{axis} did not change over the start-up window, so R is not known, and the axis "
                f"stays invalid. Is the sensor alive? If such data are meant, give R: {remedy}."
            )
            yield Notice("constant_axis", text, host_ns)

    def save(self) -> OnlineState | None:
        """What a later run needs to go on; None while the start-up window fills."""
        return self.bank.save()

    @cached_property
    def info(self) -> EstimatorInfo:
        """What they are estimated with."""
        c = self.config
        return EstimatorInfo(
            c.variant,
            c.estimate_on,
            c.memory,
            c.guard,
            c.window_samples,
            c.startup_needed,
            _numbers(c.bias),
            _numbers(c.R),
            c.tuned_by,
        )

    def stats(self) -> Iterator[tuple[str, AxisStats]]:
        """Statistics of every axis."""
        bank = self.bank
        baseline, restarts, interventions = bank.baseline, bank.restarts, bank.interventions
        lag1, nis, is_white = bank.lag1, bank.nis, bank.is_white
        for i, name in enumerate(self._names):
            if baseline is None:
                yield name, AxisStats(None, None, 0, {}, unit=self._unit)
                continue
            Q, R = bank.variances[name]
            constant = name in baseline.constant_axes
            stands = self._settled(name).stands
            yield (
                name,
                AxisStats(
                    baseline.bias_dps[i],
                    None if constant else R,
                    restarts[name],
                    interventions[name],
                    lag1[name],
                    nis[name],
                    self._unit,
                    None if constant else Q,
                    name in bank.tuned,
                    describes_order(is_white[name], *bank.found(name), stands.alpha if stands else None),
                ),
            )


def _numbers(setting: str | float | list[float]) -> tuple[float, ...]:
    """Return what bias or R is set to; nothing where the start-up window gives it."""
    if isinstance(setting, str):
        return (0.0,) if setting == "none" else ()
    return tuple(setting) if isinstance(setting, list) else (setting,)


def _at(config: EstimatorConfig, table: str, rate_hz: float) -> EstimatorConfig:
    """The settings with times as samples.

    Raises:
        UsageError: more samples than there may be.
    """
    try:
        return config.at(rate_hz)
    except ValueError as error:
        raise UsageError(f"{table}: at {rate_hz:g} Hz: {error}.") from error


class HostEstimates(Stage):
    """Lets the channels of both sensors take every sample.

    settings: gives those of the gyroscope's axes, asked for whenever an epoch begins; None if a board alone
    estimates them. fits: the live fits, whose verdict on white noise the records state.
    """

    def __init__(
        self, config: Config, settings: Callable[[], EstimatorConfig] | None, fits: LiveFits | None = None
    ) -> None:
        self._config = config
        self._settled = settled_by(fits)
        self._settings = settings
        self.sensors: dict[str, Channels] = {}
        self._lost_reported = OnceAMinute()

    def begin(self, beginning: Beginning) -> None:
        """Begin an epoch, from what was saved if it fits."""
        hello, saved = beginning.hello, beginning.saved or Saved()
        gyro, accel = beginning.axes(self._config.channels)
        self.sensors = {}
        if gyro and self._settings is not None:
            settings = _at(self._settings(), "estimator", hello.rate_hz)
            sensor = gyro, settings, 1 / hello.rate_hz, resolution_dps(hello), GYRO_UNIT
            self.sensors["gyro"] = Channels(*sensor, self._settled, saved.gyro)
        if accel:
            settings = _at(self._config.accel, "accel", hello.rate_hz)
            sensor = accel, settings, 1 / hello.rate_hz, accel_resolution_ms2(hello), ACCEL_UNIT
            self.sensors["accel"] = Channels(*sensor, self._settled, saved.accel)

    def bridge(self, count: int) -> None:
        """Bridge the time for which the program stood still."""
        for channels in self.sensors.values():
            channels.bridge(count)

    def on_block(self, block: Block, host_ns: Ints, missing: int) -> Iterator[Item]:
        """Give the samples on with their estimates."""
        for channels in self.sensors.values() if missing else ():
            for axis, why in channels.on_missing(missing):
                yield from self._lost(axis, why, int(host_ns[0]))
        begin, n = 0, len(block)
        while begin < n:
            filling = [one for one in self.sensors.values() if one.startup_remaining]
            end = min([n, *(begin + one.startup_remaining for one in filling)])
            part = block if (begin, end) == (0, n) else block.rows(begin, end)
            yield from self._estimate(part, host_ns[begin:end])
            now_ns = int(host_ns[end - 1])
            for channels in filling:
                if not channels.startup_remaining:
                    yield from channels.notices(now_ns)
            begin = end

    def standing(self) -> Standing:
        """Return how the filters get on."""
        info = {name: channels.info for name, channels in self.sensors.items()}
        return Standing(
            startup_remaining=max((one.startup_remaining for one in self.sensors.values()), default=0),
            axes={axis: stats for one in self.sensors.values() for axis, stats in one.stats()},
            gyro=info.get("gyro"),
            accel=info.get("accel"),
        )

    def save(self) -> dict[str, Any]:
        """Both sensors' estimators; nothing while one of them has nothing to keep."""
        found = {name: channels.save() for name, channels in self.sensors.items()}
        return found if all(found.values()) else {}

    def _estimate(self, block: Block, host_ns: Ints) -> Iterator[Item]:
        found: list[AxisColumns] = []
        lost: list[Loss] = []
        variant = ""
        for name, values in (("gyro", block.gyro_dps), ("accel", block.accel_ms2)):
            channels = self.sensors.get(name)
            if channels is None or values is None:
                continue
            columns, lost_of_sensor = channels.run(values)
            lost += lost_of_sensor
            if columns is not None:
                found.append(columns)
                variant = variant or channels.config.variant
        if found:
            block = block.but(variant=variant, estimates=tuple(found))
        yield from self.with_notices(block, lost, host_ns)

    def with_notices(self, block: Block, lost: list[Loss], host_ns: Ints) -> Iterator[Item]:
        """Give samples on, cut where an axis became invalid, and what is to be reported of that."""
        begin = 0
        for row, axis, why in sorted(lost):
            for notice in self._lost(axis, why, int(host_ns[row])):
                if row >= begin:
                    yield block.rows(begin, row + 1)
                    begin = row + 1
                yield notice
        if begin < len(block):
            yield block.rows(begin, len(block)) if begin else block

    def _lost(self, axis: str, why: Reason, now_ns: int) -> Iterator[Notice]:
        if self._lost_reported.is_due(axis, now_ns):
            yield Notice(*explain_lost(axis, why), now_ns)


def explain_lost(axis: str, reason: Reason) -> tuple[str, str]:
    """Kind and text of the error that an axis has become invalid."""
    if reason == "runaway":
        return "axis_runaway", (
            f"{axis} ran away (order or parameter beyond all bounds) and begins again: an offset, a wrong R "
            "or a moving sensor does this to the unguarded algorithm. Use --guard consistent."
        )
    return "axis_bound", (
        f"{axis} needs the guard in more than a quarter of its samples, so it is not valid until that ends: "
        "is the sensor at rest, and does R (see stats) fit it?"
    )
