"""The walk of one sample: source → continuity → timebase → units → estimator → records.

This is the only module that knows all stages. The sources stand before it (transport, framing and
messages inside the serial one), the sinks behind it.
"""

import math
from collections.abc import Iterator

import msgspec

from fltea.config import Config
from fltea.continuity import Continuity, Placed
from fltea.errors import UsageError
from fltea.estimator import gyroscope
from fltea.estimator.online import OnlineEstimator
from fltea.estimator.supervisor import Reason
from fltea.model import (
    AXES,
    AnyRecord,
    AxisEstimate,
    AxisStats,
    Break,
    DeviceStatus,
    Epoch,
    Error,
    Estimate,
    EstimatorInfo,
    Event,
    Gap,
    Hello,
    LinkDown,
    RawSample,
    SampleStats,
    Stats,
    Trouble,
)
from fltea.sources import Source
from fltea.timebase import Timebase
from fltea.units import resolution_dps, to_units

STATS_PERIOD_NS = 10**9
LOST_PERIOD_NS = 60 * 10**9


class Pipeline:
    """Turns the events of one source into records, in order."""

    def __init__(self, source: Source, config: Config) -> None:
        self._source = source
        self._config = config
        self._continuity = Continuity(config.link.max_gap)
        self._epoch = 0
        self._timebase: Timebase | None = None
        self._estimator: OnlineEstimator | None = None
        self._device: DeviceStatus | None = None
        self._now_ns = 0
        self._told_lost: dict[str, int] = {}
        self._offset_ns = source.unix_offset_ns
        self._stats_due_ns: int | None = None

    def feed(self, event: Event) -> Iterator[AnyRecord]:
        """Yield what one event leads to.

        Raises:
            UsageError: a fixed bias or R that does not fit the axes.
        """
        if not isinstance(event, DeviceStatus):
            self._now_ns = event.host_ns
        match event:
            case Hello():
                if self._continuity.on_hello(event):
                    yield msgspec.structs.replace(event, host_ns=self._unix_ns())
            case RawSample():
                placed = self._continuity.on_sample(event)
                if placed is not None:
                    yield from self._on_sample(placed)
            case DeviceStatus():
                self._device = event
            case LinkDown():
                self._continuity.on_link_down()
                self._device = None
            case Break():
                self._continuity.on_break(event.reason)
            case Trouble():
                yield Error(event.kind, event.message, self._unix_ns())
        if self._stats_due_ns is None:
            self._stats_due_ns = self._now_ns + STATS_PERIOD_NS
        elif self._now_ns >= self._stats_due_ns:
            yield self.stats()

    def _on_sample(self, placed: Placed) -> Iterator[AnyRecord]:
        hello = self._continuity.hello
        assert hello is not None
        raw = placed.raw
        gap_epoch = self._epoch
        if placed.new_epoch is not None or self._timebase is None or self._estimator is None:
            self._epoch += 1
            self._offset_ns = self._source.unix_offset_ns
            self._timebase = Timebase(self._offset_ns)
            self._estimator = self._new_estimator(len(raw.gyro), hello)
        else:
            self._estimator.on_missing(placed.missing)
        host_ns = self._timebase.add(placed.seq, placed.device_us, raw.host_ns)
        if placed.missing:
            yield Gap(placed.seq - placed.missing, placed.missing, gap_epoch, host_ns)
        if placed.new_epoch is not None:
            yield Epoch(
                self._epoch,
                placed.new_epoch,
                placed.seq,
                placed.device_us,
                host_ns,
                hello.boot_id,
                self._estimator_info(),
            )
        sample = to_units(raw, hello, self._epoch, placed.seq, placed.device_us, host_ns)
        if self._config.samples:
            yield sample
        had_baseline = self._estimator.baseline is not None
        estimates = self._estimator.on_sample(sample.gyro_dps)
        if not had_baseline and self._estimator.baseline is not None:
            yield from self._on_baseline()
        if estimates is not None:
            axes = {axis: _published(estimate) for axis, estimate in estimates.items()}
            yield from self._on_lost()
            variant = self._config.estimator.variant
            yield Estimate(sample.seq, sample.epoch, sample.device_us, sample.host_ns, variant, axes)

    def _on_lost(self) -> Iterator[Error]:
        """Tell which axes have just become invalid; the same axis not more than once a minute."""
        assert self._estimator is not None
        for axis, reason in self._estimator.lost.items():
            told_ns = self._told_lost.get(axis)
            if told_ns is None or self._now_ns - told_ns >= LOST_PERIOD_NS:
                self._told_lost[axis] = self._now_ns
                yield Error(*_explain_lost(axis, reason), self._unix_ns())

    def _on_baseline(self) -> Iterator[AnyRecord]:
        assert self._estimator is not None and self._estimator.baseline is not None  # noqa: PT018
        for axis in self._estimator.baseline.constant_axes:
            text = (
                f"{axis} did not change over the start-up window, so R cannot be drawn from it, and the axis "
                "stays invalid. Is the sensor alive? If such data are meant, give R: --r 0.02."
            )
            yield Error("constant_axis", text, self._unix_ns())
        yield self.stats()

    def stats(self) -> Stats:
        """Sum up the whole walk so far."""
        self._stats_due_ns = self._now_ns + STATS_PERIOD_NS
        c = self._continuity
        return Stats(
            epoch=self._epoch,
            host_ns=self._unix_ns(),
            rate_hz=self._timebase.rate_hz if self._timebase else None,
            clock_ppm=self._timebase.clock_ppm if self._timebase else None,
            startup_remaining=self._estimator.startup_remaining if self._estimator else 0,
            link=self._source.link_stats(),
            samples=SampleStats(c.delivered, c.lost, c.gaps, c.duplicates, c.before_hello),
            axes=self._axis_stats(),
            device=self._device,
        )

    def _axis_stats(self) -> dict[str, AxisStats]:
        if self._estimator is None:
            return {}
        restarts, baseline = self._estimator.restarts, self._estimator.baseline
        interventions = self._estimator.interventions
        if baseline is None:
            return {axis: AxisStats(None, None, 0, {}) for axis in self._estimator.axes}
        return {
            axis: AxisStats(
                bias, R if math.isfinite(R) else None, restarts[axis], interventions.get(axis, {})
            )
            for axis, bias, R in zip(self._estimator.axes, baseline.bias_dps, baseline.R, strict=True)
        }

    def _new_estimator(self, axes: int, hello: Hello) -> OnlineEstimator:
        try:
            return OnlineEstimator(
                AXES[:axes], self._config.estimator, 1.0 / hello.rate_hz, resolution_dps(hello)
            )
        except ValueError as error:
            raise UsageError(f"estimator: {error}.") from error

    def _estimator_info(self) -> EstimatorInfo:
        e = self._config.estimator
        bias = tuple(e.bias) if isinstance(e.bias, list) else e.bias
        R = tuple(e.R) if isinstance(e.R, list) else e.R
        return EstimatorInfo(e.variant, e.engine, e.guard, e.window, e.startup_needed, bias, R)

    def _unix_ns(self) -> int:
        return self._now_ns + self._offset_ns


def _published(estimate: gyroscope.AxisEstimate) -> AxisEstimate:
    """An estimate as a sink may write it: null in place of any number that is not finite."""
    alpha, alpha_std, f, f_std, state, innovation = (
        value if math.isfinite(value) else None for value in estimate[:6]
    )
    return AxisEstimate(alpha, alpha_std, f, f_std, state, innovation, estimate.valid)


def _explain_lost(axis: str, reason: Reason) -> tuple[str, str]:
    """Kind and text of the error that an axis has become invalid."""
    if reason == "runaway":
        return "axis_runaway", (
            f"{axis} ran away (order or parameter beyond all bounds) and begins anew: an offset, a wrong R "
            "or a moving sensor does this to the unguarded algorithm. --guard consistent holds it."
        )
    return "axis_bound", (
        f"{axis} needs the guard in more than a quarter of its samples, so it is not valid until that ends: "
        "is the sensor at rest, and does R (see stats) fit it?"
    )
