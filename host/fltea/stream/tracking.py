"""Estimate the present bias of each axis with the noise model of the live fit.

The bias is estimated from the first sample on. At first the tracker uses a bank of random-walk models. The
noise model of a fit replaces the bank as soon as that model is far likelier than the bank or the fit has
3,000 samples.
"""

import contextlib
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from fltea.estimator.tracker import Checked, Remembered, Rest, Tracker, TrackerEvent, TrackerRules
from fltea.records.arrays import Array, Mask
from fltea.records.block import TrackedColumns
from fltea.records.fit import Interval
from fltea.records.records import GYRO_UNIT
from fltea.records.stats import BiasCheck, TrackerStats
from fltea.settings.estimator import EstimatorConfig
from fltea.settings.live import LiveConfig
from fltea.spectrum.innovation_whiteness import describes
from fltea.spectrum.live_axes import LONGEST_MOTION_S
from fltea.stream.live import AcceptedFit
from fltea.stream.tracked_models import TrackedModel, TrackedModelMaker

UNDEFINED = Interval()
CHECKED_S = 1, 10, 60
"""To check the standard deviation that the tracker states for a bias, the bias is compared with the mean of
the samples that follow. These are the durations over which such means are taken [s].
"""
STILL_S = 10.0
"""If a tilted accelerometer shows another value for this time [s], the tracker takes it as the new offset.
For a gyroscope this holds only if its rest is known or the new value is nearer to 0 (see `TrackerRules`).
"""


def rules_of(live: LiveConfig, h: float, unit: str) -> TrackerRules:
    """Return the settings of a sensor's tracker, with times in samples; `h`: sampling period [s]."""
    is_gyro = unit == GYRO_UNIT
    return TrackerRules(
        ahead=max(round(live.bias_s / h), 1),
        checked=tuple(max(round(t_s / h), 1) for t_s in CHECKED_S),
        largest_step=live.largest_step_dps if is_gyro else live.largest_step_ms2,
        largest_gravity_step=live.largest_step_ms2,
        still=max(round(STILL_S / h), 1),
        patience=max(round(LONGEST_MOTION_S / h), 1),
        settles=not is_gyro,  # an accelerometer whose samples stay at a new value was tilted
    )


class SensorTracks:
    """Tracks the biases of one sensor.

    `axes`: for the name of each axis, the index of its column in the samples. `h`: sampling period [s].
    """

    def __init__(
        self, axes: Mapping[str, int], config: EstimatorConfig, live: LiveConfig, h: float, unit: str
    ) -> None:
        self.names, self.places, self.h, self.unit = tuple(axes), list(axes.values()), h, unit
        self._known: dict[str, AcceptedFit] = {}
        self._offsets = _offsets(config, len(self.names))
        self._bias_s = live.bias_s
        self.tracker = Tracker(self._offsets, rules_of(live, h, unit))
        self.words = self._words()
        """The verdict, alpha and f of each axis. They are the same in the records of all samples until the
        next fit.
        """
        self._tracked_models: dict[str, TrackedModel] = {}

    def run(self, values: Array, accel: Array | None = None, rest: Rest = Rest.UNKNOWN) -> TrackedColumns:
        """Track the biases over samples (n, columns), and return the trackers' results.

        After the call, `events` has the steps of biases and the motions that were found in these samples.

        `accel`: simultaneous samples of the accelerometer, (n, 1 to 3) [m/s²].
        """
        own = values if len(self.places) == values.shape[1] else values[:, self.places]
        return self.columns(self.tracker.run(own, accel, rest))

    @property
    def events(self) -> list[TrackerEvent]:
        """Steps of biases and motions that the last call of `run` found in its samples."""
        return self.tracker.events

    def columns(self, found: Sequence[Array | Mask]) -> TrackedColumns:
        """Return the results of the native tracker for a block of samples as named columns.

        `found`: the arrays that the native tracker has written.
        """
        return TrackedColumns._make((self.names, self.unit, *found, *self.words))

    def _words(self) -> tuple[tuple[Any, ...], ...]:
        stands = [self._known[axis].stands if axis in self._known else None for axis in self.names]
        return (
            tuple(fit.verdict if fit else None for fit in stands),
            tuple(fit.alpha if fit else UNDEFINED for fit in stands),
            tuple(fit.f if fit else UNDEFINED for fit in stands),
        )

    def knows(self, axis: str, accepted: AcceptedFit) -> bool:
        """Return whether this tracker already uses the fit `accepted` of the axis."""
        return accepted is self._known.get(axis)

    def skip(self, count: int) -> None:
        """Let the trackers predict `count` lost samples."""
        self.tracker.skip(count)

    def maker(self, axis: str) -> TrackedModelMaker:
        """Return an object that makes the tracker model of an axis from a fit, for `AcceptedFit.followed_by`.

        The object uses those samples that the axis's tracker remembers at the time of this call.
        """
        given = self._offsets[self.names.index(axis)] is not None
        return TrackedModelMaker(self.remembered(axis), self.tracker.rules, self.h, self.unit, given)

    def remembered(self, axis: str) -> Remembered:
        """Return the samples of an axis that the tracker remembers."""
        return self.tracker.remembered(self.names.index(axis))

    def use_model(self, axis: str, accepted: AcceptedFit) -> None:
        """Use the noise model of an accepted fit for an axis from now on, if the fit is new."""
        if self.knows(axis, accepted):
            return
        self._known[axis] = accepted
        self.words = self._words()
        tracked_model = accepted.tracked_model
        if tracked_model is None or tracked_model is self._tracked_models.get(axis):
            return
        # if no filter works with this model, the previous model stays in use
        with contextlib.suppress(ValueError):
            self.tracker.use_model(self.names.index(axis), tracked_model.tracker_model)
            self._tracked_models[axis] = tracked_model

    def heading_std(self, axis: str, t_s: float) -> float:
        """Return the standard deviation of an axis's heading error `t_s` seconds after the end of a rest.

        For a sensor that measures no rate, return the standard deviation of the error of the samples'
        integral. Return NaN before the first fit of the axis.
        """
        return self._tracked_models[axis].heading_std(t_s) if axis in self._tracked_models else math.nan

    def stats(self) -> Iterator[tuple[str, TrackerStats]]:
        """Yield the statistics of each axis's tracker."""
        for axis, figures in zip(self.names, self.tracker.figures(), strict=True):
            holds = None if figures.ljung_box is None else describes(figures.innovations, figures.ljung_box)
            words, K, headings = "walks", UNDEFINED, dict[int, float]()
            if (tracked_model := self._tracked_models.get(axis)) is not None:
                words, K, headings = tracked_model.model, tracked_model.K, tracked_model.headings
            yield (
                axis,
                TrackerStats(
                    model=words,
                    nis=figures.nis,
                    lag1=figures.lag1,
                    holds=holds,
                    moved=figures.moved,
                    restarts=figures.begun,
                    K=K,
                    heading_std=headings,
                    bias=figures.bias,
                    bias_std=figures.bias_std,
                    steps=figures.steps,
                    moving=self.tracker.moving,
                    checked=_checks(figures.checked),
                    bias_for_s=self._bias_s,
                ),
            )

    def save(self) -> bytes:
        """Return the state of the trackers as bytes, from which `load` can continue."""
        return self.tracker.save()

    def load(self, saved: bytes) -> None:
        """Continue from a saved state; ValueError if the state is not valid."""
        self.tracker.load(saved)


def _checks(checked: Sequence[Checked]) -> dict[int, BiasCheck]:
    """Return how far the bias was from the mean of the samples that followed, as multiples of its own σ.

    The result has an entry for each duration in `CHECKED_S` [s] over which such a mean is complete.
    """
    found = zip(CHECKED_S, checked, strict=True)
    return {t_s: BiasCheck(one.pieces, one.rms) for t_s, one in found if one.rms is not None}


def _offsets(config: EstimatorConfig, axes: int) -> list[float | None]:
    """Return the known offset of each axis in the settings; None for an axis without one."""
    bias = config.bias
    if isinstance(bias, str):
        return [None] * axes
    return list(bias) if isinstance(bias, list) else [bias] * axes
