"""Analyse one axis, and complete its report."""

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import msgspec

from fltea.identification.about_levels import analyse_series, samples_analysed
from fltea.identification.advice import doubted, expecting_steps
from fltea.identification.allan import allan_of
from fltea.identification.axis import (
    IdentifyOptions,
    described,
    fltea_axis,
)
from fltea.identification.axis_checks import checks_of
from fltea.identification.axis_report import AxisReport
from fltea.identification.conclusions import Conclusions, tracked_of
from fltea.identification.curves import curves
from fltea.identification.data_checks import DataCheck, withheld
from fltea.identification.event_checks import event_checks
from fltea.identification.fltea_fit import FlteaAxis, FlteaFits, fltea_fits
from fltea.identification.left_out import LeftOut
from fltea.identification.load import Series
from fltea.identification.noise_model import modelled
from fltea.identification.reproduction import check_comparable, reproduction
from fltea.identification.sensor_events import AxisEvents
from fltea.identification.slow_noise import with_slow_noise
from fltea.records.fit import Interval

MOST_ANALYSES = 3
"""An axis is analysed at most this many times.

The steps that are found with the first model may be wrong, so the axis is analysed again with the corrected
steps.
"""


class FlteaInput(NamedTuple):
    """The input of FLTEA: an axis after its last analysis."""

    series: Series
    """All samples that were read."""
    left_out: LeftOut
    options: IdentifyOptions
    alpha: Interval
    """Order of the noise according to the verdict; the ends of its interval are null if the noise has no
    order.
    """

    @classmethod
    def of(cls, series: Series, found: AxisReport, options: IdentifyOptions) -> "FlteaInput":
        """Return the input of FLTEA for an axis. `found`: the report of the axis."""
        return cls(series, found.left_out, options, found.result.order.alpha)


def run_fltea(axes: Sequence[FlteaInput], h: float) -> list[FlteaFits]:
    """Run FLTEA over the axes of a recording. `h`: sampling period [s].

    Raises:
        ValueError: the settings give no filter that works.
    """
    own = [samples_analysed(one.series, h, one.left_out) for one in axes]
    return fltea_fits(
        [
            FlteaAxis(y.y, y.gaps, one.options.estimator, y.lsb, one.alpha)
            for y, one in zip(own, axes, strict=True)
        ],
        h,
    )


def concluded(axis: AxisReport, found: Conclusions) -> AxisReport:
    """Return the report of an axis with bias, forecast and filter added."""
    h = 1 / axis.result.rate_hz
    walk = found.tracked.walk
    relaxation = walk.relaxation
    model = msgspec.structs.replace(
        axis.model,
        offset_walk=0.0 if walk.is_found else math.sqrt(walk.endless / h),
        offset_relaxation=None if walk.is_found or relaxation is None else relaxation.part(h),
    )
    result, curve = with_slow_noise(axis.result, axis.allan, found.walk, found.drift_rate, axis.unit)
    return msgspec.structs.replace(
        axis,
        model=model,
        result=result,
        allan=curve,
        tracked=found.tracked,
        walk=found.walk,
        filter=found.filter,
        now=found.now,
        forecast=found.forecast,
    )


def with_events(axis: AxisReport, found: AxisEvents) -> AxisReport:
    """Return the report of an axis with its steps and motion added."""
    is_left_out = axis.left_out.is_like(found.left_out)
    data_checks = (*event_checks(found, axis.unit, is_left_out=is_left_out), *axis.data_checks)
    axis = msgspec.structs.replace(
        axis,
        result=expecting_steps(axis.result, found.steps),
        data_checks=data_checks,
        bias_steps=found.steps,
        motion=found.motion,
        course=found.course,
    )
    if axis.withheld or not (why := withheld(data_checks)):
        return axis
    nothing = dict.fromkeys(("now", "forecast", "filter", "walk", "tracked"))
    return msgspec.structs.replace(axis, withheld=why, result=doubted(axis.result), **nothing)


def examine(
    series: Series,
    h: float,
    options: IdentifyOptions,
    figures: bool,
    known: Sequence[DataCheck] = (),
    left_out: LeftOut | None = None,
    details: bool = True,
) -> AxisReport:
    """Analyse an axis, without FLTEA, bias, forecast and filter.

    Args:
        series: the samples of the axis.
        h: sampling period [s].
        options: how to identify.
        figures: whether to compute the curves that figures show.
        known: data checks of the recording as a whole that concern the axis.
        left_out: steps and motion to leave out. None: the tracker, which finds them, has not run yet; then
            samples that look like motion are left out.
        details: whether to find out where the model reproduces the Allan deviation.

    Raises:
        ValueError: the axis is too short or constant.
    """
    analysis, series, out, telegraph = analyse_series(series, h, options, left_out)
    result = described(analysis)
    # `why_not` also raises an error if FLTEA cannot be run with these samples. It is called even if FLTEA was
    # not asked for, so that a recording is accepted either in both cases or in none.
    why_no_path = fltea_axis(analysis, series.lsb, options).why_not(h)
    model = modelled(analysis.figures.model, result.peaks, result.std, h)
    curve, drawn, reason = None, None, ""
    # The Allan deviation takes as long as the spectrum, so a second thread computes it.
    with ThreadPoolExecutor(1) as in_parallel:
        its_curve = in_parallel.submit(allan_of, analysis, series.unit)
        data_checks = checks_of(analysis, series, result, telegraph)
        why = withheld((*known, *data_checks))
        tracked = None if why else tracked_of(analysis, telegraph)
    try:
        curve = its_curve.result()
        check_comparable(curve, h, model)
        drawn = reproduction(curve, h, model) if details else None
    except ValueError as error:
        reason = str(error)
    if telegraph is not None:
        model = msgspec.structs.replace(model, parts=(*model.parts, telegraph.part))
    return AxisReport(
        series.unit,
        series.lsb,
        doubted(result) if why else result,
        model,
        curve,
        drawn,
        reason,
        data_checks,
        curves=curves(analysis, series.lsb, options, with_path=not why_no_path) if figures else None,
        tracked=tracked,
        left_out=out,
        withheld=why,
    )
