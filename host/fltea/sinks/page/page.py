"""One open page: sends a browser what is new, as fast as it takes it and never faster."""

import json
from collections.abc import Mapping
from importlib import resources
from typing import Any

import msgspec
import numpy as np
from bokeh.document import Document
from bokeh.events import DocumentReady
from bokeh.models import ColumnDataSource, CustomJS
from jinja2 import Environment
from numpy.typing import NDArray

from fltea.records import clock
from fltea.records.device_fit import DeviceSpectrum
from fltea.records.ports import Recorder
from fltea.sinks.page import facts, facts_of_device, recording
from fltea.sinks.page.curve_figures import CurveFigures
from fltea.sinks.page.figures import Figures
from fltea.sinks.page.fits import Curves
from fltea.sinks.page.history import DeviceHistory
from fltea.sinks.page.tables import Table
from fltea.sinks.page.tiers import WINDOWS, Cursor

Array = NDArray[np.float64]

PERIOD_MS = 300
FIRST_WINDOW = 1


class Page:
    """The document of one browser tab.

    The browser answers every update (`control.ack`), and there is no further update until it has: what a slow
    browser, or one that stopped reading, has not fetched stays in the history, which does not grow.

    recorder: knows how the recordings are. token: what the page's requests have to bring (`actions`).
    """

    def __init__(
        self,
        document: Document,
        histories: Mapping[str, DeviceHistory],
        recorder: Recorder | None = None,
        token: str = "",
        may_record: bool = False,
    ) -> None:
        self._histories = histories
        self._recorder, self._token, self._may_record = recorder, token, may_record
        self._device = next(iter(histories))
        self._axis = ""
        self._window = FIRST_WINDOW
        self._tick = 0
        self._acknowledged = 0
        self._cursors: dict[Table, Cursor] = {}
        self._middles: dict[tuple[Table, str], float] = {}
        self._figures, self._curves = Figures(), CurveFigures()
        self._drawn: tuple[str, str, Curves | None, DeviceSpectrum | None] = "", "", None, None
        self._facts = ColumnDataSource({"json": [""]}, name="facts")
        self._control = ColumnDataSource(
            {"device": [""], "axis": [""], "window": [FIRST_WINDOW], "ack": [0]}, name="control"
        )
        self._control.on_change("data", self._on_control)
        self._lay_out(document)
        document.add_periodic_callback(self.update, PERIOD_MS)

    def update(self) -> None:
        """Send what is new, if the browser has taken what was sent before."""
        if self._acknowledged < self._tick:
            return
        self._tick += 1
        now_ns = clock.host_ns()
        states = [facts.state(history, now_ns) for history in self._histories.values()]
        history = self._histories[self._device]
        with history.lock:
            if self._axis not in history.axes:
                self._axis = history.axes[0] if history.axes else ""
                self._cursors = {}
            if self._axis:
                for table, sources in self._shown(history).items():
                    self._send(history, table, sources)
                self._show_curves(history)
                self._curves.show_heading(facts.heading(history, self._axis))
                self._show_moment(history)
                self._figures.fit()
            shown = self._texts(history, states)
        self._facts.data = {"json": [json.dumps(shown, ensure_ascii=False, allow_nan=False)]}

    def _shown(self, history: DeviceHistory) -> dict[Table, list[ColumnDataSource]]:
        """Which tables the figures draw; what they do not draw is emptied."""
        f, estimator = self._figures, history.tables.estimator(self._axis)
        shown: dict[Table, list[ColumnDataSource]] = {"fits": [f.fits], "checks": [f.checks]}
        if estimator == "device":
            shown |= {"rows": [f.rows], "own": [f.estimates]}
        else:
            shown |= {"rows": [f.rows, f.estimates]}
        if estimator == "both":
            shown |= {"compared": [f.compared]}
        elif len(f.compared.data["time"]):
            f.compared.data = {name: [] for name in f.compared.column_names}
        return shown

    def _send(self, history: DeviceHistory, table: Table, sources: list[ColumnDataSource]) -> None:
        new = history.tables.read(table, self._window, self._cursors.get(table, Cursor()))
        self._cursors[table] = new.cursor
        places = history.tables.columns(table, self._axis)
        columns: dict[str, Any] = {name: new.values[:, place] for name, place in places.items()}
        for name in ("alpha", "f"):
            low, high = f"{name}_low", f"{name}_high"
            if f"{name}_std" in columns:
                std = columns[f"{name}_std"]
                columns[low], columns[high] = columns[name] - std, columns[name] + std
            if low in columns:
                before = np.nan if new.fresh else self._middles.get((table, name), np.nan)
                columns[low], columns[high], end = closed(columns[low], columns[high], before)
                self._middles[table, name] = end
        for source in sources:
            wanted = {name: columns[name] for name in source.column_names}
            if new.fresh:
                source.data = wanted
            elif len(new.values):
                source.stream(wanted, rollover=new.capacity)

    def _show_curves(self, history: DeviceHistory) -> None:
        """Send the curves of the axis only if they are other ones."""
        curves, board = history.fits.curves.get(self._axis), history.fits.device_spectra.get(self._axis)
        wanted = history.name, self._axis, curves, board
        if wanted[:2] == self._drawn[:2] and curves is self._drawn[2] and board is self._drawn[3]:
            return
        self._drawn = wanted
        fit = history.fits.axes.get(self._axis)
        if fit is not None and curves is not None:
            fit = msgspec.structs.replace(fit, spectrum=curves.spectrum, allan=curves.allan)
        self._curves.show(self._axis, facts.unit_of(self._axis), fit, board)

    def _show_moment(self, history: DeviceHistory) -> None:
        if history.sample is not None:
            end_ms = history.sample.host_ns * 1e-6
            length_ms = WINDOWS[self._window].length_s * 1e3
            self._figures.moment.update(start=end_ms - length_ms, end=end_ms)

    def _texts(self, history: DeviceHistory, states: list[dict[str, str]]) -> dict[str, Any]:
        sample, estimate = history.sample, history.estimate
        return {
            "tick": self._tick,
            "devices": states,
            "device": self._device,
            "axis": self._axis,
            "estimator": history.tables.estimator(self._axis),
            "unit": facts.unit_of(self._axis) if self._axis else "",
            "window": self._window,
            "windows": [window.label for window in WINDOWS],
            "status": next(state for state in states if state["name"] == self._device),
            "seq": estimate.seq if estimate else None,
            "epoch": history.epoch.epoch if history.epoch else None,
            "time_ms": sample.host_ns // 1_000_000 if sample else None,
            "fit": facts.fitted(history),
            "axes": facts.axes(history, self._window),
            "curves": facts.curves(history, self._axis),
            "own": facts_of_device.own(history),
            "link": facts.link(history.stats),
            "hardware": facts.device(history.hello, sample.temperature_c if sample else None),
            "events": facts.events(history),
            "settings": facts.settings(history),
            "recording": self._recording(),
        }

    def _recording(self) -> dict[str, Any]:
        if self._recorder is None:
            return recording.nothing()
        return recording.words(self._recorder.view(self._device), self._may_record)

    def _on_control(self, attribute: str, old: Any, new: Any) -> None:
        """Follow what the browser chooses; what makes no sense is ignored."""
        device, axis, window, acknowledged = (_one(new, name) for name in ("device", "axis", "window", "ack"))
        if isinstance(acknowledged, int):
            self._acknowledged = acknowledged
        before = self._device, self._axis, self._window
        if isinstance(device, str) and device in self._histories:
            self._device = device
        if isinstance(axis, str) and axis in self._histories[self._device].axes:
            self._axis = axis
        if isinstance(window, int) and 0 <= window < len(WINDOWS):
            self._window = window
        if before != (self._device, self._axis, self._window):
            self._cursors = {}
            self.update()

    def _lay_out(self, document: Document) -> None:
        document.title = "fltea"
        document.config.reconnect_session = False  # the page's script loads it again
        document.config.notify_connection_status = False
        self._figures.noise.tags = [self._facts, self._control]  # so they belong to the document
        plots = [*self._curves.all, *self._figures.all]
        with document.models.freeze():  # else bokeh looks through all of them after each
            for plot in plots:
                document.add_root(plot)
        shown = {"facts": self._facts, "control": self._control, "plots": plots}
        document.js_on_event(DocumentReady, CustomJS(args=shown, code=START))
        self._facts.js_on_change("data", CustomJS(code="window.fltea.show(cb_obj)"))
        document.template = TEMPLATE
        document.template_variables.update(css=_text("page.css"), token=self._token)
        document.template_variables.update(script=_text("page.js") + _text("actions.js"))


def closed(low: Array, high: Array, before: float = np.nan) -> tuple[Array, Array, float]:
    """Let an area have no height where its ends are not known, at the middle of what was known last.

    A browser's canvas would else join what is on both sides of a gap.

    before: the third of what was returned for the rows before these.
    """
    middle = (low + high) / 2
    known = np.isfinite(middle)
    last = np.maximum.accumulate(np.where(known, np.arange(1, len(middle) + 1), 0))
    filled = np.concatenate([[before], middle])[last]
    end = float(filled[-1]) if len(filled) else before
    return np.where(known, low, filled), np.where(known, high, filled), end


def _one(data: Any, name: str) -> Any:
    """The only entry of a column that came from a browser, None if there is none."""
    column = data.get(name) if isinstance(data, dict) else None
    return column[0] if isinstance(column, list) and len(column) == 1 else None


def _text(name: str) -> str:
    return resources.files("fltea.sinks.page").joinpath(name).read_text(encoding="utf-8")


START = "window.fltea.start(facts, control, plots)"
TEMPLATE = Environment(autoescape=False).from_string(_text("page.html"))
