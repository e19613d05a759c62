"""The stage for what a board estimates by itself: to which sample it belongs, and how far it is from ours.

An estimate comes after its sample, by as much as the board is behind. One whose sample is not among the
newest of this epoch is dropped and counted.
"""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from fltea.records.block import Block
from fltea.records.events import (
    SEQUENCE_WRAP,
    DeviceAxis,
    DeviceBins,
    DeviceEstimator,
    DeviceFit,
    Event,
    Ints,
    LinkDown,
)
from fltea.records.records import (
    AXES,
    GYRO_UNIT,
    AxisEstimate,
    AxisStats,
    DeviceAxisEstimate,
    DeviceEstimates,
    DeviceEstimatorStats,
    Estimate,
)
from fltea.records.repeat import REPEAT_NS, OnceAMinute
from fltea.settings.config import Config
from fltea.settings.estimator import EstimatorConfig
from fltea.stream.board_fits import BoardFits, Place
from fltea.stream.board_settings import host_settings, info_of, unused_settings
from fltea.stream.comparable import why_not_comparable
from fltea.stream.live import LiveFits, Said, said_by
from fltea.stream.stages import Beginning, Item, Notice, Saved, Standing

REMEMBERED = 256
"""Samples for which an estimate may still come; the board drops samples when it is further behind."""

PATIENCE_NS = 5 * 10**9


class _Moment(NamedTuple):
    """A sample, row `row` of `block`. age: steps of the host's estimates since the start-up window."""

    seq: int
    block: Block
    row: int
    age: int

    def place(self) -> Place:
        """Number, epoch, and the times of device and host."""
        block, row = self.block, self.row
        return Place(self.seq, block.epoch, int(block.device_us[row]), int(block.host_ns[row]))

    def host(self) -> dict[str, AxisEstimate]:
        """The host's estimates after it; empty in its start-up window, or if it makes none."""
        found = [columns for columns in self.block.estimates if columns.unit == GYRO_UNIT]
        return found[0].at(self.row) if found else {}


class BoardEstimates:
    """Follows the board's own estimates.

    Where it alone estimates, they become `Estimate` records; else `DeviceEstimates` compare them with this
    computer's, which computes with the board's settings as soon as it knows them. fits: what is said of white
    noise beside the estimates.
    """

    def __init__(self, config: Config, fits: LiveFits | None = None) -> None:
        self._said = said_by(fits)
        self._fits = BoardFits(config.name, self._said)
        self.alone = config.estimator.estimate_on == "device"
        self.stated: DeviceEstimator | None = None
        self._config = config
        self._settings: EstimatorConfig | None = None
        self._in_use: EstimatorConfig | None = None
        self._axes: tuple[str, ...] = ()
        self._places: list[int] = []
        self._moments: dict[int, _Moment] = {}
        self._window_end = 0
        self._newest: dict[str, DeviceAxis] = {}
        self._group: dict[str, DeviceAxis] = {}
        self._group_of: _Moment | None = None
        self._sequence: int | None = None
        self._estimates = self._lost = self._unplaced = 0
        self._waits_since_ns: int | None = None
        self._told_silent = self._told_bad = self._told_unused = False
        self._told_constant: set[str] = set()
        self._told_invalid = OnceAMinute()
        self._told_skipped: tuple[int, int | None] = (0, None)

    def host_settings(self) -> EstimatorConfig:
        """With what this computer estimates from now on: the board's settings, once they are known."""
        self._in_use = self._settings or self._config.estimator
        return self._in_use

    def begin(self, beginning: Beginning) -> None:
        """Begin an epoch."""
        self.forget()
        self._fits.begin(beginning.hello.rate_hz)
        gyro, _ = beginning.axes(self._config.channels)
        self._axes, self._places = tuple(gyro), list(gyro.values())
        self._told_constant.clear()

    def forget(self) -> None:
        """Believe no estimate of samples until now."""
        self._unplaced += len(self._group)
        self._fits.forget()
        self._moments.clear()
        self._group.clear()
        self._newest.clear()
        self._sequence = None

    def bridge(self, count: int) -> None:
        """Nothing of a board is ever saved."""

    def on_block(self, block: Block, host_ns: Ints, missing: int) -> Iterator[Item]:
        """Remember samples; their estimates come later."""
        yield from self._unused(int(host_ns[0]))
        if not block.estimates:
            self._window_end = int(block.seq[-1])
        first = max(0, len(block) - REMEMBERED)
        for row, seq in enumerate(block.seq[first:].tolist(), first):
            self._moments[seq] = _Moment(seq, block, row, seq - self._window_end)
        while len(self._moments) > REMEMBERED:
            del self._moments[next(iter(self._moments))]
        late = self._silent(host_ns)
        if late is None:
            yield block
            return
        yield block.rows(0, late + 1)
        yield self._silence(int(host_ns[late]))
        if late + 1 < len(block):
            yield block.rows(late + 1, len(block))

    def on_event(self, event: Event) -> Iterator[Item]:
        """Take what the board says of its estimates."""
        if isinstance(event, LinkDown):
            self.forget()
            self.stated = self._settings = self._waits_since_ns = None
            self._told_skipped = (0, None)
        elif isinstance(event, DeviceAxis):
            yield from self._on_axis(event)
        elif isinstance(event, DeviceEstimator):
            yield from self._on_estimator(event)
        elif isinstance(event, DeviceFit):
            yield from self._fits.on_fit(event, self._axes, self._newest_place())
        elif isinstance(event, DeviceBins):
            yield from self._fits.on_bins(event, self._newest_place())

    def standing(self) -> Standing:
        """How the board's estimator gets on."""
        s = self.stated
        standing = Standing(device=self._stats())
        if self.alone:
            standing.startup_remaining = s.remaining if s else 0
            standing.axes = self._axes_stats()
            standing.gyro = info_of(s) if s else None
        return standing

    def save(self) -> Saved | None:
        """A board begins its window with each boot."""
        return None

    def _unused(self, now_ns: int) -> Iterator[Notice]:
        """Tell once which settings were changed for nothing, since the board has its own."""
        if self._told_unused:
            return
        self._told_unused = True
        unused = unused_settings(self._config.estimator)
        if unused:
            who = self._config.estimator.estimate_on
            text = (
                f"{', '.join(unused)}: not used with --estimate-on {who}, since the device estimates with "
                "the settings of its firmware" + (", and so does this computer." if who == "both" else ".")
            )
            yield Notice("settings_unused", text, now_ns)

    def _silent(self, host_ns: Ints) -> int | None:
        """The sample with which it is too long that the board sent samples, and no word of estimates."""
        if self.stated is not None or self._told_silent:
            return None
        if self._waits_since_ns is None:
            self._waits_since_ns = int(host_ns[0])
        late = np.flatnonzero(host_ns - self._waits_since_ns >= PATIENCE_NS)
        return int(late[0]) if len(late) else None

    def _silence(self, now_ns: int) -> Notice:
        self._told_silent = True
        return Notice(
            "no_device_estimates",
            f"the device sends samples, but in {PATIENCE_NS // 10**9} s no word of estimates of its own: "
            "its firmware was built with estimation switched off, or is none of an Arduino Due. Flash "
            "that of this program (fltea flash), or let this computer estimate: --estimate-on host.",
            now_ns,
        )

    def _on_estimator(self, stated: DeviceEstimator) -> Iterator[Notice]:
        self.stated, self._told_silent = stated, False
        try:
            self._settings = host_settings(stated)
        except ValueError as problem:
            self._settings = None
            if not (self.alone or self._told_bad):
                self._told_bad = True
                text = f"the device's settings cannot be this program's, so nothing is compared: {problem}."
                yield Notice("device_settings", text, stated.host_ns)
        told, told_ns = self._told_skipped
        if told_ns is None or stated.skipped < told:
            self._told_skipped = stated.skipped, stated.host_ns - REPEAT_NS
        elif stated.skipped > told and stated.host_ns - told_ns >= REPEAT_NS:
            self._told_skipped = stated.skipped, stated.host_ns
            yield Notice(
                "device_skipped",
                f"the device's estimator skipped {stated.skipped - told} samples ({stated.skipped} since its "
                "boot): it had fallen behind, so its estimates are of fewer samples than there were, and "
                "nothing is compared until it begins again. No sample itself is lost by this. A lower rate "
                "in the firmware's settings helps.",
                stated.host_ns,
            )

    def _on_axis(self, e: DeviceAxis) -> Iterator[Item]:
        """Take the estimate of one axis; a record comes with the last axis of a sample, or after it."""
        self._estimates += 1
        if self._sequence is not None:
            self._lost += (e.sequence - self._sequence - 1) % SEQUENCE_WRAP
        self._sequence = e.sequence
        moment = self._find(e.sample)
        if moment is None or self.stated is None:
            self._unplaced += 1
            return
        if e.axis not in self._axes:
            return
        if self._group and self._group_of is not None and self._group_of.seq != moment.seq:
            yield from self._record(self._group_of, self.stated.variant)
        yield from self._notices(e, self._newest.get(e.axis))
        self._newest[e.axis] = self._group[e.axis] = e
        self._group_of = moment
        if len(self._group) == len(self._axes):
            yield from self._record(moment, self.stated.variant)

    def _axes_stats(self) -> dict[str, AxisStats]:
        """What the board says of each axis, in place of what a host that estimates would say."""
        result = {}
        for axis, place in zip(self._axes, self._places, strict=True):
            bias = R = None
            restarts = 0
            if self.stated is not None and not self.stated.remaining:
                bias, R = _finite(self.stated.bias_dps[place]), _finite(self.stated.R_dps2[place]) or None
                restarts = self.stated.restarts[place]
            newest = self._newest.get(axis)
            result[axis] = AxisStats(bias, R, restarts, newest.interventions if newest else {})
        return result

    def _stats(self) -> DeviceEstimatorStats | None:
        s = self.stated
        if s is None:
            return None
        return DeviceEstimatorStats(
            begun=s.begun,
            startup_remaining=s.remaining,
            every=s.every,
            queue=s.queue,
            skipped=s.skipped,
            longest_axis_us=s.longest_axis_us,
            estimates=self._estimates,
            lost=self._lost,
            unplaced=self._unplaced,
            restarts=dict(zip(AXES, s.restarts, strict=True)),
            interventions={axis: e.interventions for axis, e in self._newest.items()},
            fit_every=s.fit_every,
            fits=self._fits.came,
            fits_refused=self._fits.refused,
            longest_slice_us=s.longest_slice_us,
        )

    def _newest_place(self) -> Place | None:
        return self._moments[next(reversed(self._moments))].place() if self._moments else None

    def _find(self, number: int) -> _Moment | None:
        """The sample of a sequence that wraps."""
        if not self._moments:
            return None
        newest = next(reversed(self._moments))
        return self._moments.get(newest - (newest - number) % SEQUENCE_WRAP)

    def _notices(self, e: DeviceAxis, before: DeviceAxis | None) -> Iterator[Notice]:
        """What there is to tell of an axis that only the device estimates."""
        if not self.alone:
            return
        if e.constant and e.axis not in self._told_constant:
            self._told_constant.add(e.axis)
            text = (
                f"{e.axis} did not change over the device's start-up window, so R cannot be drawn from it, "
                "and the axis stays invalid until the device begins again. Is the sensor alive?"
            )
            yield Notice("constant_axis", text, e.host_ns)
        if before and before.valid and not e.valid and self._told_invalid.is_due(e.axis, e.host_ns):
            text = (
                f"{e.axis} is not valid any more, says the device: it ran away, or needs the guard in more "
                "than a quarter of its samples. Is the sensor at rest, and does R (see stats) fit it?"
            )
            yield Notice("axis_bound", text, e.host_ns)

    def _record(self, moment: _Moment, variant: str) -> Iterator[Estimate | DeviceEstimates]:
        """The gathered estimates of one sample."""
        group, self._group = self._group, {}
        if moment.seq % self._config.output.every:
            return
        ordered = [axis for axis in self._axes if axis in group]
        if self.alone:
            found = {axis: _as_estimate(group[axis], self._said(axis)) for axis in ordered}
            yield Estimate(*moment.place(), variant, found, device=self._config.name)
            return
        same = self._settings is not None and self._settings == self._in_use
        host = moment.host()
        axes = {axis: _compare(group[axis], host.get(axis), moment.age, same) for axis in ordered}
        comparable = any(axis.why_not is None for axis in axes.values())
        yield DeviceEstimates(*moment.place(), variant, axes, comparable, device=self._config.name)


def _as_estimate(e: DeviceAxis, said: Said) -> AxisEstimate:
    valid, numbers = _numbers(e)
    return AxisEstimate(*numbers, valid, said.null_p, said.whiteness)


def _compare(
    e: DeviceAxis, host: AxisEstimate | None, host_age: int, same_settings: bool
) -> DeviceAxisEstimate:
    """The board's estimate, and its difference from the host's, or why there is none."""
    valid, numbers = _numbers(e)
    why_not = why_not_comparable(
        device_valid=valid,
        host_valid=host.valid if host else None,
        device_age=e.age,
        host_age=host_age,
        device_skipped=e.skipped,
        same_settings=same_settings and not e.tuned,
    )
    if why_not is not None or host is None or host.alpha is None or host.f is None or host.state is None:
        return DeviceAxisEstimate(*numbers, valid, age=e.age, why_not=why_not or "host_not_valid")
    return DeviceAxisEstimate(
        *numbers,
        valid,
        age=e.age,
        alpha_difference=_finite(e.alpha - host.alpha),
        f_difference=_finite(e.f - host.f),
        state_difference=_finite(e.state_dps - host.state),
    )


_Six = tuple[float | None, float | None, float | None, float | None, float | None, float | None]


def _numbers(e: DeviceAxis) -> tuple[bool, _Six]:
    """Whether an estimate holds, and its numbers; null in place of any that is not finite."""
    if not (e.valid and all(map(math.isfinite, (e.alpha, e.alpha_std, e.f, e.f_std, e.state_dps)))):
        return False, (None, None, None, None, None, None)
    innovation = None if e.missing else _finite(e.innovation_dps)
    return True, (e.alpha, e.alpha_std, e.f, e.f_std, e.state_dps, innovation)


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
