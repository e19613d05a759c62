"""The noise of one axis that is an array."""

from collections.abc import Sequence

from msgspec.structs import replace
from numpy.typing import ArrayLike

from fltea.api._check import one_axis, period_s
from fltea.api.identified import Identified
from fltea.identification.axis import IdentifyOptions, identify_axis
from fltea.identification.gaps import bridged
from fltea.identification.load import Series
from fltea.identification.sums import examined_stretches, lines_of_stretches, octaves_of_stretches
from fltea.records.fit import Interval
from fltea.spectrum.fit_allan import fit_allan
from fltea.spectrum.live_axes import spectrum_of
from fltea.spectrum.profile import Parameter


def identify(
    y: ArrayLike,
    rate_hz: float,
    *,
    axis: str = "y",
    unit: str = "deg/s",
    lsb: float | None = None,
    from_hz: float = 0.0,
    notch_hz: Sequence[tuple[float, float]] = (),
) -> Identified:
    """Tell what the noise of one axis of a resting sensor is.

    Args:
        y: samples (n,) without gaps; some ten minutes of them say more than one.
        rate_hz: sample rate in Hz.
        axis: a name for it.
        unit: of y, only to be shown.
        lsb: one count in the unit of y, if it is known.
        from_hz: leave out what is slower, in Hz.
        notch_hz: bands (low, high) in Hz that are left out.

    Raises:
        ValueError: y is not finite, not (n,), constant or too short; a rate or band that is impossible.
    """
    h = period_s(rate_hz)
    options = IdentifyOptions(from_hz=from_hz, notch_hz=tuple((low, high) for low, high in notch_hz))
    return of_series(axis, Series(one_axis(y), unit, lsb), h, options)


def of_series(axis: str, series: Series, h: float, options: IdentifyOptions) -> Identified:
    """Return the same of an axis of a recording."""
    found = identify_axis(series.y, h, series.lsb, options, series.gaps)
    stretches = bridged(series.y, series.gaps)
    seen = examined_stretches(stretches, len(series.y), h, options.from_hz, options.notch_hz)
    octaves = octaves_of_stretches(stretches)
    lines, _ = lines_of_stretches(stretches, octaves, h)
    *sums, samples = octaves.allan(0)
    curve = fit_allan(tuple(sums), samples, h, series.unit, lambda lam: seen.spectrum(lam, h))
    white = found.composite.N
    if curve is not None and white.low is not None and white.high is not None and white.value > 0:
        curve = replace(curve, N=white.value)  # the curve is bent by a filter, and by all else there is
    w = found.whittle
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
        alpha=_interval(w.alpha),
        f=_interval(w.f),
        F=_interval(w.F),
        s2=_interval(w.s2),
        R=_interval(w.R),
        allan=curve,
        spectrum=spectrum_of(lines, seen),
        details=found,
    )


def _interval(p: Parameter) -> Interval:
    return Interval(p.value, p.low, p.high)
