"""Compute bias, forecast and a plain Kalman filter from the model that the tracker uses for an axis.

These conclusions are drawn after all axes of a recording were analysed, since the axes of a sensor may share
one figure for the random walk of the offset.
"""

import contextlib
import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fltea.identification.axis import AxisAnalysis, IdentifyOptions, analyse
from fltea.identification.forecast import Asked, BiasAtEnd, Forecast, Now, found
from fltea.identification.forecast_judge import FittedSystem, fitted_system
from fltea.identification.gaps import bridged, no_gaps
from fltea.identification.load import Series
from fltea.identification.model_file import by_sensor
from fltea.identification.navigation_filter import NavigationFilter, navigation_filter
from fltea.identification.recurring_steps import with_steps
from fltea.identification.sensor_events import BiasStep
from fltea.identification.shared_walk import shared_walk
from fltea.identification.telegraph import Telegraph, without_levels
from fltea.identification.tracked_drift import tracked_drift_rate
from fltea.identification.tracked_system import OffsetWalkFound, offset_walk_found, tracked_system
from fltea.noise.heading import bias_std, rested
from fltea.records.arrays import Array
from fltea.records.fit import Interval
from fltea.settings.live import LiveConfig


class Conclusions(NamedTuple):
    """The conclusions for one axis."""

    tracked: FittedSystem
    walk: OffsetWalkFound
    filter: NavigationFilter | None
    now: Now | None
    forecast: Forecast | None
    drift_rate: Interval
    """Slope of the line fitted to the longest stretch without a break, in the samples' unit per second."""


def tracked_of(analysis: AxisAnalysis, telegraph: Telegraph | None = None) -> FittedSystem | None:
    """Return the tracked system of an axis: the state-space model with which its Kalman filter works.

    The result is None if no Kalman filter works with the noise of the axis.

    `telegraph`: levels that were subtracted before the analysis; the tracked system describes them, too.
    """
    y = max((one.y for one in analysis.stretches), key=len)
    parts = analysis.figures.model.parts(analysis.h)
    found = tracked_system(parts, np.ascontiguousarray(y, dtype=np.float64), analysis.h)
    return found if found is None or telegraph is None else _with_levels(found, telegraph, analysis.h)


def _with_levels(tracked: FittedSystem, telegraph: Telegraph, h: float) -> FittedSystem:
    part = telegraph.part
    its = tracked.system.with_relaxation(part.sigma**2, math.exp(-h / part.tau_s))
    return tracked._replace(parts=(*tracked.parts, part), system=its)


def in_agreement(tracked: Mapping[str, FittedSystem | None], h: float) -> dict[str, FittedSystem]:
    """Return, by axis name, the tracked system (state-space model) with which each axis's filter works.

    The axes of the gyroscope share one size of the offset's random walk, if the data allow it. If the spectra
    already show a walk, they share only its correlation time. So do the axes of the accelerometer.

    An axis for which no Kalman filter works is left out.
    """
    known = {name: one for name, one in tracked.items() if one is not None}
    gyro, accel = by_sensor(known)
    shared = shared_walk(gyro, h) | shared_walk(accel, h)
    return {name: shared[name] for name in known}


def conclude(
    series: Series,
    h: float,
    options: IdentifyOptions,
    tracked: FittedSystem,
    K: Interval,
    forecast: Asked,
    at_end: BiasAtEnd | None = None,
    steps: Sequence[BiasStep] = (),
) -> Conclusions:
    """Return bias and filter of an axis, and its forecast if that is wanted.

    Args:
        series: the samples that were analysed.
        h: sampling period [s].
        options: how to identify.
        tracked: the state-space model with which the bias of the axis is tracked.
        K: K of the noise model; null if the model has no random walk.
        forecast: the forecast that is asked for.
        at_end: the tracker's bias at the end of the recording, if it is known.
        steps: steps of the bias that were found; if there are several, further steps are expected.
    """
    rest, telegraph = without_levels(series, h)
    if telegraph is None:
        tracked = with_steps(tracked, steps, h)
    else:
        at_end = _on_a_level(rest, telegraph, tracked)
    stretches = [np.asarray(one.y, dtype=np.float64) for one in bridged(series.y, series.gaps)]
    y: Array = np.ascontiguousarray(max(stretches, key=len))

    def first(y: NDArray[np.float64]) -> FittedSystem:
        half, levels = without_levels(series._replace(y=y, gaps=no_gaps()), h)
        its = fitted_system(analyse(half.y, h, options).figures.model.parts(h), half.y, h)
        return its if levels is None else _with_levels(its, levels, h)

    bias, ahead = found(tracked, y, h, series.unit, first if forecast else None, forecast, at_end)
    plain = None
    # these errors mean that no Kalman filter works with this system
    with contextlib.suppress(ValueError, ArithmeticError):
        # The filter starts with the bias after the last step, even if only a few samples follow that step.
        newest = stretches[-1] if at_end is not None and at_end.has_stepped else y
        # The filter describes the jumps between the telegraph levels by one of its states. So it starts with
        # the mean of the samples without levels.
        if telegraph is not None:
            newest = max((one.y for one in bridged(rest.y, rest.gaps)), key=len)
        plain = navigation_filter(tracked, np.ascontiguousarray(newest), h)
    drift_rate = tracked_drift_rate(tracked, y, h)
    return Conclusions(tracked, offset_walk_found(tracked, h, K), plain, bias, ahead, drift_rate)


def _on_a_level(rest: Series, telegraph: Telegraph, tracked: FittedSystem) -> BiasAtEnd:
    """Return the bias at the end of a record whose samples jump between levels (telegraph noise).

    The bias depends on the level at the end, since the samples stay at this level for a while.

    `rest`: the samples minus the levels.
    """
    bias_s, samples = LiveConfig().bias_s, len(rest.y)
    std = bias_std(tracked.system, rested(tracked.system, samples))
    return BiasAtEnd(float(rest.y.mean()) + telegraph.ahead(bias_s), std, bias_s, samples)
