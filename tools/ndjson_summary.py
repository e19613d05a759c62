"""NDJSON of `fltea run` as one line a second: what is known of each axis, or the start-up count."""

import json
from typing import Any

from fltea.sinks.page.words import with_std


class Summary:
    """Takes the records of one run; gives a line for each `stats` record, which comes once a second."""

    def __init__(self) -> None:
        self._axes: dict[str, dict[str, Any]] = {}
        """By device: axes of the last estimate of the present epoch."""
        self._errors: dict[str, int] = {}
        """By device: errors since its last line."""

    def line(self, text: str) -> str | None:
        """Take a line of NDJSON; what is to be shown for it, if anything, and what is no record as it is."""
        try:
            record = json.loads(text)
            kind, device = record["class"], record["device"]
        except (ValueError, KeyError, TypeError):
            return text
        match kind:
            case "epoch":
                self._axes.pop(device, None)
            case "estimate":
                self._axes[device] = record["axes"]
            case "error":
                self._errors[device] = self._errors.get(device, 0) + 1
            case "stats":
                return self._of_stats(device, record)
        return None

    def _of_stats(self, device: str, stats: dict[str, Any]) -> str:
        samples, axes = stats["samples"], self._axes.get(device)
        parts = [f"{samples['delivered']} samples, {samples['lost']} lost"]
        if axes is not None:
            parts += [f"{name} {_axis(axis)}" for name, axis in axes.items()]
        elif stats["startup_remaining"]:
            parts.append(f"start-up: {stats['startup_remaining']} samples to go")
        if errors := self._errors.pop(device, 0):
            parts.append(f"{errors} errors")
        return f"{device}: " + "; ".join(parts)


def _axis(axis: dict[str, Any]) -> str:
    """The verdict, α and f with their intervals where there is an order, and the bias."""
    verdict = axis["verdict"] or "no stable verdict yet"
    order = [f"{name} {p}" for name in ("alpha", "f") if (p := _interval(axis[name]))]
    words = [verdict, *(text.replace("alpha", "α") for text in order)]
    if axis["bias"] is not None and axis["bias_std"] is not None:
        words.append(f"bias {with_std(axis['bias'], axis['bias_std'])} {axis['unit']}")
    return ", ".join(words) + (", moving" if axis["moving"] else "")


def _interval(p: dict[str, float | None]) -> str:
    value, low, high = p["value"], p["low"], p["high"]
    if value is None or low is None or high is None:
        return ""
    return f"{value:.2f} [{low:.2f}, {high:.2f}]".replace("-0.00", "0.00")
