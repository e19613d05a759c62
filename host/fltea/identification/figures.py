"""The figures of one axis as PNG; rendered by Agg, nothing here opens a window."""

import io
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from fltea.identification.allan import scales
from fltea.identification.axis_report import AxisReport
from fltea.identification.curves import Curves
from fltea.identification.forecast import integral, is_any_heading
from fltea.noise.parts import spectrum
from fltea.records.arrays import Array
from fltea.records.plus_minus import NORMAL_95
from fltea.records.units import FLICKER, MOST_DEG
from fltea.spectrum.intervals import CRITICAL

if TYPE_CHECKING:
    from matplotlib.figure import Figure


DATA: dict[str, Any] = {"color": "#444444"}
FRACTIONAL: dict[str, Any] = {"color": "#d95f02", "linewidth": 1.8}
RIVAL: dict[str, Any] = {"color": "#1f6fb4", "linewidth": 1.6, "linestyle": (0, (6, 2))}
WHITE: dict[str, Any] = {"color": "#2b8a3e", "linewidth": 1.3, "linestyle": (0, (2, 2))}
OWN: dict[str, Any] = {"color": "#542788", "linewidth": 1.4}
BAND = "#c7c7c7"
HIGHEST_DEVIANCE = 20.0


def draw(axis: AxisReport) -> dict[str, bytes]:
    """Return the figures by their names in `TITLES`; that of the Allan deviation only where there is one."""
    assert axis.curves is not None
    return {name: _png(paint, axis, axis.curves) for name, paint in _PAINTERS.items() if _has(name, axis)}


def _has(name: str, axis: AxisReport) -> bool:
    if name == "forecast":
        return axis.forecast is not None
    if name == "bias":
        return axis.course is not None
    if name == "allan":
        return axis.allan is not None
    return name not in ("trajectory", "innovations") or axis.result.fltea is not None


def _png(paint: Callable[["Figure", AxisReport, Curves], None], axis: AxisReport, curves: Curves) -> bytes:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 4.0), dpi=120, layout="constrained")
    paint(figure, axis, curves)
    for axes in figure.axes:
        axes.grid(alpha=0.25)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", metadata={"Software": None})
    return buffer.getvalue()


def _spectrum(figure: "Figure", axis: AxisReport, curves: Curves) -> None:
    axes, s, r = figure.subplots(), curves.spectrum, axis.result
    density = 2 / r.rate_hz  # of white noise of variance 1, one-sided
    hz = np.geomspace(s.hz[0], s.hz[-1], 600)
    lam = 2 * np.pi * hz / r.rate_hz
    axes.plot(s.hz, density * s.power, ".", markersize=3, label="periodogram, in bins", **DATA)
    for name, style in (("white", WHITE), ("plain", RIVAL), ("order", FRACTIONAL)):
        if (one := r.sentences.get(name)) is None:
            continue
        label = f"{one.name}, BIC {one.bic:+.1f}" + (": the verdict" if name == r.stands else "")
        axes.plot(hz, density * spectrum(one.parts, lam, 1 / r.rate_hz), label=label, **style)
    label = "not fitted"
    for low, high in [(0.0, r.band.from_hz), *r.band.notch_hz]:
        if high > s.hz[0]:
            axes.axvspan(max(low, s.hz[0] * 0.9), high, color=BAND, alpha=0.5, linewidth=0, label=label)
            label = "_"
    axes.set(xscale="log", yscale="log", xlabel="frequency [Hz]", ylabel=f"density [({axis.unit})²/Hz]")
    axes.set_xlim(s.hz[0] * 0.9, s.hz[-1] * 1.1)
    axes.legend(fontsize=8, loc="best")


def _profile(figure: "Figure", axis: AxisReport, curves: Curves) -> None:
    axes, alpha = figure.subplots(), axis.result.order.alpha
    axes.plot(curves.orders, curves.deviance, **FRACTIONAL)
    axes.axhline(CRITICAL, color="black", linewidth=0.8, linestyle=":")
    axes.annotate(
        "95 %",
        (float(curves.orders[-1]), CRITICAL),
        (0, 3),
        textcoords="offset points",
        ha="right",
        fontsize=8,
    )
    if alpha.value is not None and alpha.low is not None and alpha.high is not None:
        axes.axvspan(alpha.low, alpha.high, color="#fdbe85", alpha=0.5, linewidth=0)
        axes.axvline(alpha.value, color="black", linewidth=0.8)
        title = f"α = {alpha.value:.2f} ({alpha.low:.2f} … {alpha.high:.2f})"
    else:
        title = f"α is undefined: the verdict is {axis.result.verdict.kind}"
    axes.set_title(title, fontsize=10)
    axes.set(xlabel="order α held at", ylabel="2 log L below the best with an order")
    axes.set_xlim(0, float(curves.orders[-1]))
    axes.set_ylim(-0.2, max(6.0, min(HIGHEST_DEVIANCE, float(curves.deviance.max()) * 1.05)))


def _path(figure: "Figure", axis: AxisReport, curves: Curves) -> None:
    p, fit = curves.path, axis.result.fltea
    assert p is not None
    assert fit is not None
    panels = figure.subplots(2, 1, sharex=True)
    shuffled = axis.result.null.shuffled
    for axes, value, std, white, label, end in (
        (panels[0], p.alpha, p.alpha_std, p.white_alpha, "order α", shuffled and shuffled.alpha),
        (panels[1], p.f, p.f_std, p.white_f, "parameter f [s$^{-α}$]", shuffled and shuffled.f),
    ):
        axes.fill_between(
            p.t_s, white[:, 0], white[:, 2], color=BAND, alpha=0.8, linewidth=0,
            label=f"white noise gives (5–95 % of {p.copies} copies)",
        )  # fmt: skip
        axes.plot(p.t_s, white[:, 1], color="#8c8c8c", linewidth=1.0)
        half = NORMAL_95 * std
        axes.fill_between(p.t_s, value - half, value + half, color=OWN["color"], alpha=0.2, linewidth=0)
        axes.plot(p.t_s, value, label=f"FLTEA {fit.variant}, 95 %", **OWN)
        if shuffled and end:
            low, middle, high = end
            axes.errorbar(
                p.t_s[-1] * 1.02, middle, [[middle - low], [high - middle]], color="black", capsize=3,
                linewidth=1.0, label=f"{shuffled.copies} shuffled copies, at the end",
            )  # fmt: skip
        axes.set_ylabel(label)
        axes.set_ylim(*_limits(value, white))
    panels[0].legend(fontsize=8, loc="best")
    panels[1].set_xlabel("time [s]")


def _limits(value: Array, white: Array) -> tuple[float, float]:
    """Return the limits of all but the first tenth, in which everything moves."""
    late = slice(len(value) // 10, None)
    known = np.concatenate([value[late], white[late].ravel()])
    known = known[np.isfinite(known)]
    if not known.size:
        return -1.0, 1.0
    low, high = float(known.min()), float(known.max())
    margin = 0.25 * (high - low) or 0.1
    return low - margin, high + margin


def _allan(figure: "Figure", axis: AxisReport, curves: Curves) -> None:
    axes, a = figure.subplots(), axis.allan
    assert a is not None
    tau = np.array(a.tau_s)
    axes.fill_between(tau, a.low, a.high, color=BAND, alpha=0.7, linewidth=0, label="95 %")
    axes.plot(tau, a.deviation, ".-", markersize=4, linewidth=0.8, label="Allan deviation", **DATA)
    if (found := axis.reproduction) is not None:
        data = np.array(a.deviation)
        low, middle, high = (data * np.array(ratio) for ratio in (found.low, found.ratio, found.high))
        color = RIVAL["color"]
        axes.fill_between(tau, low, high, color=color, alpha=0.2, linewidth=0)
        axes.plot(tau, middle, label=f"noise of the model ({axis.result.made_of})", **RIVAL)
    of = scales(axis.unit)
    for c, scale, slope, at_s, name, style in (
        (a.N, of.N, -0.5, 1.0, "N", WHITE),
        (a.K, of.K, 0.5, 3.0, "K", FRACTIONAL),
    ):
        if c.value is not None:
            label = f"{name} = {c.value * scale.factor:.3g} {scale.unit}"
            axes.plot(tau, c.value * (tau / at_s) ** slope, label=label, **style)
    if a.B.value is not None:
        label = f"B = {a.B.value * of.B.factor:.3g} {of.B.unit}"
        axes.axhline(a.B.value * FLICKER, color="#7b3294", linewidth=1.2, linestyle="-.", label=label)
    axes.set(
        xscale="log", yscale="log", xlabel="averaging time τ [s]", ylabel=f"Allan deviation [{axis.unit}]"
    )
    bottom, top = min(a.low), max(a.high)
    axes.set_ylim(bottom / 1.6, top * 1.6)
    axes.legend(fontsize=8, loc="best")


def _forecast(figure: "Figure", axis: AxisReport, curves: Curves) -> None:
    axes, f, unit = figure.subplots(), axis.forecast, integral(axis.unit).strip()
    assert f is not None
    axes.plot(f.t_s, f.heading_std, label="from the end of the recording", **OWN)
    if is_any_heading(max(f.heading_std), axis.unit):
        axes.axhline(
            MOST_DEG, color="#888888", linewidth=0.8, linestyle=":", label="no heading is left above"
        )
    if f.judged:
        t, said, seen, count = np.array([(p.t_s, p.said, p.seen, p.pieces) for p in f.judged]).T
        # Of a root mean square of so many, Wilson & Hilferty (1931).
        middle, spread = 1 - 2 / (9 * count), NORMAL_95 * np.sqrt(2 / (9 * count))
        low, high = (said * np.maximum(middle + way * spread, 0) ** 1.5 for way in (-1, 1))
        axes.fill_between(t, low, high, color=BAND, alpha=0.7, linewidth=0, label="95 % of what is seen")
        axes.plot(t, said, label="predicted by the first half", **RIVAL)
        axes.plot(t, seen, ".", label="seen in the second half", **DATA)
    axes.set(xscale="log", yscale="log", xlabel="time after rest [s]", ylabel=f"heading, σ [{unit}]")
    axes.legend(fontsize=8, loc="best")


def _bias(figure: "Figure", axis: AxisReport, curves: Curves) -> None:
    axes, c = figure.subplots(), axis.course
    assert c is not None
    low, high = c.bias - NORMAL_95 * c.bias_std, c.bias + NORMAL_95 * c.bias_std
    axes.fill_between(c.t_s, low, high, color=OWN["color"], alpha=0.2, linewidth=0, label="95 %")
    axes.plot(c.t_s, c.bias, label=f"Bias({axis.now.bias_s:g} s)" if axis.now else "bias", **OWN)
    label = "motion"
    for one in axis.motion:
        axes.axvspan(one.begin_s, one.end_s, color=BAND, alpha=0.7, linewidth=0, label=label)
        label = "_"
    label = "step"
    for step in axis.bias_steps:
        axes.axvline(step.at_s, color=FRACTIONAL["color"], linewidth=1.0, linestyle=":", label=label)
        label = "_"
    known = np.isfinite(high - low)
    if known.any():  # its σ is wide at first, and after a step
        bottom, top = np.nanmin(c.bias[known]), np.nanmax(c.bias[known])
        margin = 4 * float(np.nanmedian(c.bias_std[known])) + 0.1 * float(top - bottom)
        axes.set_ylim(bottom - margin, top + margin)
    axes.set(xlabel="time [s]", ylabel=f"bias [{axis.unit}]")
    axes.legend(fontsize=8, loc="best")


def _innovations(figure: "Figure", axis: AxisReport, curves: Curves) -> None:
    axes, rho = figure.subplots(), curves.autocorrelation
    lags = np.arange(1, len(rho) + 1)
    edge = NORMAL_95 / max(curves.innovations, 1) ** 0.5
    axes.axhspan(-edge, edge, color=BAND, alpha=0.6, linewidth=0, label="95 % for white innovations")
    axes.vlines(lags, 0, rho, color=OWN["color"], linewidth=1.6)
    axes.axhline(0, color="black", linewidth=0.6)
    axes.set(xlabel="lag [samples]", ylabel="correlation of the innovations")
    axes.set_xlim(0, len(rho) + 1)
    axes.legend(fontsize=8, loc="best")


_PAINTERS = {
    "spectrum": _spectrum,
    "profile": _profile,
    "trajectory": _path,
    "allan": _allan,
    "bias": _bias,
    "forecast": _forecast,
    "innovations": _innovations,
}

TITLES = {
    "spectrum": (
        "Spectrum",
        "Flat: white noise. Of two models the one with the lower BIC is better; white noise has 0. Blue: "
        "the best without an order, orange: with one. Grey: lines, resonances and drift, which were left "
        "out.",
    ),
    "profile": (
        "Which orders the data allow",
        "What lies below the dotted line fits the data as well as the best with an order does. That says "
        "something only where the verdict has an order; elsewhere it is undefined, whatever the curve.",
    ),
    "trajectory": (
        "FLTEA over time",
        "Grey: what the same algorithm gives for white noise of the same distribution. A line within it says "
        "nothing about memory; one outside is a hint, for the test see the table.",
    ),
    "allan": (
        "Allan deviation",
        "Dashed, with the 5 to 95 % of its simulations: noise drawn from the verdict's model and the peaks "
        "beside it. Where it leaves the data, the model does not reproduce the sensor.",
    ),
    "bias": (
        "Bias over time",
        "The constant to take off during the next second or so, by the samples until then. Steps are where "
        "it is learnt anew; in motion it is predicted.",
    ),
    "forecast": (
        "How far the heading is off",
        "Points outside of the grey band: the model of the first half does not hold in the second. "
        "Pieces of one length do not overlap; those of several lengths are the same samples.",
    ),
    "innovations": (
        "Autocorrelation of FLTEA's innovations",
        "Of a model that is right nineteen in twenty are within the grey band. Many outside: the online "
        "model does not describe this noise.",
    ),
}
"""The title of each figure, and how to read it."""
