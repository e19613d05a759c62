"""The noise of one axis that is an array."""

from collections.abc import Sequence

import numpy as np
from msgspec.structs import replace
from numpy.typing import ArrayLike

from fltea.api._check import in_python, one_axis, period_s, python_words, scale
from fltea.api.identified import Identified
from fltea.identification.axis import IdentifyOptions, identified, look
from fltea.identification.forecast import Goal
from fltea.identification.judges import judge_one
from fltea.identification.load import Series
from fltea.identification.run import forecasts, traps_of
from fltea.identification.traps import Trap, withheld
from fltea.spectrum.allan_curve import fit_allan
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
    forecast: bool | Goal = False,
) -> Identified:
    """Tell what the noise of one axis of a resting sensor is.

    Args:
        y: samples (n,) without gaps; some ten minutes of them say more than one.
        rate_hz: sample rate in Hz.
        unit: of y, which has to be said: deg/s, rad/s, dps, mdps … or lsb:N (N counts are 1 deg/s) of a
            gyroscope, m/s^2, g, mg … of an accelerometer. All figures are in deg/s or in m/s².
        axis: a name for it.
        lsb: one count in the unit of y, if it is known.
        from_hz: leave out what is slower, in Hz.
        notch_hz: bands (low, high) in Hz that are left out.
        forecast: tell how far the heading is off by time, too, with the second half as judge;
            a `Goal`: and how long to rest for it.

    Raises:
        ValueError: y is not finite, not (n,), constant or too short; no unit, or one that is not known; a
            rate or band that is impossible.
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
        return of_series(axis, series, h, options, forecast=forecast, known=known)


def of_series(
    axis: str,
    series: Series,
    h: float,
    options: IdentifyOptions,
    *,
    forecast: bool | Goal = False,
    known: Sequence[Trap] = (),
) -> Identified:
    """Return the same of an axis of a recording; known: what is wrong with it by the recording as a whole."""
    looked = look(series.y, h, options, series.gaps)
    found = identified(looked, series.lsb, options)
    *sums, samples = looked.summed.octaves.allan(0)
    noise = looked.figures.sentence
    curve = fit_allan(tuple(sums), samples, h, series.unit, noise, found.level.N.value)
    if curve is not None:
        curve = replace(curve, K=found.level.K.value)
    traps = (*known, *traps_of(looked, series, found))
    why = withheld(traps)
    bias, ahead = forecasts(looked, options, series.unit, why, forecast=forecast)
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
        allan=curve,
        spectrum=spectrum_of(looked.summed.lines, noise),
        now=bias,
        forecast=ahead,
        traps=traps,
        withheld=in_python(why),
        details=found,
    )
