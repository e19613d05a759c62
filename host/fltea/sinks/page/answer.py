"""Describe an axis's fit in words for the page. Only figures that the data support are shown."""

import math
from typing import NamedTuple

from fltea.records.fit import AxisFit, Interval
from fltea.records.odds import odds
from fltea.records.verdict_kinds import VERDICT_KINDS, WITH_ORDER
from fltea.sinks.words import about

UNSTABLE = "No stable verdict yet"
NOT_YET = "Two fits must agree, the later one with a tenth more samples. The newest one says: {}."
NO_FIT = "The first fit comes within seconds of the first samples."
OFF = "Nothing is fitted: live.on is false."

LEFT_OUT = {
    "lost": "lost",
    "knocked": "in knocks",
    "moved": "in motion",
    "bridged": "bridged",
    "limited": "limited to twelve deviations",
}
"""For each cause for which samples are left out of the fit: the words that follow the number of these samples
in a sentence.
"""

BREAKS = {
    "steps": ("step of the offset", "steps of the offset"),
    "changes": ("lasting change of the power", "lasting changes of the power"),
}
"""For each kind of change that interrupts the record but leaves no samples out: the words for one such
change, and for several.
"""


NARROW = 1.25
"""The page says that a target for α, such as α ± 0.05, is reached if the interval of α is at most this many
times as wide as the target.
"""


class Figure(NamedTuple):
    """A parameter with its 95 % interval, as text.

    `large`: whether the interval is narrow enough to show the value itself.
    """

    value: str
    interval: tuple[str, str]
    large: bool

    @property
    def text(self) -> str:
        """The value with its interval. If the interval is too wide to show the value, the interval alone."""
        low, high = self.interval
        return f"{self.value} ({low} … {high})" if self.large else f"{low} … {high}"

    def said(self, name: str) -> str:
        """Return name, value and interval as part of a sentence, such as "α between 0.1 and 0.7"."""
        low, high = self.interval
        return f"{name} = {self.text}" if self.large else f"{name} between {low} and {high}"


class Answer(NamedTuple):
    """The description of one axis in words.

    `kind`: kind of the verdict; empty without a stable verdict. `alpha`, `f`: None if unknown. `until`: text
    that says when α will be known well enough.
    """

    kind: str
    head: str
    text: str
    alpha: Figure | None
    f: Figure | None
    condition: str
    until: str
    left_out: str


def answer(fit: AxisFit | None, left_s: float | None = None, *, off: bool = False) -> Answer:
    """Describe a fit in words.

    `left_s`: time until the order will be known [s]; None unless the last fits agree on this time. `off`:
    whether fits are switched off.
    """
    if fit is None:
        return Answer("", "No fit" if off else "No fit yet", OFF if off else NO_FIT, None, None, "", "", "")
    kind = VERDICT_KINDS[fit.verdict]
    if not fit.stable and not kind.says_nothing:
        return Answer("", UNSTABLE, NOT_YET.format(kind.head), None, None, "", "", _left_out(fit))
    alpha, f = order(fit)
    return Answer(
        fit.verdict,
        kind.head,
        fit.text,
        _figure(alpha, 2, 0.3),
        _figure(f, 1, max(0.5, abs(f.value or 0.0) / 2) if f else 0.0),
        _condition(fit) if alpha else "",
        _until(fit, left_s),
        _left_out(fit),
    )


def _condition(fit: AxisFit) -> str:
    """Return the text "if the noise is of fractional order", with the odds that it is, if they are known.

    The text is empty unless the verdict leaves open whether the noise has an order, such as "undecided".
    """
    if VERDICT_KINDS[fit.verdict].order != "perhaps":
        return ""
    known = "" if fit.odds is None else f" (odds {odds(fit.odds)})"
    return f"if the noise is of fractional order{known}"


def sentence(found: Answer, level: str, bias: str) -> tuple[str, str]:
    """Return a sentence about an axis as two texts: the verdict, and a colon with all else that is known.

    `level`: N and the error of the heading, as text. `bias`: the bias as text.
    """
    head = found.head.partition(":")[0]
    if not found.kind:
        known = "" if found.head != UNSTABLE else "two fits have to agree"
    elif found.alpha is None:
        known = ""
    else:
        f = f"{found.f.said('f')} s^\u2212α" if found.f else "f undefined"
        known = f"{found.alpha.said('α')}, {f}"
    if found.condition:
        known += f", {found.condition}"
    until = "" if found.kind and found.kind not in WITH_ORDER else found.until
    rest = "; ".join(part for part in (known, level, bias, until) if part)
    return head, f": {rest}." if rest else "."


def order(fit: AxisFit) -> tuple[Interval | None, Interval | None]:
    """Return α and f.

    A parameter is None unless three things are true: the verdict is stable, it allows an order, and the data
    define the parameter.
    """
    if fit.verdict not in WITH_ORDER or not fit.stable:
        return None, None
    alpha, f = (p if _defined(p) else None for p in (fit.alpha, fit.f))
    return alpha, f


def _defined(p: Interval) -> bool:
    return all(v is not None and math.isfinite(v) for v in (p.value, p.low, p.high))


def figure_of(p: Interval) -> Figure | None:
    """Return α as text with its interval. Return None if value or interval are undefined."""
    return _figure(p, 2, 0.3) if _defined(p) else None


def _figure(p: Interval | None, digits: int, widest: float) -> Figure | None:
    """Return a parameter as text, with as many digits as its interval justifies.

    `digits`: smallest number of decimals. `widest`: if half the width of the interval is larger than this,
    only the interval is shown, without the value.
    """
    if p is None or p.value is None or p.low is None or p.high is None:
        return None
    half = (p.high - p.low) / 2
    digits = min(max(math.ceil(-math.log10(half / 2)), digits), 4) if half > 0 else 4
    value, low, high = (_fixed(v, digits) for v in (p.value, p.low, p.high))
    return Figure(value, (low, high), half <= widest)


def _fixed(value: float, digits: int) -> str:
    """Return a number as text with the character − (U+2212) as minus. Zero has no sign."""
    text = f"{value:.{digits}f}"
    return text.lstrip("-") if float(text) == 0 else text.replace("-", "\u2212")


def _until(fit: AxisFit, left_s: float | None) -> str:
    """Return the text for the time until α is known well enough.

    The text names a time only if the last fits agree on the time.
    """
    until = fit.until_s
    if until is None or VERDICT_KINDS[fit.verdict].says_nothing:
        return ""
    target = f"α ± {until.target:g}"
    if until.seconds is None:
        return f"more data do not define α to ± {until.target:g}"
    if fit.verdict not in WITH_ORDER:
        return ""
    if until.seconds > 0:
        return f"{target} in {about(left_s)}" if left_s else f"{target}: too early to say when"
    a = fit.alpha
    if a.low is None or a.high is None or a.high - a.low > 2 * NARROW * until.target:
        # the predicted time has passed, but the interval of α is wider than was predicted
        return f"{target}: nobody can say when yet"
    return f"{target}: reached"


def _left_out(fit: AxisFit) -> str:
    """Return a text that lists the samples and frequencies that the fit leaves out."""
    bands = [f"{low:.3g} to {high:.3g} Hz" for low, high in fit.rate_left_out]
    counts = [
        f"{count:,} {'sample' if count == 1 else 'samples'} {LEFT_OUT.get(cause, cause)}"
        for cause, count in fit.left_out.items()
        if count
    ]
    for cause, (one, more_of) in BREAKS.items():
        if often := fit.breaks.get(cause, 0):
            counts.append(f"{often:,} {one if often == 1 else more_of}")
    if not bands and not counts:
        return ""
    more = f" and {len(bands) - 3} bands more" if len(bands) > 3 else ""
    return "Left out: " + "; ".join([", ".join(bands[:3]) + more] * bool(bands) + counts)
