"""Send to each page the parts of a device's state that have changed.

The server keeps nothing about a visitor. A page's request names the parts that the page shows, each with the
checksum of its content, and how many rows of numbers the page has. So the server can send what a page lacks,
even if the page has not asked for a while, or was loaded from an earlier run of the program. A part is made
only when a page requests it, and at most about once a second.
"""

import math
import time
import zlib
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import msgspec

from fltea.records import clock
from fltea.records.arrays import Array
from fltea.records.ports import Recorder
from fltea.sinks.page import facts, facts_of_device, recording
from fltea.sinks.page.course import Course
from fltea.sinks.page.history import DeviceHistory
from fltea.sinks.page.tiers import MOST_ROWS, WINDOWS, Cursor

FRESH_S = 0.8
"""A requested part is made again if it is at least this old [s]. Each page asks once a second."""

MOST_KEPT = 256

DRAWN_WINDOW = 1
"""Index in `WINDOWS` of the time window that each axis's small diagram shows. This window is 2 min long."""


class View(NamedTuple):
    """What a visitor has chosen to see: a device, its open axis or "", and the index of a time window."""

    device: str
    axis: str
    window: int


class Part(NamedTuple):
    """One part of the page's content as JSON, with its checksum and the monotonic time when it was made."""

    json: bytes
    checksum: str
    made_s: float


def _of(make: Callable[[DeviceHistory], Any]) -> Callable[[DeviceHistory, View], Any]:
    return lambda history, view: make(history)


PARTS: dict[str, Callable[[DeviceHistory, View], Any]] = {
    "now": lambda history, view: facts.now(history, clock.host_ns()),
    "axes": _of(facts.axes),
    "link": _of(lambda history: facts.link(history.stats)),
    "hardware": _of(
        lambda history: facts.device(history.hello, history.sample.temperature_c if history.sample else None)
    ),
    "own": _of(facts_of_device.own),
    "events": _of(facts.events),
    "axis": lambda history, view: facts.axis(history, view.axis, view.window) if view.axis else None,
    "marks": lambda history, view: facts.marks(history, view.axis, view.window) if view.axis else None,
    "spectra": _of(facts.spectra),
    "curves": lambda history, view: facts.curves(history, view.axis) if view.axis else [],
}
"""For each part of the page, the function that makes its content. The caller holds the lock of the device's
history.
"""

OF_VIEW = {"axis", "curves", "marks"}
"""Parts whose content depends on device, axis and time window. All other parts depend only on the device."""


class State:
    """Answers the requests of pages. All methods run in one thread.

    `recorder`: knows the state of the recordings. `may_record`: whether pages may begin and end recordings.
    """

    def __init__(
        self,
        histories: Mapping[str, DeviceHistory],
        recorder: Recorder | None = None,
        may_record: bool = False,
    ) -> None:
        self._histories = histories
        self._recorder, self._may_record = recorder, may_record
        self._kept: dict[tuple[str, View], Part] = {}

    def view(self, device: str, axis: str, window: int) -> View:
        """Return the requested device, axis and window.

        A device that does not exist is replaced by the first device, and an axis that does not exist by "".
        An index that is too large becomes the index of the last window.
        """
        if device not in self._histories:
            device = next(iter(self._histories))
        return View(
            device,
            axis if axis in self._histories[device].axes else "",
            min(window, len(WINDOWS) - 1),
        )

    def read(
        self, view: View, had: Mapping[str, str], cursor: str | None = None, drawn: str | None = None
    ) -> bytes:
        """Return, as JSON, what has changed since the page's last request.

        `had`: the names of the parts that the page shows, each with the checksum of what the page has.
        `cursor`: says which rows the page has for the diagrams of the open axis; it is the cursor in the
        server's last answer. None: the page needs no rows. `drawn`: the same for the small diagrams.
        """
        parts = {}
        for name in had:
            if name in PARTS or name in ("devices", "recording"):
                part = self._part(name, view)
                if part.checksum != had[name]:
                    parts[name] = [part.checksum, msgspec.Raw(part.json)]
        found = {"device": view.device, "axis": view.axis, "window": view.window, "parts": parts}
        if cursor is not None and view.axis:
            found |= self._rows(view.device, view.window, cursor, lambda course: course.columns(view.axis))
        if drawn is not None:
            found["drawn"] = self._rows(view.device, DRAWN_WINDOW, drawn, Course.drawn)
        return msgspec.json.encode(found)

    def _part(self, name: str, view: View) -> Part:
        key = name, view if name in OF_VIEW else View(view.device, "", 0)
        kept, now_s = self._kept.get(key), time.monotonic()
        if kept is not None and now_s - kept.made_s < FRESH_S:
            return kept
        if len(self._kept) >= MOST_KEPT:
            self._kept.clear()
        encoded = msgspec.json.encode(self._make(name, view))
        self._kept[key] = part = Part(encoded, f"{zlib.crc32(encoded):08x}", now_s)
        return part

    def _make(self, name: str, view: View) -> Any:
        if name == "devices":
            return [facts.state(history, clock.host_ns()) for history in self._histories.values()]
        if name == "recording":
            recorder = self._recorder
            return (
                recording.words(recorder.view(view.device), self._may_record)
                if recorder
                else recording.nothing()
            )
        history = self._histories[view.device]
        with history.lock:
            return PARTS[name](history, view)

    def _rows(
        self, device: str, window: int, cursor: str, places_of: Callable[[Course], dict[str, int]]
    ) -> dict[str, Any]:
        """Return the rows of numbers that the page lacks, and the time at which its diagrams end.

        `places_of`: function that returns the names of the wanted columns, each with its index in a row.
        """
        history = self._histories[device]
        generation, _, rows = cursor.partition(".")
        known = Cursor(int(generation), int(rows)) if generation.isdigit() and rows.isdigit() else Cursor()
        with history.lock:
            end_ms = history.sample.host_ns * 1e-6 if history.sample else 0.0
            new = history.course.read(window, known)
            places = places_of(history.course)
        columns = {name: _short(new.values[:, place], name) for name, place in places.items()}
        return {
            "end_ms": round(end_ms),
            "length_ms": WINDOWS[window].length_s * 1e3,
            "cursor": f"{new.cursor.generation}.{new.cursor.rows}",
            "fresh": new.fresh,
            "most": MOST_ROWS,
            "rows": {n: c for n, c in columns.items() if n == "time" or any(v is not None for v in c)},
        }


def _short(values: Array, name: str) -> list[float | None]:
    """Return numbers rounded to the digits that a diagram can show, with None in place of NaN."""
    if name == "time":
        return [round(v) for v in values.tolist()]
    return [float(f"{v:.5g}") if math.isfinite(v) else None for v in values.tolist()]
