"""The figures over time and the columns that they draw."""

import math
from collections.abc import Sequence

import numpy as np
from bokeh.models import ColumnDataSource, CustomJSTickFormatter, DatetimeTicker, HoverTool, Range1d
from bokeh.models.annotations import BoxAnnotation, Span
from bokeh.plotting import figure
from numpy.typing import NDArray

from fltea.sinks.page.plot_style import BAND, COMMON, ESTIMATE, FIT, INKED, SAMPLE, STATE, source

CHECKED = 1000
"""Innovations over which `stats` judges their whiteness."""

LOCAL_TIME = """
const date = new Date(tick)
const seconds = date.getSeconds() ? ":" + String(date.getSeconds()).padStart(2, "0") : ""
return String(date.getHours()).padStart(2, "0") + ":" + String(date.getMinutes()).padStart(2, "0") + seconds
"""


Shown = tuple[ColumnDataSource, tuple[str, ...]]

POWER_OF_TEN = "return tick ? tick.toExponential(1).replaceAll('-', '\u2212') : '0'"


class Figures:
    """Figures by name, over five sources; `moment` is the time that all of them show, in ms.

    Ends of estimates are one standard deviation away, those of fits are of their 95 % intervals. compared:
    the device's own estimates, and how far they are apart from the host's.
    """

    def __init__(self) -> None:
        ends = "alpha_low", "alpha_high", "f_low", "f_high"
        self.rows = source("time", "temperature", "y_low", "y", "y_high")
        self.estimates = source("time", "seq", "state", "alpha", "f", *ends)
        self.fits = source("time", "alpha_mid", "f_mid", *ends)
        self.checks = source("time", "lag1", "nis")
        self.compared = source("time", "alpha", "f", "apart_low", "apart", "apart_high")
        self.moment = Range1d(start=0, end=1)
        self._heights: list[_Height] = []
        self.noise = self._noise()
        self.alpha = self._estimate("alpha", "α", "order α")
        self.f = self._estimate("f", "f", "parameter f [s^-α]")
        self.lag1 = self._check("lag1", "lag-1 correlation", 0.0, 2 / math.sqrt(CHECKED))
        self.nis = self._check("nis", "NIS", 1.0, 2 * math.sqrt(2 / CHECKED))
        self.temperature = self._figure(
            "temperature", "temperature [°C]", (self.rows, ("temperature",)), least=0.5
        )
        self.temperature.line("time", "temperature", source=self.rows, color=STATE, line_width=1.5)
        self.apart = self._apart()

    @property
    def all(self) -> list[figure]:
        """All figures, in the order of the page."""
        return [self.noise, self.alpha, self.f, self.lag1, self.nis, self.temperature, self.apart]

    def fit(self) -> None:
        """Make every figure as high as what it shows."""
        for height in self._heights:
            height.fit()

    def _noise(self) -> figure:
        shown = (self.rows, ("y_low", "y_high")), (self.estimates, ("state",))
        plot = self._figure("noise", "deg/s", *shown)
        plot.varea("time", "y_low", "y_high", source=self.rows, color=SAMPLE, alpha=0.35)
        plot.line("time", "y", source=self.rows, color=SAMPLE, line_width=1)
        plot.line("time", "state", source=self.estimates, color=STATE, line_width=1.5)
        return plot

    def _estimate(self, name: str, letter: str, label: str) -> figure:
        low, mid, high = f"{name}_low", f"{name}_mid", f"{name}_high"
        shown = (self.estimates, (low, high)), (self.fits, (mid,)), (self.compared, (name,))
        plot = self._figure(name, label, *shown, loose=(self.fits, (low, high)))
        plot.varea("time", low, high, source=self.fits, color=FIT, alpha=0.3)
        plot.line("time", mid, source=self.fits, color=FIT, line_width=1.5)
        plot.varea("time", low, high, source=self.estimates, color=ESTIMATE, alpha=0.25)
        line = plot.line("time", name, source=self.estimates, color=ESTIMATE, line_width=2)
        plot.line("time", name, source=self.compared, line_width=2, line_dash=[7, 7], name=INKED)
        tips = [
            ("sample", "@seq{0,0}"),
            (letter, f"@{name}{{0.0000}}"),
            ("± σ", f"@{low}{{0.0000}} … @{high}{{0.0000}}"),
        ]
        plot.add_tools(HoverTool(renderers=[line], tooltips=tips, mode="vline"))
        return plot

    def _check(self, name: str, label: str, reference: float, limit: float) -> figure:
        plot = self._figure(
            name, label, (self.checks, (name,)), always=(reference - 1.2 * limit, reference + 1.2 * limit)
        )
        band = BoxAnnotation(
            bottom=reference - limit, top=reference + limit, fill_color=BAND, fill_alpha=0.4, line_color=None
        )
        plot.add_layout(band)
        plot.add_layout(Span(location=reference, dimension="width", line_color=BAND, line_dash="dashed"))
        plot.line("time", name, source=self.checks, color=ESTIMATE, line_width=2)
        plot.scatter("time", name, source=self.checks, color=ESTIMATE, size=3)
        return plot

    def _apart(self) -> figure:
        shown = self.compared, ("apart_low", "apart_high")
        plot = self._figure("apart", "device − host, α", shown, always=(0.0,), least=1e-9)
        plot.add_layout(Span(location=0.0, dimension="width", line_color=BAND, line_dash="dashed"))
        plot.varea("time", "apart_low", "apart_high", source=self.compared, color=SAMPLE, alpha=0.35)
        plot.line("time", "apart", source=self.compared, line_width=1.5, name=INKED)
        plot.yaxis.formatter = CustomJSTickFormatter(code=POWER_OF_TEN)
        return plot

    def _figure(
        self,
        name: str,
        label: str,
        *shown: Shown,
        always: Sequence[float] = (),
        least: float = 1e-6,
        loose: Shown | None = None,
    ) -> figure:
        height = _Height(shown, always, least, loose)
        self._heights.append(height)
        plot = figure(
            name=name,
            x_axis_type="datetime",
            x_range=self.moment,
            y_range=height.range,
            height=230,
            y_axis_label=label,
            x_axis_label="local time",
            **COMMON,
        )
        plot.xaxis.formatter = CustomJSTickFormatter(code=LOCAL_TIME)
        plot.xaxis.ticker = DatetimeTicker(desired_num_ticks=4)  # what a phone has room for
        return plot


def _finite(source: ColumnDataSource, names: Sequence[str]) -> NDArray[np.float64]:
    columns = [np.asarray(source.data[name], dtype=np.float64) for name in names]
    values: NDArray[np.float64] = np.concatenate(columns)
    return values[np.isfinite(values)]


class _Height:
    """The range of values of a figure: follows the data, but not every twitch of them.

    shown: columns of sources that it has to hold; always: further values; least: its least length.
    loose: columns that it holds as far as they reach no further beyond the others than these are long.
    """

    def __init__(
        self,
        shown: Sequence[Shown],
        always: Sequence[float],
        least: float,
        loose: Shown | None = None,
    ) -> None:
        self._ends = math.inf, -math.inf
        self.range = Range1d(start=-1, end=1)
        self._shown = shown
        self._always = always
        self._least = least
        self._loose = loose

    def fit(self) -> None:
        """Change the range if the data leave it, or have no more use for a third of it."""
        values = np.concatenate([*(_finite(*one) for one in self._shown), self._always])
        if not values.size:
            return
        low, high = float(values.min()), float(values.max())
        wider = max(0.0, self._least - (high - low)) / 2
        low, high = low - wider, high + wider
        if self._loose is not None:
            beyond = np.clip(_finite(*self._loose), 2 * low - high, 2 * high - low)
            low, high = float(np.min(beyond, initial=low)), float(np.max(beyond, initial=high))
        span = high - low
        start, end = self._ends
        if low < start or high > end or span < 0.6 * (end - start):
            start, end = self._ends = low - 0.1 * span, high + 0.1 * span
            self.range.update(start=start, end=end)
