"""What the page says of an axis's fit: in words, and in no figure that the data do not support (pure)."""

import math
from typing import Any, NamedTuple

from fltea.records.fit import AxisFit, Interval, VerdictKind
from fltea.sinks.page.words import duration

HEADS: dict[VerdictKind, str] = {
    "white": "White noise: order undefined",
    "drift": "Drift",
    "filter or resonance": "Filter or resonance",
    "AR(1)": "Relaxation, AR(1)",
    "fractional": "Fractional",
    "undecided": "Undecided",
    "not stationary": "Not stationary",
    "constant": "Constant",
    "too few samples": "Still too short",
}

WITH_ORDER = ("fractional", "undecided")
"""Verdicts that leave room for an order; all others say that there is none to speak of."""

NO_FIT = "It comes within seconds of the first samples."
OFF = "Nothing is fitted: live.on is false."

LEFT_OUT = {
    "lost": "lost",
    "knocked": "in knocks",
    "bridged": "bridged",
}
"""What became of samples, by cause."""


class Answer(NamedTuple):
    """The words for one axis. kind: of the verdict, empty without a fit; alpha, f: None where undefined."""

    kind: str
    head: str
    text: str
    alpha: tuple[str, str] | None
    f: tuple[str, str] | None
    condition: str
    until: str
    left_out: str

    def plain(self) -> dict[str, Any]:
        """As plain data."""
        return self._asdict()


def answer(fit: AxisFit | None, *, off: bool = False) -> Answer:
    """Put a fit into words. off: nothing is fitted."""
    if fit is None:
        return Answer("", "No fit" if off else "No fit yet", OFF if off else NO_FIT, None, None, "", "", "")
    alpha, f = order(fit)
    return Answer(
        fit.verdict,
        HEADS[fit.verdict],
        fit.text,
        _with_interval(alpha, 2),
        _with_interval(f, 1),
        "if the noise is of fractional order" if fit.verdict == "undecided" and alpha else "",
        _until(fit),
        _left_out(fit),
    )


def order(fit: AxisFit) -> tuple[Interval | None, Interval | None]:
    """α and f, each only if the verdict leaves room for an order and the data define it."""
    if fit.verdict not in WITH_ORDER:
        return None, None
    alpha, f = (p if _defined(p) else None for p in (fit.alpha, fit.f))
    return alpha, f


def _defined(p: Interval) -> bool:
    return all(v is not None and math.isfinite(v) for v in (p.value, p.low, p.high))


def _with_interval(p: Interval | None, least: int) -> tuple[str, str] | None:
    """Value and interval, with as many digits as the interval is worth, and at least `least`."""
    if p is None or p.value is None or p.low is None or p.high is None:
        return None
    half = (p.high - p.low) / 2
    digits = min(max(math.ceil(-math.log10(half / 2)), least), 4) if half > 0 else 4
    value, low, high = (f"{v:.{digits}f}".replace("-", "\u2212") for v in (p.value, p.low, p.high))
    return value, f"{low} … {high}"


def _until(fit: AxisFit) -> str:
    """How long it takes until the order is known well enough."""
    until = fit.until_s
    if until is None or fit.verdict in ("constant", "too few samples"):
        return ""
    target = f"α ± {until.target:g}"
    if until.seconds is None:
        return f"{target}: more data do not define it"
    if fit.verdict not in WITH_ORDER:
        return ""
    return f"{target} in {duration(until.seconds)}" if until.seconds > 0 else f"{target}: reached"


def _left_out(fit: AxisFit) -> str:
    """What the fit does without."""
    bands = [f"{low:.3g} to {high:.3g} Hz" for low, high in fit.rate_left_out]
    counts = [
        f"{count:,} {'sample' if count == 1 else 'samples'} {LEFT_OUT.get(cause, cause)}"
        for cause, count in fit.left_out.items()
        if count
    ]
    if not bands and not counts:
        return ""
    more = f" and {len(bands) - 3} bands more" if len(bands) > 3 else ""
    return "Left out: " + "; ".join([", ".join(bands[:3]) + more] * bool(bands) + counts)
