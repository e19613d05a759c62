"""Do the daemon's work in Python, sample by sample.

The caller passes samples as they come, and gets rates minus their bias. The noise is fitted on demand.
"""

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
    """Bias and rate for given samples, estimated from these and all earlier samples.

    Arrays have the shape of the samples. Rates and biases are NaN until the bias is known. They are in deg/s,
    or m/s² for an accelerometer.
    """

    rate: Array
    """The samples minus their bias."""
    bias: Array
    """Expected mean, over the next second, of the sensor's offset plus its slow noise."""
    bias_std: Array
    """Standard deviation of the bias's error. It grows while the sensor moves."""
    moving: NDArray[np.bool_]
    """Whether the sensor is moving. While it moves, the biases of all axes are only predicted; the samples do
    not correct them.
    """


class BiasStep(NamedTuple):
    """A step (sudden change) of the bias of one axis."""

    axis: str
    """Name of the axis."""
    sample: int
    """Index of the first sample after the step, counted from 0."""
    size: float
    """Size of the step, in deg/s or m/s²."""
    size_std: float
    """Standard deviation of the size."""


class LiveReport(ByAxis[AxisFit]):
    """The fits of all axes to the same samples: a mapping from the name of each axis to its fit.

    A notebook shows all axes.
    """

    def __init__(self, axes: Mapping[str, AxisFit], samples: int, rate_hz: float) -> None:
        super().__init__(axes)
        self.samples = samples
        """Number of samples of each axis in the fits."""
        self.rate_hz = rate_hz
        """Sampling rate [Hz]."""

    def __repr__(self) -> str:
        axes = ", ".join(f"{name}: {fit.verdict}" for name, fit in self.items())
        return f"LiveReport({self.samples} samples, {axes})"

    def _repr_html_(self) -> str:
        heading = f"{self.samples:,} samples at {self.rate_hz:g} Hz"
        return "".join(page(axis_html(name, fit, heading)) for name, fit in self.items())


class Live:
    """Take samples of some axes, return their bias, and fit their noise on demand, in constant memory.

    All results are in deg/s, or in m/s² for an accelerometer, whatever the unit of the samples.

    Args:
        rate_hz: sampling rate in Hz.
        axes: names of the axes.
        unit: unit of the samples, required; any unit that `fltea.identify` takes.
        memory: time constant with which older samples are forgotten, such as "10min"; None: no sample is
            forgotten.

    Raises:
        ValueError: the rate or the memory is impossible; the unit is missing or not known; there are no axes,
            or two with the same name.
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
            raise ValueError(f"axes must be one or more different names, got {names}")
        self.rate_hz = rate_hz
        """Sampling rate in Hz."""
        self.axes = names
        """Names of the axes, in the order of their columns."""
        h, of = period_s(rate_hz), scale(unit)
        self.unit = of.unit
        """Unit of all results: deg/s or m/s²."""
        self._factor = of.factor
        settings = LiveConfig(memory=memory)
        self._live = LiveAxes(names, h, settings, self.unit)
        self._tracks = SensorTracks(
            {name: i for i, name in enumerate(names)}, EstimatorConfig(), settings, h, self.unit
        )
        self._taken = 0
        self.steps: list[BiasStep] = []
        """Steps of the biases up to now, in the order of their detection."""
        self._settled = dict.fromkeys(names, NO_FIT)

    @property
    def samples(self) -> int:
        """Number of samples of each axis up to now."""
        return self._live.samples

    def add(
        self, y: ArrayLike, *, at_rest: bool | None = None, accel_ms2: ArrayLike | None = None
    ) -> Corrected:
        """Take the next samples, (n, axes), or (n,) for a single axis, and return their rates and biases.

        The bias is estimated with the noise model of the newest `fit`. Before the first fit, several simple
        models are used instead: random walks and relaxations (first-order Gauss-Markov processes).

        Args:
            y: samples, in the unit of this object.
            at_rest: False: the sensor is known to move, so these samples are not used for the bias. True: it
                is known to be at rest; a rate that is steady at another value for ten seconds is then the new
                offset, however far away. None: rest and motion are detected.
            accel_ms2: samples of the accelerometer at the same times, (n, 1 to 3) in m/s². It shows motion
                that a gyroscope does not show.

        Raises:
            ValueError: the shape is wrong, or values are not finite. In that case no sample is used.
        """
        found = finite(y, "y", "report lost samples by skip(count).")
        if found.ndim == 1 and len(self.axes) == 1:
            found = found[:, None]
        if found.ndim != 2 or found.shape[1] != len(self.axes):
            raise ValueError(
                f"y must have one column for each axis, (n, {len(self.axes)}) for "
                f"{', '.join(self.axes)}, got shape {found.shape}"
            )
        found = found * self._factor
        if at_rest is not None and at_rest not in (True, False):
            raise ValueError(f"at_rest must be True, False, or None (not known), got {at_rest!r}")
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
        """Report that `count` samples of all axes were lost. Nothing is computed across a long gap.

        Raises:
            ValueError: count is below 1.
        """
        if count < 1:
            raise ValueError(f"count must be the number of lost samples, 1 or more, got {count}")
        self._live.skip(count)
        self._tracks.skip(count)
        self._taken += count

    def fit(self, *, curves: bool = True, last: bool = False) -> LiveReport:
        """Fit the noise of all samples up to now.

        Args:
            curves: whether the result includes spectrum and Allan deviation.
            last: whether the record has ended and this is its only fit. The verdicts on fits of a growing
                record are stricter, so that all of them together give few false alarms.
        """
        found: dict[str, AxisFit] = {}
        for axis, model_search in self._live.refits(curves=curves, last=last).items():
            fitted = model_search()
            found[axis] = fitted.fit
            self._settled[axis] = self._settled[axis].followed_by(fitted, self._tracks.maker(axis))
            self._tracks.use_model(axis, self._settled[axis])
        return LiveReport(found, self.samples, self.rate_hz)

    def heading_std(self, t_s: float) -> dict[str, float]:
        """Return, by axis name, the standard deviation of the heading's error `t_s` seconds after a rest.

        The heading is the integral of `Corrected.rate` over the `t_s` seconds that follow the rest.

        The rest is assumed to last as long as the record of the newest fit. The result is NaN before the
        first fit that finds a noise model.

        Raises:
            ValueError: t_s is not positive.
        """
        if not 0 < t_s < math.inf:
            raise ValueError(f"t_s must be a time after the rest in s, above 0, got {t_s}")
        return {axis: self._tracks.heading_std(axis, t_s) for axis in self.axes}


def _accel(accel_ms2: ArrayLike, n: int) -> Array:
    """Return samples of the accelerometer, (n, 1 to 3); ValueError for another shape."""
    found = finite(accel_ms2, "accel_ms2", "leave out accel_ms2 for samples for which it is not known.")
    found = found[:, None] if found.ndim == 1 else found
    if found.ndim != 2 or len(found) != n or not 1 <= found.shape[1] <= 3:
        raise ValueError(
            f"accel_ms2 must have one row for each row of y, shape (n, 1 to 3), "
            f"got shape {found.shape} for {n} samples"
        )
    return found
