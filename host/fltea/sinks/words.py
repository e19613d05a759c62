"""Format numbers for the page, the table and the log."""

import math
from collections.abc import Mapping
from typing import Literal

from fltea.records.plus_minus import fixed
from fltea.records.stats import CAUSE_WORDS

Level = Literal["good", "wait", "bad", "plain"]


def figure(value: float, digits: int, *, significant: bool = False) -> str:
    """Return a number as text with decimals, or with a power of ten if the number is huge.

    Huge numbers come from filters that diverge.
    """
    if significant:
        return f"{value:.{digits}g}"
    return fixed(value, digits)


def quantity(value: float | None, unit: str, digits: int, *, significant: bool = False) -> str:
    """Return a number with its unit as text; a dash if the number is None."""
    return "–" if value is None else f"{figure(value, digits, significant=significant)} {unit}".rstrip()


def signed(value: float) -> str:
    """Return a number as text with its sign and three decimals. The minus is the character − (U+2212)."""
    return f"{value:+.3f}".replace("-", "\u2212")


def apart(value: float) -> str:
    """Return a small difference as text, with a sign and a power of ten."""
    if not value:
        return "0"
    mantissa, _, exponent = f"{value:+.1e}".partition("e")
    return f"{mantissa}e{int(exponent)}"


def in_deviations(value: float | None, std: float | None) -> str:
    """Return a value divided by its standard deviation, as text; empty if one of the two is unknown."""
    return f"{value / std:+.1f} σ" if value is not None and std else ""


def guard_words(interventions: Mapping[str, int]) -> list[list[str]]:
    """Return why the guard of an axis's filters acted, as rows of the page: a reason, and how often.

    The guard limits the values of a filter, such as α, and softens outliers.
    """
    return [[CAUSE_WORDS.get(cause, cause), str(count)] for cause, count in interventions.items()]


def counted(label: str, count: int, remark: str = "") -> list[str]:
    """Return a row of the page for a count of unwanted events.

    The row has a label, the value, and the level "bad" if there were any such events.
    """
    value = f"{count:,}" + (f" ({remark})" if remark else "")
    return [label, value, "bad" if count else "plain"]


def duration(seconds: float) -> str:
    """Return a duration as text for people. `seconds`: duration [s]."""
    s = int(max(seconds, 0))
    if s < 120:
        return f"{s} s"
    if s < 7200:
        return f"{s // 60} min"
    return f"{s // 3600} h" if s < 48 * 3600 else f"{s // 86400} days"


ABOUT_S = (
    10,
    20,
    30,
    *(m * 60 for m in (1, 2, 3, 5, 10, 20, 30, 45)),
    *(h * 3600 for h in (1, 2, 3, 5, 10, 24)),
)


def about(seconds: float) -> str:
    """Return a roughly known duration as text, rounded. `seconds`: duration [s]."""
    if seconds > 1.5 * ABOUT_S[-1]:
        return f"about {round(seconds / 86400)} days"
    return f"about {duration(min(ABOUT_S, key=lambda one: abs(math.log(one / max(seconds, 1.0)))))}"
