"""A device's own estimates: which sample each belongs to, and how far it is from the host's.

`DeviceFollower` is told of everything in its order (messages, samples, what the host makes of them) and
yields records. An estimate comes after its sample, by as much as the device is behind; one whose sample is
not among the newest of this epoch is dropped and counted.
"""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from fltea.estimator.running_null import RunningNull, Standing
from fltea.lab.reference import gyroscope
from fltea.records.events import DeviceAxis, DeviceEstimator
from fltea.records.records import (
    AXES,
    AxisEstimate,
    AxisStats,
    DeviceAxisEstimate,
    DeviceEstimates,
    DeviceEstimatorStats,
    Estimate,
    Sample,
)
from fltea.settings.config import BY_DEVICE, EstimateOn, EstimatorConfig
from fltea.stream.board_settings import host_settings

SEQUENCE_WRAP = 1 << 16
REMEMBERED = 256
"""Samples for which an estimate may still come; the device drops samples when it is further behind."""

PATIENCE_NS = 5 * 10**9
REPEAT_NS = 60 * 10**9


class Notice(NamedTuple):
    """Kind and text of an `error` record."""

    kind: str
    message: str


class _Moment(NamedTuple):
    """A sample, and the host's estimates after it. age: their steps since the start-up window."""

    sample: Sample
    host: dict[str, gyroscope.AxisEstimate]
    age: int


class DeviceFollower:
    """Follows one device.

    estimate_on: "device" gives `Estimate` records of the device's estimates, "both" `DeviceEstimates` that
    compare them with the host's. name: of the device, for the records.
    """

    def __init__(self, estimate_on: EstimateOn, name: str | None) -> None:
        assert estimate_on in BY_DEVICE
        self.alone = estimate_on == "device"
        self.stated: DeviceEstimator | None = None
        self._name = name
        self._settings: EstimatorConfig | None = None
        self._in_use: EstimatorConfig | None = None
        self._axes: tuple[str, ...] = ()
        self._places: tuple[int, ...] = ()
        self._null = RunningNull(0)
        self._moments: dict[int, _Moment] = {}
        self._window_end = 0
        self._newest: dict[str, DeviceAxis] = {}
        self._group: dict[str, DeviceAxis] = {}
        self._group_of: _Moment | None = None
        self._sequence: int | None = None
        self._estimates = self._lost = self._unplaced = 0
        self._waits_since_ns: int | None = None
        self._told_silent = self._told_bad = False
        self._told_constant: set[str] = set()
        self._told_invalid_ns: dict[str, int] = {}
        self._told_skipped: tuple[int, int | None] = (0, None)

    def settings(self, config: EstimatorConfig) -> EstimatorConfig:
        """With what the host computes from now on: the device's, or its own while these are not known."""
        self._in_use = self._settings or config
        return self._in_use

    def begin(self, axes: Sequence[str]) -> None:
        """Begin an epoch: of these axes."""
        self.forget_samples()
        self._axes = tuple(axes)
        self._places = tuple(AXES.index(axis) for axis in axes)
        self._null = RunningNull(len(axes))
        self._told_constant.clear()

    def forget_samples(self) -> None:
        """Believe no estimate of samples until now: the device, its boot or its sensor may be another."""
        self._unplaced += len(self._group)
        self._moments.clear()
        self._group.clear()
        self._newest.clear()
        self._sequence = None

    def forget_device(self) -> None:
        """What follows may come from another device."""
        self.forget_samples()
        self.stated = self._settings = self._waits_since_ns = None
        self._told_skipped = (0, None)

    def on_missing(self, count: int) -> None:
        """Take note of lost samples."""
        if self.alone:
            self._null.skip(count)

    def on_sample(
        self, sample: Sample, now_ns: int, host: dict[str, gyroscope.AxisEstimate] | None
    ) -> Iterator[Notice]:
        """Take a sample. host: the host's estimates; None in its start-up window, or if it makes none."""
        if self.alone:
            self._null.add([sample.gyro_dps[place] for place in self._places])
        if host is None:
            self._window_end = sample.seq
        self._moments[sample.seq] = _Moment(sample, host or {}, sample.seq - self._window_end)
        if len(self._moments) > REMEMBERED:
            del self._moments[next(iter(self._moments))]
        if self.stated is not None:
            return
        if self._waits_since_ns is None:
            self._waits_since_ns = now_ns
        elif now_ns - self._waits_since_ns >= PATIENCE_NS and not self._told_silent:
            self._told_silent = True
            yield Notice(
                "no_device_estimates",
                f"the device sends samples, but in {PATIENCE_NS // 10**9} s no word of estimates of its own: "
                "its firmware was built with estimation switched off, or is none of an Arduino Due. Flash "
                "that of this program (fltea flash), or let this computer estimate: --estimate-on host.",
            )

    def on_estimator(self, stated: DeviceEstimator) -> Iterator[Notice]:
        """Take what the device says of its estimator."""
        self.stated, self._told_silent = stated, False
        try:
            self._settings = host_settings(stated)
        except ValueError as problem:
            self._settings = None
            if not (self.alone or self._told_bad):
                self._told_bad = True
                text = f"the device's settings cannot be this program's, so nothing is compared: {problem}."
                yield Notice("device_settings", text)
        told, told_ns = self._told_skipped
        if told_ns is None or stated.skipped < told:
            self._told_skipped = stated.skipped, stated.host_ns - REPEAT_NS
        elif stated.skipped > told and stated.host_ns - told_ns >= REPEAT_NS:
            self._told_skipped = stated.skipped, stated.host_ns
            yield Notice(
                "device_skipped",
                f"the device's estimator skipped {stated.skipped - told} samples ({stated.skipped} since its "
                "boot): it had fallen behind, so its estimates are of fewer samples than there were, and "
                "nothing is compared until it begins anew. No sample itself is lost by this. A lower rate in "
                "the firmware's settings helps.",
            )

    def on_axis(self, e: DeviceAxis) -> Iterator[Notice | Estimate | DeviceEstimates]:
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
        if self._group and self._group_of is not moment and self._group_of is not None:
            yield self._record(self._group_of, self.stated.variant)
        yield from self._notices(e, self._newest.get(e.axis))
        self._newest[e.axis] = self._group[e.axis] = e
        self._group_of = moment
        if len(self._group) == len(self._axes):
            yield self._record(moment, self.stated.variant)

    def axes_stats(self) -> dict[str, AxisStats]:
        """What the device says of each axis, in place of what a host that estimates would say."""
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

    def stats(self) -> DeviceEstimatorStats | None:
        """How the device's estimator gets on; None while it has said nothing."""
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
        )

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
                "and the axis stays invalid until the device begins anew. Is the sensor alive?"
            )
            yield Notice("constant_axis", text)
        told_ns = self._told_invalid_ns.get(e.axis)
        if before and before.valid and not e.valid and (told_ns is None or e.host_ns - told_ns >= REPEAT_NS):
            self._told_invalid_ns[e.axis] = e.host_ns
            text = (
                f"{e.axis} is not valid any more, says the device: it ran away, or needs the guard in more "
                "than a quarter of its samples. Is the sensor at rest, and does R (see stats) fit it?"
            )
            yield Notice("axis_bound", text)

    def _record(self, moment: _Moment, variant: str) -> Estimate | DeviceEstimates:
        """The gathered estimates of one sample."""
        group, self._group, s = self._group, {}, moment.sample
        place = s.seq, s.epoch, s.device_us, s.host_ns, variant
        if self.alone:
            standings = dict(zip(self._axes, self._null.standings, strict=True))
            ordered = [axis for axis in self._axes if axis in group]
            return Estimate(
                *place,
                {axis: _as_estimate(group[axis], standings[axis]) for axis in ordered},
                device=self._name,
            )
        same = self._settings is not None and self._settings == self._in_use
        axes = {
            axis: _compare(group[axis], moment.host.get(axis) if same else None, moment.age)
            for axis in self._axes
            if axis in group
        }
        comparable = any(axis.alpha_difference is not None for axis in axes.values())
        return DeviceEstimates(*place, axes, comparable, device=self._name)


def _as_estimate(e: DeviceAxis, null: Standing) -> AxisEstimate:
    valid, numbers = _numbers(e)
    return AxisEstimate(*numbers, valid, *null)


def _compare(e: DeviceAxis, host: gyroscope.AxisEstimate | None, age: int) -> DeviceAxisEstimate:
    """The device's estimate, and its difference from the host's where both are of the same steps."""
    valid, numbers = _numbers(e)
    if host is None or not (valid and host.valid) or e.skipped or e.age != age:
        return DeviceAxisEstimate(*numbers, valid, e.age)
    differences = e.alpha - host.alpha, e.f - host.f, e.state_dps - host.state_dps
    return DeviceAxisEstimate(*numbers, valid, e.age, *map(_finite, differences))


_Six = tuple[float | None, float | None, float | None, float | None, float | None, float | None]


def _numbers(e: DeviceAxis) -> tuple[bool, _Six]:
    """Whether an estimate holds, and its numbers; null in place of any that is not finite."""
    if not (e.valid and all(map(math.isfinite, (e.alpha, e.alpha_std, e.f, e.f_std, e.state_dps)))):
        return False, (None, None, None, None, None, None)
    innovation = None if e.missing else _finite(e.innovation_dps)
    return True, (e.alpha, e.alpha_std, e.f, e.f_std, e.state_dps, innovation)


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
