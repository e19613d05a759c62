"""Draw the pictures of one axis as SVG."""

import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from fltea.documents.chart import NO_BANDS, Bands, Curve, chart, log_log
from fltea.documents.chart_scales import Axis
from fltea.documents.curves import allan_labels, coefficients, density_label
from fltea.identification.axis_report import AxisReport
from fltea.identification.curves import Curves, Path
from fltea.identification.forecast import integral, is_any_heading
from fltea.noise.parts import spectrum
from fltea.records.arrays import Array
from fltea.records.fit import Interval
from fltea.records.plus_minus import NORMAL_95
from fltea.records.quantity import coefficient_units, quantity_of, shown_units
from fltea.records.units import MOST_DEG
from fltea.spectrum.intervals import CRITICAL

HIGHEST_DEVIANCE = 20.0
MODELS = {"order": "model", "plain": "rival", "white": "white"}
"""The line style in which each model's spectrum is drawn.

Dashed curves are drawn over solid ones, so that both are visible where models agree.
"""
MODEL_POINTS = 300
SETTLED = 3.0
"""The picture of the bias over time need not show points with a large σ. The limits of its y axis are chosen
for the points whose σ is at most this many times the median σ.
"""

Ends = tuple[float, float]


def draw(name: str, axis: AxisReport) -> dict[str, str]:
    """Return the pictures of the axis `name` by their keys in `TITLES`, as far as they can be drawn."""
    assert axis.curves is not None
    drawn = {
        kind: paint(f"{name}: {TITLES[kind][0]}", axis, axis.curves) for kind, paint in _PAINTERS.items()
    }
    return {kind: svg for kind, svg in drawn.items() if svg}


def meaning(kind: str, axis: AxisReport) -> str:
    """Return a text that says how to read the picture of the kind `kind` of this axis."""
    text = TITLES[kind][1]
    if kind == "forecast" and axis.forecast is not None:
        rest_s = axis.forecast.after_s
        text = text.format(rest=_rest(rest_s), half=_rest(rest_s / 2))
    return text


def _rest(seconds: float) -> str:
    """Format a duration with three digits.

    One sentence shows a duration and its half, which must not look equal.
    """
    limits = ((600, 1, "s"), (7200, 60, "min"), (math.inf, 3600, "h"))
    size, unit = next((size, unit) for limit, size, unit in limits if seconds < limit)
    return f"{seconds / size:.3g} {unit}"


def _spectrum(title: str, axis: AxisReport, curves: Curves) -> str:
    s, r = curves.spectrum, axis.result
    density = 2 / r.rate_hz  # one-sided density of white noise of variance 1
    hz = np.geomspace(s.hz[0], s.hz[-1], MODEL_POINTS)
    lam = 2 * np.pi * hz / r.rate_hz
    shown = [Curve(s.hz, np.sqrt(density * s.power), "points", label="periodogram, in bins")]
    for name, style in MODELS.items():
        if (one := r.models.get(name)) is None:
            continue
        label = f"{one.name}, BIC {one.bic:+.1f}" + (": the verdict" if name == r.stands else "")
        power = density * spectrum(one.parts, lam, 1 / r.rate_hz)
        shown.append(Curve(hz, np.sqrt(power), style, label=label))
    ends = s.hz[0] * 0.9, s.hz[-1] * 1.1
    bands = [band for band in [(0.0, r.band.from_hz), *r.band.notch_hz] if band[1] > s.hz[0]]
    return chart(
        title,
        Axis("frequency [Hz]", is_log=True, ends=ends),
        Axis(density_label(axis.unit), is_log=True),
        shown,
        Bands(bands, "not fitted"),
    )


def _profile(title: str, axis: AxisReport, curves: Curves) -> str:
    alpha = axis.result.order.alpha
    last = float(curves.orders[-1])
    ends = -0.2, max(6.0, min(HIGHEST_DEVIANCE, float(curves.deviance.max()) * 1.05))
    shown = [
        Curve(curves.orders, curves.deviance, "model", label="the best fit with this order"),
        Curve([0.0, last], [CRITICAL] * 2, "limit", label="95 %"),
    ]
    bands = NO_BANDS
    if alpha.value is not None and alpha.low is not None and alpha.high is not None:
        label = f"α = {alpha.value:.2f} ({alpha.low:.2f} … {alpha.high:.2f})"
        shown.append(Curve([alpha.value] * 2, ends, "data", label=label))
        bands = Bands([(alpha.low, alpha.high)], "its 95 %")
    else:
        title = f"{title.partition(':')[0]}: α is undefined, the verdict is {axis.result.verdict.kind}"
    x_axis = Axis("order α held at", ends=(0.0, last))
    return chart(title, x_axis, Axis("2 log L below the best with an order", ends=ends), shown, bands)


def _alpha(title: str, axis: AxisReport, curves: Curves) -> str:
    p, shuffled = curves.path, axis.result.null.shuffled
    if p is None:
        return ""
    at_end = shuffled.alpha if shuffled else None
    return _over_time(title, axis, p, "order α", (p.alpha, p.alpha_std, p.white_alpha), at_end)


def _f(title: str, axis: AxisReport, curves: Curves) -> str:
    p, shuffled = curves.path, axis.result.null.shuffled
    if p is None:
        return ""
    at_end = shuffled.f if shuffled else None
    return _over_time(title, axis, p, "parameter f [s^−α]", (p.f, p.f_std, p.white_f), at_end)


def _over_time(
    title: str,
    axis: AxisReport,
    p: Path,
    y_label: str,
    found: tuple[Array, Array, Array],
    at_end: tuple[float, float, float] | None,
) -> str:
    """Draw FLTEA's estimates of α or f over time.

    Args:
        title: heading of the chart.
        axis: the report of the axis.
        p: the estimates over time; the times and the number of shuffled copies are taken from it.
        y_label: what is estimated.
        found: three arrays: the estimates, their σ, and the quantiles of the estimates for shuffled copies.
        at_end: quantiles of the estimates for shuffled copies at the end of the record: low, middle, high.
    """
    fit, shuffled = axis.result.fltea, axis.result.null.shuffled
    assert fit is not None
    value, std, white = found
    half = NORMAL_95 * std
    shown = [Curve(p.t_s, value, "own", value - half, value + half, label=f"FLTEA {fit.variant}, 95 %")]
    if p.copies:
        label = f"white noise gives (5–95 % of {p.copies} copies)"
        shown.append(Curve(p.t_s, white[:, 1], "grey", white[:, 0], white[:, 2], label=label))
    end_s = float(p.t_s[-1])
    if shuffled and at_end:
        low, middle, high = at_end
        label = f"{shuffled.copies} shuffled copies, at the end"
        shown.append(Curve([end_s * 1.02] * 2, [low, high], "bar", label=label))
        shown.append(Curve([end_s * 1.02], [middle], "points"))
    x_axis = Axis("time [s]", ends=(0.0, end_s * 1.05))
    return chart(title, x_axis, Axis(y_label, ends=_limits(value, white)), shown)


def _limits(value: Array, white: Array) -> Ends:
    """Return the limits of the y axis.

    The first tenth of the record is ignored, since the estimates still change much during it.
    """
    late = slice(len(value) // 10, None)
    known = np.concatenate([value[late], white[late].ravel()])
    known = known[np.isfinite(known)]
    if not known.size:
        return -1.0, 1.0
    low, high = float(known.min()), float(known.max())
    margin = 0.25 * (high - low) or 0.1
    return low - margin, high + margin


def _allan(title: str, axis: AxisReport, curves: Curves) -> str:
    a = axis.allan
    if a is None:
        return ""
    shown = [Curve(a.tau_s, a.deviation, "data", a.low, a.high, label="of the samples, 95 %")]
    if (made := axis.reproduction) is not None:
        data = np.array(a.deviation)
        low, middle, high = (data * np.array(ratio) for ratio in (made.low, made.ratio, made.high))
        label = f"noise of the model ({axis.result.made_of})"
        shown.append(Curve(a.tau_s, middle, "rival", low, high, label=label))
    labels = {
        name: f"{name} = {quantity_of(Interval(value), own).to(shown)}"
        for name, own, shown in zip("NBK", coefficient_units(axis.unit), shown_units(axis.unit), strict=True)
        if (value := getattr(a, name).value) is not None
    }
    shown += coefficients(a.of_fit, labels)
    x_label, y_label = allan_labels(axis.unit)
    ends = min(a.low) / 1.6, max(a.high) * 1.6
    return chart(title, Axis(x_label, is_log=True), Axis(y_label, is_log=True, ends=ends), shown)


def _forecast(title: str, axis: AxisReport, curves: Curves) -> str:
    f = axis.forecast
    if f is None:
        return ""
    shown = [Curve(f.t_s, f.heading_std, "own", label="from the end of the recording")]
    if is_any_heading(max(f.heading_std), axis.unit):
        ends = [f.t_s[0], f.t_s[-1]]
        shown.append(Curve(ends, [MOST_DEG] * 2, "limit", label="no heading is left above"))
    if f.judged:
        t, said, seen, count = np.array([(p.t_s, p.said, p.seen, p.pieces) for p in f.judged]).T
        # 95 % limits of a root mean square over `count` values, by Wilson & Hilferty (1931).
        middle, spread = 1 - 2 / (9 * count), NORMAL_95 * np.sqrt(2 / (9 * count))
        low, high = (said * np.maximum(middle + way * spread, 0) ** 1.5 for way in (-1, 1))
        # The lower end may be 0 if the root mean square is over one or two values. A logarithmic scale cannot
        # show 0.
        low = np.maximum(low, 1e-3 * said)
        shown += [
            Curve(t, said, "rival", label="predicted by the first half"),
            Curve(t, (), "grey", low, high, label="95 % of what is seen"),
            Curve(t, seen, "points", label="seen in the second half"),
        ]
    y_label = f"heading, σ [{integral(axis.unit).strip()}]"
    return log_log(title, "time after rest [s]", y_label, shown)


def _bias(title: str, axis: AxisReport, curves: Curves) -> str:
    c = axis.course
    if c is None:
        return ""
    low, high = c.bias - NORMAL_95 * c.bias_std, c.bias + NORMAL_95 * c.bias_std
    name = f"Bias({axis.now.bias_s:g} s)" if axis.now else "bias"
    shown = [Curve(c.t_s, c.bias, "own", low, high, label=f"{name}, 95 %")]
    ends = None
    known = np.isfinite(high - low)
    if known.any():
        usual = float(np.median(c.bias_std[known]))
        # The limits of the y axis ignore times at which the bias has a large σ: at the beginning, and after a
        # step.
        accepted = c.bias[known & (c.bias_std <= SETTLED * usual)]
        bottom, top = float(accepted.min()), float(accepted.max())
        margin = 4 * usual + 0.1 * (top - bottom)
        ends = bottom - margin, top + margin
        shown += _marks([step.at_s for step in axis.bias_steps], ends, "step")
    motion = Bands([(one.begin_s, one.end_s) for one in axis.motion], "motion")
    return chart(title, Axis("time [s]"), Axis(f"bias [{axis.unit}]", ends=ends), shown, motion)


def _marks(at: Sequence[float], ends: Ends, label: str) -> Iterator[Curve]:
    """Yield vertical lines over the full height of the picture, with one common entry in the legend."""
    for number, where in enumerate(at):
        yield Curve([where] * 2, ends, "step", label="" if number else label)


def _innovations(title: str, axis: AxisReport, curves: Curves) -> str:
    rho = curves.autocorrelation
    if curves.path is None:
        return ""
    last = len(rho) + 1
    edge = NORMAL_95 / max(curves.innovations, 1) ** 0.5
    lags = np.repeat(np.arange(1.0, last), 3)
    bars = np.ravel(np.column_stack([np.zeros(len(rho)), rho, np.full(len(rho), np.nan)]))
    label = "95 % for white innovations"
    shown = [
        Curve(lags, bars, "own", label="FLTEA's innovations"),
        Curve([0, last], (), "grey", [-edge] * 2, [edge] * 2, label=label),
    ]
    x_axis = Axis("lag [samples]", ends=(0.0, float(last)))
    bottom, top = min(-edge, float(rho.min())), max(edge, float(rho.max()))
    margin = 0.1 * (top - bottom)
    y_axis = Axis("correlation of the innovations", ends=(bottom - margin, top + margin))
    return chart(title, x_axis, y_axis, shown)


_PAINTERS: dict[str, Callable[[str, AxisReport, Curves], str]] = {
    "spectrum": _spectrum,
    "profile": _profile,
    "alpha": _alpha,
    "f": _f,
    "allan": _allan,
    "bias": _bias,
    "forecast": _forecast,
    "innovations": _innovations,
}

TITLES = {
    "spectrum": (
        "Spectrum",
        "Flat: white noise. Of two models the one with the lower BIC is better; white noise has 0. Blue: "
        "the best model without an order, orange: the best with one. Grey: lines, resonances and drift, "
        "which were left out.",
    ),
    "profile": (
        "Which orders the data allow",
        "Orders whose curve lies below the dotted line fit the data as well as the best order does. That "
        "says something only where the verdict has an order; elsewhere the order is undefined, whatever the "
        "curve.",
    ),
    "alpha": (
        "FLTEA's α over time",
        "Grey: what the same algorithm gives for white noise of the same distribution. A curve within it "
        "says nothing about memory; a curve outside is a hint. The table has the test.",
    ),
    "f": (
        "FLTEA's f over time",
        "Grey: what the same algorithm gives for white noise of the same distribution, as in α's picture.",
    ),
    "allan": (
        "Allan deviation",
        "Blue, with 5 to 95 %: simulated records of the same length, of the verdict's model and the peaks "
        "found. Where the blue band leaves the data, the model does not reproduce the sensor.",
    ),
    "bias": (
        "Bias over time",
        "The constant to subtract during the next second or so, by the samples until then. After a step "
        "it is estimated anew; in motion it is predicted.",
    ),
    "forecast": (
        "How far the heading is off",
        "σ of the heading after a rest of {rest} (purple), the longest part of the recording without a gap, "
        "and after its first half, {half} (blue). Points: what the second half shows. 95 % of the points are "
        "in the grey band if the first half's model holds there. Pieces of one length do not overlap; pieces "
        "of different lengths share their samples.",
    ),
    "innovations": (
        "Autocorrelation of FLTEA's innovations",
        "If the model is right, nineteen in twenty bars are within the grey band. Many outside: the online "
        "model does not describe this noise.",
    ),
}
"""Title of each picture, and how to read it."""

SEEN = ("spectrum", "allan", "bias", "forecast")
"""The pictures of the noise itself, which come first in the report."""
WHY = ("profile",)
"""The pictures of the reasons for the verdict."""
FLTEA = ("alpha", "f", "innovations")
"""The pictures of the estimates that FLTEA, the online algorithm, makes over time."""
