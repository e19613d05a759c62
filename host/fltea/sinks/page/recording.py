"""Return what the page says about a recording, as data that can be encoded as JSON."""

from typing import Any

from fltea.records.ports import RecordingView
from fltea.records.visible import visible_lines

STEADY_S = 20.0
"""The page shows a recording's size per hour only if the recording has lasted at least this long [s]. From a
shorter recording, this size would be too uncertain.
"""

ELSEWHERE = "Recording from this page is off: start fltea with --record or --set dashboard.record=true."


def nothing() -> dict[str, Any]:
    """Return what the page says if no device can be recorded."""
    return {"on": False, "can": False, "level": "plain", "text": ""}


def words(view: RecordingView, may_record: bool) -> dict[str, Any]:
    """Return whether a recording runs, whether its button works, and a text that says where it is stored."""
    level, text = _said(view)
    why_not = view.why_not or (ELSEWHERE if not may_record and not view.on else "")
    can = may_record and not view.fixed and not view.why_not
    return {"on": view.on, "can": can, "level": level, "text": visible_lines(why_not or text)}


def _said(view: RecordingView) -> tuple[str, str]:
    free = "" if view.free_bytes is None else f", {size(view.free_bytes)} free"
    if not view.on:
        goes = f"Recordings go to {view.folder}{free}."
        if view.file is None:
            return "plain", goes
        return "good", f"Recorded {size(view.size_bytes)} in {view.folder}/{view.file}. {goes}"
    lost = f" {view.lost:,} items were not recorded." if view.lost else ""
    if view.trouble is not None:
        return "bad", f"NOT recording: {view.trouble}{lost}"
    hourly = ""
    if view.seconds >= STEADY_S:
        hourly = f", {size(view.size_bytes / view.seconds * 3600)} an hour"
    fixed = " It ends with the program (--record)." if view.fixed else ""
    where = view.folder if view.file is None else f"{view.folder}/{view.file}"
    text = f"Recording to {where}: {size(view.size_bytes)} so far{hourly}{free}.{lost}{fixed}"
    return "bad" if lost else "good", text


def size(count: float) -> str:
    """Return a number of bytes as text for people."""
    for unit in ("B", "kB", "MB", "GB"):
        if count < 999.5:
            return f"{count:.3g} {unit}"
        count /= 1000
    return f"{count:,.1f} TB"
