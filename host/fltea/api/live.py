"""The daemon's work without it: arrays in as they come, rates less their bias out, and fits on demand."""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fltea.api._check import finite, period_s, scale
from fltea.api._html import axis_html, page
from fltea.api._tables import ByAxis
from fltea.estimator.tracker import EventKind, Rest
from fltea.records.arrays import Array
from fltea.records.fit import AxisFit
from fltea.records.records import AXES
from fltea.settings.estimator import EstimatorConfig
from fltea.settings.live import LiveConfig
from fltea.spectrum.live_axes import LiveAxes
from fltea.stream.happenings import left_out
from fltea.stream.live import NO_FIT
from fltea.stream.tracking import SensorTracks


class Corrected(NamedTuple):
    """What is known of samples with the last of those before them; of their shape, NaN where nothing is yet.

    All are in deg/s, of an accelerometer in m/s².
    """

    rate: Array
    """The samples less their bias."""
    bias: Array
    """The mean that is expected of the sensor's offset and of the state of its noise over the next second."""
    bias_std: Array
    """The standard deviation of the bias, which grows while the sensor moves."""
    moving: NDArray[np.bool_]
    """Whether the sensor is moving; then the bias of all axes is predicted."""


class BiasStep(NamedTuple):
    """A step of a bias."""

    axis: str
    """Of which axis."""
    sample: int
    """The number of the first sample after it, from 0 on."""
    size: float
    """In deg/s or m/s²."""
    size_std: float
    """The standard deviation of the size."""


class LiveReport(ByAxis[AxisFit]):
    """The fits of all axes by name, of as many samples. A notebook shows all axes."""

    def __init__(self, axes: Mapping[str, AxisFit], samples: int, rate_hz: float) -> None:
        super().__init__(axes)
        self.samples = samples
        """How many samples of an axis the fits are of."""
        self.rate_hz = rate_hz
        """How many there are in a second."""

    def __repr__(self) -> str:
        axes = ", ".join(f"{name}: {fit.verdict}" for name, fit in self.items())
        return f"LiveReport({self.samples} samples, {axes})"

    def _repr_html_(self) -> str:
        heading = f"{self.samples:,} samples at {self.rate_hz:g} Hz"
        return "".join(page(axis_html(name, fit, heading)) for name, fit in self.items())


class Live:
    """Takes samples of some axes, tells their bias, and fits their noise when asked, in constant memory.

    What it tells is in deg/s, or in m/s² of an accelerometer, whatever unit the samples are in.

    Args:
        rate_hz: sample rate in Hz.
        axes: their names.
        unit: of the samples, which has to be said; any that `fltea.identify` takes.
        memory: time constant with which older samples are forgotten, such as "10min"; None: nothing is.

    Raises:
        ValueError: an impossible rate or memory; no unit, or one that is not known; no axes, or two of one
            name.
    """

    def __init__(
        self,
        rate_hz: float,
        axes: Sequence[str] = AXES,
        *,
        unit: str | None = None,
        memory: str | None = None,
    ) -> None:
        names = (axes,) if isinstance(axes, str) else tuple(axes)
        if not names or len(set(names)) != len(names):
            raise ValueError(f"axes are one or more names, each of them once, got {names}")
        self.rate_hz = rate_hz
        """Sample rate in Hz."""
        self.axes = names
        """Names of the axes, in the order of their columns."""
        h, of = period_s(rate_hz), scale(unit)
        self.unit = of.unit
        """Of all that is told: deg/s or m/s²."""
        self._factor = of.factor
        settings = LiveConfig(memory=memory)
        self._live = LiveAxes(names, h, settings, self.unit)
        self._tracks = SensorTracks(
            {name: i for i, name in enumerate(names)}, EstimatorConfig(), settings, h, self.unit
        )
        self._taken = 0
        self.steps: list[BiasStep] = []
        """Steps of the biases until now, in the order in which they were found."""
        self._settled = dict.fromkeys(names, NO_FIT)

    @property
    def samples(self) -> int:
        """The number of samples of an axis that were taken."""
        return self._live.samples

    def add(
        self, y: ArrayLike, *, at_rest: bool | None = None, accel_ms2: ArrayLike | None = None
    ) -> Corrected:
        """Take the next samples, (n, axes), or (n,) where there is one axis, and return what they tell.

        The bias goes by the noise that the newest `fit` has found, and by a bank of random walks before it.

        Args:
            y: samples, in the unit of this object.
            at_rest: False where the sensor is known to move: nothing is learnt of these samples. True where
                it is known to be at rest: a rate that lies still elsewhere for ten seconds is then where the
                offset is now, however far that is. None: it is found out.
            accel_ms2: samples of the accelerometer at the same instants, (n, 1 to 3) in m/s². It shows
                motion that a gyroscope does not.

        Raises:
            ValueError: another shape, or values that are not finite; then nothing is taken.
        """
        found = finite(y, "y", "report lost samples by skip(count).")
        if found.ndim == 1 and len(self.axes) == 1:
            found = found[:, None]
        if found.ndim != 2 or found.shape[1] != len(self.axes):
            raise ValueError(
                f"y has a column an axis, (n, {len(self.axes)}) for {', '.join(self.axes)}, "
                f"got shape {found.shape}"
            )
        found = found * self._factor
        if at_rest is not None and at_rest not in (True, False):
            raise ValueError(f"at_rest is True, False, or None where it is not known, got {at_rest!r}")
        rest = Rest.UNKNOWN if at_rest is None else Rest.AT_REST if at_rest else Rest.MOVING
        accel = None if accel_ms2 is None else _accel(accel_ms2, len(found))
        tracked = self._tracks.run(found, accel, rest)
        events = self._tracks.events
        self.steps += [
            BiasStep(self.axes[one.axis], self._taken + one.row + 1 - one.ago, one.size, one.size_std)
            for one in events
            if one.kind == EventKind.STEP
        ]
        self._taken += len(found)
        if len(found) and rest != Rest.MOVING:
            self._live.add(found, left_out(tracked.moving, events))
        elif len(found):
            self._live.skip(len(found))
        rate, bias, std = (
            one.reshape(np.shape(y)) for one in (found - tracked.bias, tracked.bias, tracked.bias_std)
        )
        return Corrected(rate, bias, std, tracked.moving.reshape(np.shape(y)))

    def skip(self, count: int) -> None:
        """Take note of so many lost samples of all axes: nothing is computed across a longer gap.

        Raises:
            ValueError: count is below 1.
        """
        if count < 1:
            raise ValueError(f"count is how many samples are lost, 1 or more, got {count}")
        self._live.skip(count)
        self._tracks.skip(count)
        self._taken += count

    def fit(self, *, curves: bool = True, last: bool = False) -> LiveReport:
        """Return what the noise is, by all samples so far.

        Args:
            curves: with spectrum and Allan deviation.
            last: the record is at its end and this is the only look at it. Looks while it grows are judged
                more strictly, so that all of them together give few false alarms.
        """
        found: dict[str, AxisFit] = {}
        for axis, look in self._live.look(curves=curves, last=last).items():
            looked = look()
            found[axis] = looked.fit
            self._settled[axis] = self._settled[axis].followed_by(looked, self._tracks.learner(axis))
            self._tracks.go_by(axis, self._settled[axis])
        return LiveReport(found, self.samples, self.rate_hz)

    def heading_std(self, t_s: float) -> dict[str, float]:
        """Return, by axis, the standard deviation of the integral of `Corrected.rate` from rest to t_s later.

        The rest is as long as the record of the newest fit; NaN before one that says what the noise is.

        Raises:
            ValueError: t_s is not positive.
        """
        if not 0 < t_s < math.inf:
            raise ValueError(f"t_s is a time after the rest in s, above 0, got {t_s}")
        return {axis: self._tracks.heading_std(axis, t_s) for axis in self.axes}


def _accel(accel_ms2: ArrayLike, n: int) -> Array:
    """Return samples of the accelerometer, (n, 1 to 3); ValueError for another shape."""
    found = finite(accel_ms2, "accel_ms2", "leave it out where it is not known.")
    found = found[:, None] if found.ndim == 1 else found
    if found.ndim != 2 or len(found) != n or not 1 <= found.shape[1] <= 3:
        raise ValueError(
            f"accel_ms2 has a row for each of y, (n, 1 to 3), got shape {found.shape} for {n} samples"
        )
    return found
