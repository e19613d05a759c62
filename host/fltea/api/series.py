"""Identify the noise of one axis given as an array."""

import contextlib
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from fltea.api._check import in_python, one_axis, period_s, python_words, scale
from fltea.api.identified import Identified
from fltea.identification.about_levels import analyse_series
from fltea.identification.advice import doubted, expecting_steps
from fltea.identification.allan import allan_of
from fltea.identification.axis import (
    AxisAnalysis,
    AxisResult,
    IdentifyOptions,
    described,
    fltea_axis,
    with_fltea,
)
from fltea.identification.axis_checks import checks_of
from fltea.identification.conclusions import conclude, in_agreement, tracked_of
from fltea.identification.data_checks import DataCheck, withheld
from fltea.identification.event_checks import event_checks
from fltea.identification.fltea_fit import fltea_fits
from fltea.identification.forecast import Asked
from fltea.identification.forecast_judge import FittedSystem
from fltea.identification.judges import judge_one
from fltea.identification.left_out import LeftOut
from fltea.identification.load import Series
from fltea.identification.one_axis import MOST_ANALYSES
from fltea.identification.sensor_events import AxisEvents, watch
from fltea.identification.slow_noise import with_slow_noise
from fltea.records.arrays import Array
from fltea.settings.live import LiveConfig
from fltea.spectrum.live_axes import spectrum_of


def identify(
    y: ArrayLike,
    rate_hz: float,
    *,
    unit: str | None = None,
    axis: str = "y",
    lsb: float | None = None,
    from_hz: float = 0.0,
    notch_hz: Sequence[tuple[float, float]] = (),
    forecast: Asked = False,
) -> Identified:
    """Identify the noise of one axis of a resting sensor.

    Args:
        y: samples (n,) without gaps; ten minutes of samples tell much more than one.
        rate_hz: sampling rate in Hz.
        unit: unit of y, required: deg/s, rad/s, dps, mdps … or lsb:N (N counts are 1 deg/s) for a gyroscope;
            m/s^2, g, mg … for an accelerometer. All figures are in deg/s or in m/s².
        axis: a name for the axis.
        lsb: size of one count in the unit of y, if known.
        from_hz: lowest frequency in use, in Hz.
        notch_hz: bands (low, high) in Hz that are left out.
        forecast: True: forecast the error of the heading, and check it on the record's second half. A `Goal`
            also asks how long the sensor has to rest, a `Drive` how long the heading is good after a rest. A
            list may hold several of both.

    Raises:
        ValueError: y is not finite, not (n,), constant or too short; the unit is missing or not known; the
            rate or a band is impossible.
    """
    h = period_s(rate_hz)
    options = IdentifyOptions(from_hz=from_hz, notch_hz=tuple((low, high) for low, high in notch_hz))
    samples = one_axis(y)
    of = scale(unit, samples, rate_hz)
    if lsb is None and of.counts and (samples == np.rint(samples)).all():
        lsb = 1.0
    series = Series(samples * of.factor, of.unit, None if lsb is None else lsb * of.factor)
    known = tuple(judge_one(series.y, series.unit, series.lsb, h))
    with python_words():
        first = {axis: examine(series, h, options, known)}
        (watched,) = watched_looks({axis: series}, (), first, h, options).values()
        return of_series(axis, watched, options, watched.examined.tracked, forecast=forecast)


class Examined(NamedTuple):
    """The analysis of one axis's noise. The axis's bias, forecast and filter are computed later."""

    series: Series
    analysis: AxisAnalysis
    found: AxisResult
    data_checks: tuple[DataCheck, ...]
    why: str
    tracked: FittedSystem | None
    known: Sequence[DataCheck]
    left_out: LeftOut


class Watched(NamedTuple):
    """An analysed axis, and the steps and motion that the analysis left out."""

    examined: Examined
    events: AxisEvents


def watched_looks(
    axes: Mapping[str, Series],
    accel: Sequence[Array],
    examined: Mapping[str, Examined],
    h: float,
    options: IdentifyOptions,
) -> dict[str, Watched]:
    """Find the steps and motion of each axis, and add FLTEA's estimates.

    The axes are analysed again without their steps and motion.
    """
    last = dict(examined)
    for _ in range(1, MOST_ANALYSES):
        events = watch(axes, accel, agreed(last, h), h, LiveConfig())
        again = [name for name, one in last.items() if not events[name].left_out.is_like(one.left_out)]
        if not again:
            break
        for name in again:
            # ValueError means that too few samples are left. Then the axis keeps the result of its last
            # analysis.
            with contextlib.suppress(ValueError):
                last[name] = examine(axes[name], h, options, last[name].known, events[name].left_out)
    fits = fltea_fits([fltea_axis(one.analysis, one.series.lsb, options) for one in last.values()], h)
    for (name, one), its in zip(last.items(), fits, strict=True):
        last[name] = one._replace(found=with_fltea(one.found, its))
    return {name: Watched(one, events[name]) for name, one in last.items()}


def agreed(examined: Mapping[str, Examined], h: float) -> dict[str, FittedSystem]:
    """Return, by axis name, the state-space model with which the bias of each axis is tracked.

    In the models of one sensor's axes, the offset's random walk has the same size, if the data allow it.
    """
    return in_agreement({name: one.tracked for name, one in examined.items()}, h)


def examine(
    series: Series,
    h: float,
    options: IdentifyOptions,
    known: Sequence[DataCheck] = (),
    left_out: LeftOut | None = None,
) -> Examined:
    """Analyse an axis.

    Args:
        series: the samples of the axis.
        h: sampling period [s].
        options: how to identify.
        known: findings about the whole recording that concern the axis.
        left_out: steps and motion that the tracker has found, to be left out. None: the tracker has not run
            yet; then samples that look like motion are left out.
    """
    analysis, series, out, telegraph = analyse_series(series, h, options, left_out)
    fltea_axis(analysis, series.lsb, options).why_not(h)
    found = described(analysis)
    data_checks = (*known, *checks_of(analysis, series, found, telegraph))
    why = withheld(data_checks)
    tracked = None if why else tracked_of(analysis, telegraph)
    return Examined(series, analysis, found, data_checks, why, tracked, known, out)


def of_series(
    axis: str,
    watched: Watched,
    options: IdentifyOptions,
    tracked: FittedSystem | None,
    *,
    forecast: Asked = False,
) -> Identified:
    """Return the results for an axis with its steps and motion.

    `tracked`: the axis's tracked system, which is the state-space model with which its Kalman filter works.
    """
    (series, analysis, found, data_checks, _, _, _, out), events = watched
    is_left_out = out.is_like(events.left_out)
    data_checks = (*event_checks(events, series.unit, is_left_out=is_left_out), *data_checks)
    if why := withheld(data_checks):
        tracked, found = None, doubted(found)
    h = analysis.h
    curve = None
    with contextlib.suppress(ValueError):  # ValueError: every stretch is too short for an Allan deviation
        curve = allan_of(analysis, series.unit)
    follows = tracked and conclude(
        series, h, options, tracked, found.level.K, forecast, events.at_end, events.steps
    )
    if follows is not None:
        found, curve = with_slow_noise(found, curve, follows.walk, follows.drift_rate, series.unit)
    found = found if why else expecting_steps(found, events.steps)
    return Identified(
        axis=axis,
        unit=series.unit,
        samples=found.samples,
        rate_hz=found.rate_hz,
        mean=found.mean,
        std=found.std,
        verdict=found.verdict.kind,
        text=found.verdict.text,
        null_p=found.null.p_value,
        alpha=found.order.alpha,
        f=found.order.f,
        F=found.order.F,
        s2=found.order.s2,
        R=found.order.R,
        odds=found.verdict.odds,
        allan=None if curve is None else curve.of_fit,
        allan_curve=curve,
        spectrum=spectrum_of(analysis.summed.lines, analysis.figures.model),
        now=follows and follows.now,
        forecast=follows and follows.forecast,
        walk=follows and follows.walk,
        filter=follows and follows.filter,
        bias_steps=events.steps,
        motion=events.motion,
        data_checks=data_checks,
        withheld=in_python(why),
        details=found,
    )
