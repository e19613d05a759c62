"""The figures of one axis as PNG; rendered by Agg, nothing here opens a window."""

import io
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fltea.identification.allan import scales
from fltea.identification.curves import Curves
from fltea.identification.findings import model_name
from fltea.identification.noise_model import AxisModel, model_spectrum, noise_of
from fltea.identification.run import AxisReport
from fltea.spectrum.allan_coefficients import FLICKER
from fltea.spectrum.evidence import LEVEL
from fltea.spectrum.wording import MODELS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

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
    return name != "allan" or axis.allan is not None


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
    for name, style in (("white", WHITE), (r.rivals.best_rival, RIVAL), ("fractional", FRACTIONAL)):
        model = AxisModel(noise_of(name, r.rivals, 1 / r.rate_hz))
        label = f"{MODELS[name]}, BIC {r.rivals.models[name].bic:+.1f}"
        axes.plot(hz, density * model_spectrum(model, lam, 1 / r.rate_hz), label=label, **style)
    label = "not fitted"
    for low, high in [(0.0, r.band.from_hz), *r.band.notch_hz]:
        if high > s.hz[0]:
            axes.axvspan(max(low, s.hz[0] * 0.9), high, color=BAND, alpha=0.5, linewidth=0, label=label)
            label = "_"
    axes.set(xscale="log", yscale="log", xlabel="frequency [Hz]", ylabel=f"density [({axis.unit})²/Hz]")
    axes.set_xlim(s.hz[0] * 0.9, s.hz[-1] * 1.1)
    axes.legend(fontsize=8, loc="best")


def _profile(figure: "Figure", axis: AxisReport, curves: Curves) -> None:
    axes, alpha = figure.subplots(), axis.result.whittle.alpha
    axes.plot(curves.orders, curves.deviance, **FRACTIONAL)
    axes.plot(
        curves.orders, curves.critical, color="black", linewidth=0.8, linestyle=":", drawstyle="steps-mid"
    )
    axes.annotate(
        "95 %", (1.99, curves.critical[-1]), (0, 3), textcoords="offset points", ha="right", fontsize=8
    )
    if alpha.low is not None and alpha.high is not None:
        axes.axvspan(alpha.low, alpha.high, color="#fdbe85", alpha=0.5, linewidth=0)
        axes.axvline(alpha.value, color="black", linewidth=0.8)
        title = f"α = {alpha.value:.2f} ({alpha.low:.2f} … {alpha.high:.2f})"
    elif axis.result.null.p_clean >= LEVEL:
        title = "α is undefined: white noise, which has none, is not rejected"
    else:
        title = "α is undefined: the data do not tell one order from another"
    axes.set_title(title, fontsize=10)
    axes.set(xlabel="order α held at", ylabel="2 log L below the best")
    axes.set_xlim(0, 2)
    axes.set_ylim(-0.2, max(6.0, min(HIGHEST_DEVIANCE, float(curves.deviance.max()) * 1.05)))


def _path(figure: "Figure", axis: AxisReport, curves: Curves) -> None:
    p = curves.path
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
        axes.fill_between(p.t_s, value - std, value + std, color=OWN["color"], alpha=0.2, linewidth=0)
        axes.plot(p.t_s, value, label=f"FLTEA {axis.result.fltea.variant}, ±σ", **OWN)
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
        axes.plot(tau, middle, label=f"noise of the model ({model_name(axis)})", **RIVAL)
    of = scales(axis.unit)
    _line(axes, tau, a.N.value, -0.5, 1.0, f"N = {(a.N.value or 0) * of.N.factor:.3g} {of.N.unit}", WHITE)
    _line(axes, tau, a.K.value, 0.5, 3.0, f"K = {(a.K.value or 0) * of.K.factor:.3g} {of.K.unit}", FRACTIONAL)
    if a.B.value is not None:
        label = f"B = {a.B.value * of.B.factor:.3g} {of.B.unit}"
        axes.axhline(a.B.value * FLICKER, color="#7b3294", linewidth=1.2, linestyle="-.", label=label)
    axes.set(
        xscale="log", yscale="log", xlabel="averaging time τ [s]", ylabel=f"Allan deviation [{axis.unit}]"
    )
    bottom, top = min(a.low), max(a.high)
    axes.set_ylim(bottom / 1.6, top * 1.6)
    axes.legend(fontsize=8, loc="best")


def _line(
    axes: "Axes",
    tau: Array,
    value: float | None,
    slope: float,
    at_s: float,
    label: str,
    style: dict[str, Any],
) -> None:
    if value is not None:
        axes.plot(tau, value * (tau / at_s) ** slope, label=label, **style)


def _innovations(figure: "Figure", axis: AxisReport, curves: Curves) -> None:
    axes, rho = figure.subplots(), curves.autocorrelation
    lags = np.arange(1, len(rho) + 1)
    edge = 1.96 / max(curves.innovations, 1) ** 0.5
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
    "innovations": _innovations,
}

TITLES = {
    "spectrum": (
        "Spectrum",
        "Flat: white noise. A model is worth its additional parameters if its BIC is below 0, that of white "
        "noise; of two, the lower one is better. Grey: lines, resonances and drift, which were left out.",
    ),
    "profile": (
        "Which orders the data allow",
        "What lies below the dotted line fits the data as well as the best does. Where that is nearly "
        "everything, the order is undefined, whatever an estimator prints; so it is "
        "where the null test does not reject white noise, whatever the curve.",
    ),
    "trajectory": (
        "FLTEA over time",
        "Grey: what the same algorithm gives for white noise of the same distribution. A line within it says "
        "nothing about memory; one outside is a hint, for the test see the table.",
    ),
    "allan": (
        "Allan deviation",
        "Dashed, with the 5 to 95 % of its simulations: noise drawn from the model of the verdict and the "
        "peaks beside it. Where it leaves the data, the model does not reproduce the sensor.",
    ),
    "innovations": (
        "Autocorrelation of FLTEA's innovations",
        "Of a model that is right nineteen in twenty are within the grey band. Many outside: the online "
        "model does not describe this noise.",
    ),
}
"""The title of each figure, and how to read it."""
