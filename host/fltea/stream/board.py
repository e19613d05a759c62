"""Find the sample of each estimate that a board makes, and compare the estimate with this computer's.

An estimate arrives later than its sample, since the board needs time for it. So this module remembers the
newest samples since the last restart of the filters. An estimate for any other sample is dropped and counted.
"""

from collections.abc import Iterator
from typing import NamedTuple

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
from fltea.records.records import AXES, DeviceEstimates, Estimate
from fltea.records.sensor_kind import GYROSCOPE
from fltea.records.stats import AxisStats, DeviceEstimatorStats
from fltea.settings.config import Config
from fltea.settings.estimator import EstimatorConfig
from fltea.stream.board_compare import compare, estimate_of, finite
from fltea.stream.board_fits import BoardFits
from fltea.stream.board_notices import BoardNotices
from fltea.stream.board_samples import RecentSample, RecentSamples
from fltea.stream.board_settings import host_settings, info_of
from fltea.stream.epoch import Beginning, Item, Notice, Standing
from fltea.stream.live import LiveFits, accepted_by

AS_STATED = "begun", "every", "queue", "skipped", "longest_axis_us", "fit_every", "longest_slice_us"
"""Fields of the board's message about its estimator that the record `stats` repeats unchanged."""


class _Group(NamedTuple):
    """The board's estimates of one sample that have arrived so far, by axis."""

    sample: RecentSample
    axes: dict[str, DeviceAxis]


class EstimateCounts:
    """Counts of the board's estimates.

    `came`: those that arrived. `lost`: those that are missing between the sequence numbers of those that
    arrived. `unplaced`: those whose sample is not remembered.
    """

    def __init__(self) -> None:
        self.came = self.lost = self.unplaced = 0
        self._newest: int | None = None

    def add(self, sequence: int) -> None:
        """Count an estimate that arrived, and those lost before it. `sequence`: its number on the wire."""
        self.came += 1
        if self._newest is not None:
            self.lost += (sequence - self._newest - 1) % SEQUENCE_WRAP
        self._newest = sequence

    def forget(self) -> None:
        """Forget the newest sequence number, so that the next estimate shows no loss."""
        self._newest = None


class HostSettings:
    """The settings for this computer's filters: those of the board, once they are known.

    `usual`: the settings of this computer. `of_board`: those that the board has stated, if this computer can
    use them.
    """

    def __init__(self, usual: EstimatorConfig) -> None:
        self._usual = usual
        self.of_board: EstimatorConfig | None = None
        self._in_use: EstimatorConfig | None = None

    def use(self) -> EstimatorConfig:
        """Return the settings with which this computer's filters begin now."""
        self._in_use = self.of_board or self._usual
        return self._in_use

    @property
    def is_same(self) -> bool:
        """Whether this computer's filters use the settings that the board has stated."""
        return self.of_board is not None and self.of_board == self._in_use


class BoardEstimates:
    """Follows the board's own estimates.

    If only the board makes estimates, they become `Estimate` records. If this computer makes estimates too,
    `DeviceEstimates` records compare the board's with this computer's. In that case this computer uses the
    board's settings, as soon as the board has stated them. The state of a board's estimator is never saved,
    since the board begins a new start-up window with each boot.

    `fits`: this computer's live fits. The records of the board's estimates repeat the p-value of white noise
    from these fits.
    """

    def __init__(self, config: Config, fits: LiveFits | None = None) -> None:
        self._accepted = accepted_by(fits)
        self._fits = BoardFits(config.name, self._accepted)
        self._notices = BoardNotices(config.estimator)
        self.alone = config.estimator.estimate_on == "device"
        self.stated: DeviceEstimator | None = None
        self._config = config
        self._settings = HostSettings(config.estimator)
        self._axes: dict[str, int] = {}
        self._samples = RecentSamples()
        self._newest: dict[str, DeviceAxis] = {}
        self._group: _Group | None = None
        self._counts = EstimateCounts()

    def host_settings(self) -> EstimatorConfig | None:
        """Return the settings for this computer's filters: those of the board, once they are known.

        The result is None if only the board makes estimates.
        """
        return None if self.alone else self._settings.use()

    def begin(self, beginning: Beginning) -> None:
        """Begin an epoch: a stretch of samples without a restart of the filters."""
        self.forget()
        self._fits.begin(beginning.hello.rate_hz)
        gyro = beginning.axes(self._config.channels).get(GYROSCOPE, {})
        self._axes = gyro
        self._notices.begin()

    def forget(self) -> None:
        """Forget all samples until now. Estimates for them that still arrive are dropped."""
        if self._group is not None:
            self._counts.unplaced += len(self._group.axes)
        self._fits.forget()
        self._samples.clear()
        self._group = None
        self._newest.clear()
        self._counts.forget()

    def on_block(self, block: Block, host_ns: Ints) -> Iterator[Item]:
        """Remember samples, since the board's estimates for them arrive later."""
        yield from self._notices.unused(int(host_ns[0]))
        self._samples.add(block)
        late = self._notices.silent_from(host_ns) if self.stated is None else None
        if late is None:
            yield block
            return
        yield block.rows(0, late + 1)
        yield self._notices.silence(int(host_ns[late]))
        if late + 1 < len(block):
            yield block.rows(late + 1, len(block))

    def on_event(self, event: Event) -> Iterator[Item]:
        """Yield the records about an event in which the board reports estimates, fits or settings."""
        if isinstance(event, LinkDown):
            self.forget()
            self.stated = self._settings.of_board = None
            self._notices.on_link_down()
        elif isinstance(event, DeviceAxis):
            yield from self._on_axis(event)
        elif isinstance(event, DeviceEstimator):
            yield from self._on_estimator(event)
        elif isinstance(event, DeviceFit):
            yield from self._fits.on_fit(event, self._axes, self._samples.newest())
        elif isinstance(event, DeviceBins):
            yield from self._fits.on_bins(event, self._samples.newest())

    def standing(self) -> Standing:
        """Return the state of the board's estimator."""
        s = self.stated
        standing = Standing(device=self._stats())
        if self.alone:
            standing.startup_remaining = s.remaining if s else 0
            standing.axes = self._axes_stats()
            if s:
                standing.filters[GYROSCOPE] = info_of(s)
        return standing

    def _on_estimator(self, stated: DeviceEstimator) -> Iterator[Notice]:
        self.stated = stated
        try:
            self._settings.of_board = host_settings(stated)
        except ValueError as problem:
            self._settings.of_board = None
            if not self.alone:
                yield from self._notices.on_settings(problem, stated.host_ns)
        yield from self._notices.on_estimator(stated)

    def _on_axis(self, e: DeviceAxis) -> Iterator[Item]:
        """Process the board's estimate of one axis for one sample.

        Yield a record when the estimates of all axes for this sample have arrived.
        """
        self._counts.add(e.sequence)
        sample = self._samples.find(e.sample)
        if sample is None or self.stated is None:
            self._counts.unplaced += 1
            return
        if e.axis not in self._axes:
            return
        if self._group is not None and self._group.sample.seq != sample.seq:
            yield from self._record(self._group, self.stated.variant)
        if self.alone:
            yield from self._notices.on_axis(e, self._newest.get(e.axis))
        group = self._group = self._group or _Group(sample, {})
        self._newest[e.axis] = group.axes[e.axis] = e
        if len(group.axes) == len(self._axes):
            yield from self._record(group, self.stated.variant)

    def _axes_stats(self) -> dict[str, AxisStats]:
        """Return for each axis the statistics that the board states."""
        result = {}
        for axis, place in self._axes.items():
            bias = R = None
            restarts = 0
            if self.stated is not None and not self.stated.remaining:
                bias, R = finite(self.stated.bias_dps[place]), finite(self.stated.R_dps2[place]) or None
                restarts = self.stated.restarts[place]
            newest = self._newest.get(axis)
            result[axis] = AxisStats(bias, R, restarts, newest.interventions if newest else {})
        return result

    def _stats(self) -> DeviceEstimatorStats | None:
        s = self.stated
        if s is None:
            return None
        return DeviceEstimatorStats(
            **{name: getattr(s, name) for name in AS_STATED},
            startup_remaining=s.remaining,
            estimates=self._counts.came,
            lost=self._counts.lost,
            unplaced=self._counts.unplaced,
            restarts=dict(zip(AXES, s.restarts, strict=True)),
            interventions={axis: e.interventions for axis, e in self._newest.items()},
            fits=self._fits.came,
            fits_refused=self._fits.refused,
        )

    def _record(self, found: _Group, variant: str) -> Iterator[Estimate | DeviceEstimates]:
        """Yield the record of the board's estimates of one sample."""
        self._group = None
        sample, group = found
        if sample.seq % self._config.output.every:
            return
        ordered = [axis for axis in self._axes if axis in group]
        if self.alone:
            known = sample.estimates()
            own = {axis: estimate_of(group[axis], self._accepted(axis), known[axis]) for axis in ordered}
            yield Estimate(*sample.moment(), variant, own, device=self._config.name)
            return
        same = self._settings.is_same
        known, age = sample.estimates(), sample.age if sample.has_filters() else None
        axes = {axis: compare(group[axis], known.get(axis), age, same) for axis in ordered}
        comparable = any(axis.why_not is None for axis in axes.values())
        yield DeviceEstimates(*sample.moment(), variant, axes, comparable, device=self._config.name)
