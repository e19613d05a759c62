"""Figures of an axis: spectrum and Allan deviation, with the model's curve, and the heading's forecast."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from bokeh.models import CustomJSTickFormatter, FixedTicker, HoverTool, Range1d
from bokeh.plotting import figure
from numpy.typing import NDArray

from fltea.records.device_fit import DeviceSpectrum
from fltea.records.fit import AxisFit, FitAllan, FitSpectrum
from fltea.sinks.page.plot_style import BAND, COMMON, ESTIMATE, FIT, MARK, SAMPLE, STATE, source

Array = NDArray[np.float64]

FLICKER = 0.664
"""Floor of the Allan deviation over B: √(2 ln 2 / π)."""

MANY = 300.0
"""Ends of an axis are so far apart that decades suffice."""
MOST_TICKS = 6

ROOM, NARROW = 1.5, 1.05
"""Of a figure, beyond what it shows: upwards, and to the side."""


class CurveFigures:
    """The figures and their sources; `show` and `show_heading` fill them."""

    def __init__(self) -> None:
        self.density = source("hz", "density", "model")
        self.of_board = source("hz", "density")
        self.left_out = source("low", "high")
        self.deviation = source("tau_s", "low", "adev", "high", "model")
        self.marks = source("xs", "ys", "at", "level", "name", "colour")
        self.forecast = source("t_s", "std")
        self._hz, self._densities, self._tau, self._deviations = _Frame(), _Frame(), _Frame(), _Frame()
        self._ahead, self._headings = _Frame(), _Frame()
        self.spectrum = self._spectrum()
        self.allan = self._allan()
        self.heading = self._heading()

    @property
    def all(self) -> list[figure]:
        """All figures, in the order of the page."""
        return [self.spectrum, self.allan, self.heading]

    def show(self, axis: str, unit: str, fit: AxisFit | None, board: DeviceSpectrum | None = None) -> None:
        """Draw the curves of a fit; what it does not have is emptied. unit: as people write it.

        board: the bins that the device itself fitted.
        """
        spectrum, allan = (fit.spectrum, fit.allan) if fit else (None, None)
        self.density.data = _columns(spectrum, "hz", "density", "model")
        self.left_out.data = _left_out(fit, spectrum)
        self.of_board.data = _columns(board, "hz", "density")
        if spectrum is not None:
            self._hz.show(spectrum.hz, NARROW)
            self._densities.show([*spectrum.density, *spectrum.model], ROOM)
        self.deviation.data = _columns(allan, "tau_s", "low", "adev", "high", "model")
        self.marks.data = _marks(allan)
        if allan is not None:
            self._tau.show(allan.tau_s, NARROW)
            self._deviations.show([*allan.low, *allan.adev, *allan.high], ROOM)
        for plot, label in (
            (self.spectrum, f"{axis} [({unit})/√Hz]"),
            (self.allan, f"{axis} [{unit}]"),
        ):
            if plot.yaxis[0].axis_label != label:
                plot.yaxis[0].axis_label = label

    def show_heading(self, std: Mapping[int, float]) -> None:
        """Draw how far the heading is off, in deg, so many seconds after a rest."""
        if list(self.forecast.data["std"]) == [*std.values()]:
            return
        self.forecast.data = {"t_s": [*std], "std": [*std.values()]}
        self._ahead.show([*std], ROOM)
        self._headings.show([*std.values()], ROOM)

    def _spectrum(self) -> figure:
        plot = _log_log("spectrum", "frequency [Hz]", self._hz, self._densities)
        plot.vstrip("low", "high", source=self.left_out, fill_color=BAND, fill_alpha=0.35, line_color=None)
        points = plot.scatter("hz", "density", source=self.density, color=SAMPLE, size=4)
        plot.scatter("hz", "density", source=self.of_board, marker="x", color=STATE, size=7, name="board")
        plot.line("hz", "model", source=self.density, color=FIT, line_width=2.5)
        tips = [("Hz", "@hz{0.000}"), ("density", "@density{0.000e+0}"), ("model", "@model{0.000e+0}")]
        plot.add_tools(HoverTool(renderers=[points], tooltips=tips))
        return plot

    def _allan(self) -> figure:
        plot = _log_log("allan", "averaging time τ [s]", self._tau, self._deviations)
        plot.varea("tau_s", "low", "high", source=self.deviation, color=ESTIMATE, alpha=0.25)
        plot.multi_line("xs", "ys", source=self.marks, color="colour", line_width=1.5, line_dash="dashed")
        plot.line("tau_s", "adev", source=self.deviation, color=ESTIMATE, line_width=1.5)
        points = plot.scatter("tau_s", "adev", source=self.deviation, color=ESTIMATE, size=5)
        plot.line("tau_s", "model", source=self.deviation, color=FIT, line_width=2.5)
        plot.text(
            "at", "level", text="name", source=self.marks, text_color="colour", text_font_style="bold",
            text_baseline="bottom", text_align="center", text_font_size="15px", y_offset=-2,
        )  # fmt: skip
        tips = [
            ("τ", "@tau_s{0.000} s"),
            ("deviation", "@adev{0.000e+0}"),
            ("95 %", "@low{0.000e+0} … @high{0.000e+0}"),
        ]
        plot.add_tools(HoverTool(renderers=[points], tooltips=tips))
        return plot

    def _heading(self) -> figure:
        plot = _log_log("heading", "time after rest [s]", self._ahead, self._headings)
        plot.yaxis[0].axis_label = "heading, σ [°]"
        plot.line("t_s", "std", source=self.forecast, color=FIT, line_width=2.5)
        points = plot.scatter("t_s", "std", source=self.forecast, color=FIT, size=7)
        plot.add_tools(HoverTool(renderers=[points], tooltips=[("after", "@t_s s"), ("±", "@std{0.00e+0}°")]))
        return plot


def _log_log(name: str, label: str, x: "_Frame", y: "_Frame") -> figure:
    plot = figure(
        name=name,
        x_axis_type="log",
        y_axis_type="log",
        x_range=x.range,
        y_range=y.range,
        height=300,
        x_axis_label=label,
        **COMMON,
    )
    plot.xaxis.ticker = plot.xgrid.ticker = x.ticker
    plot.yaxis.ticker = plot.ygrid.ticker = y.ticker
    plot.axis.formatter = CustomJSTickFormatter(code="return Number(tick.toPrecision(1)).toString()")
    return plot


def _positive(values: Sequence[float], length: int) -> Array:
    """Values for a logarithmic axis: NaN for what cannot be drawn, also where there are too few."""
    found = np.full(length, np.nan)
    given = np.asarray(values[:length], dtype=np.float64)
    found[: len(given)] = np.where(np.isfinite(given) & (given > 0), given, np.nan)
    return found


class _Frame:
    """The range of a logarithmic axis: shows all data with some room, and moves only if it has to."""

    def __init__(self) -> None:
        self.range = Range1d(start=0.1, end=10)
        self.ticker = FixedTicker(ticks=[0.1, 1, 10])
        self._ends = 0.1, 10.0

    def show(self, values: Sequence[float], room: float) -> None:
        """Take in all values that can be drawn."""
        good = _positive(values, len(values))
        if not np.isfinite(good).any():
            return
        low, high = float(np.nanmin(good)), float(np.nanmax(good))
        start, end = self._ends
        if low < start or high > end or (high / low) ** 1.4 * room**2 < end / start:
            self._ends = low / room, high * room
            self.range.update(start=low / room, end=high * room)
            self.ticker.update(ticks=_ticks(*self._ends))


def _ticks(start: float, end: float) -> list[float]:
    """Decades, and 2 and 5 between them where few fit in."""
    steps = (1.0,) if end / start > MANY else (1.0, 2.0, 5.0)
    first, last = math.floor(math.log10(start)), math.ceil(math.log10(end))
    every = math.ceil((last - first) / MOST_TICKS)
    powers = range(first, last + 1, every)
    return [float(f"{step}e{power}") for power in powers for step in steps]


def _columns(curve: FitSpectrum | FitAllan | DeviceSpectrum | None, *names: str) -> dict[str, Array]:
    """Return some columns of a curve, as long as the first of them; empty ones without a curve."""
    found = [getattr(curve, name, ()) for name in names]
    return {name: _positive(values, len(found[0])) for name, values in zip(names, found, strict=True)}


def _left_out(fit: AxisFit | None, s: FitSpectrum | None) -> dict[str, list[float]]:
    """Bands, as far as a logarithmic axis goes."""
    bands = fit.rate_left_out if fit and s and s.hz else []
    least = s.hz[0] / 10 if s and s.hz else 1.0
    return {"low": [max(low, least) for low, _ in bands], "high": [max(high, least) for _, high in bands]}


def _marks(a: FitAllan | None) -> dict[str, list[object]]:
    """The lines that N, B and K stand for, and where their names stand."""
    found: dict[str, list[object]] = {name: [] for name in ("xs", "ys", "at", "level", "name", "colour")}
    if a is None or not a.tau_s:
        return found
    first, last = a.tau_s[0], a.tau_s[-1]
    for name, value, slope, read_at, at, colour in (
        ("N", a.N, -0.5, 1.0, first * 2, STATE),
        ("B", None if a.B is None else FLICKER * a.B, 0.0, 1.0, math.sqrt(first * last), MARK),
        ("K", a.K, 0.5, 3.0, last / 2, SAMPLE),
    ):
        if value is not None:
            *y, level = (value * (tau / read_at) ** slope for tau in (first, last, at))
            for column, one in zip(found, ([first, last], y, at, level, name, colour), strict=True):
                found[column].append(one)
    return found
