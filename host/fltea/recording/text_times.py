"""Dates and times of day in text, which become seconds before anything else is read of a line (pure).

Seconds are those of Unix time where there is a date, else those since midnight. A line stays one line, so a
block is turned at once. `22:13:20.123 -> ` is what Arduino's monitor writes before a line.
"""

import re
from datetime import date
from functools import lru_cache

_CLOCK = (
    r"(?P<h>\d\d?):(?P<m>\d\d):(?P<s>\d\d)(?:\.(?P<f>\d+)|,(?P<g>\d+)(?=[;\t\"]|\s*->|[ ]+[-+\d]))?"
    r"(?:\s?(?P<half>[AaPp])\.?[Mm]\b\.?)?(?:\s?(?P<zone>Z|UTC|[+-]\d\d:?\d\d)(?![\d:]))?"
)
_DAY = (
    r"(?P<y>\d{4})[-/.](?P<mo>\d\d?)[-/.](?P<d>\d\d?)"
    r"|(?P<a>\d\d?)(?P<sign>[-/.])(?P<b>\d\d?)[-/.](?P<c>\d{4}|\d\d)"
)
_TIME = re.compile(rf'"?(?<![\w:.])(?:(?:{_DAY})(?:[T]|\s+|,\s))?{_CLOCK}(?![\w:])"?', re.M)
_MINUTES = re.compile(r"(?<![\w:.])(\d{1,3}):(\d\d)([.,]\d+)(?![\w:])")
"""Minutes and seconds, as Excel shows short times."""

A_CLOCK = re.compile(rb"\d:[0-5]\d")
"""Without which there is none in some bytes, and they need no closer look."""

_DECIMAL_COMMAS = re.compile(r"[;\t][-+ ]*\d+,\d")
"""In a line whose fields are separated by other signs."""

_ARROW = re.compile(r"^(\d+(?:[.,]\d+)?) -> ?([^\n]*)", re.M)


def with_seconds(text: str) -> str:
    """Return lines with seconds in place of dates and times of day."""
    with_commas = _DECIMAL_COMMAS.search(text) is not None
    found = _TIME.sub(lambda m: _seconds(m, "," if with_commas else "."), text)
    found = _MINUTES.sub(lambda m: f"{60 * int(m[1]) + int(m[2])}{m[3].replace(',', '.')}", found)
    return _ARROW.sub(_before_line, found) if " -> " in found else found


def _seconds(found: re.Match[str], mark: str) -> str:
    part = found.groupdict()
    seconds = 3600 * int(part["h"]) + 60 * int(part["m"]) + int(part["s"])
    if part["half"]:
        seconds += 43_200 * ((part["half"] in "pP") - (int(part["h"]) == 12))
    zone = part["zone"]
    if zone and zone[0] in "+-":
        seconds -= (1 if zone[0] == "+" else -1) * (3600 * int(zone[1:3]) + 60 * int(zone[-2:]))
    if part["y"] or part["a"]:
        day = _day(part["y"], part["mo"], part["d"]) if part["y"] else _day_of(part)
        if day is None:
            return found[0]
        seconds += 86_400 * day
    fraction = part["f"] or part["g"]
    return f"{seconds}{mark}{fraction}" if fraction else str(seconds)


def _day_of(part: dict[str, str]) -> int | None:
    """Day and month stand in either order: the day is first before a point, or if the number is above 12."""
    day_first = part["sign"] == "." or int(part["a"]) > 12
    day, month = (part["a"], part["b"]) if day_first else (part["b"], part["a"])
    return _day(part["c"] if len(part["c"]) == 4 else f"20{part['c']}", month, day)


@lru_cache(maxsize=64)
def _day(year: str, month: str, day: str) -> int | None:
    """Days since 1970."""
    try:
        return date(int(year), int(month), int(day)).toordinal() - date(1970, 1, 1).toordinal()
    except ValueError:
        return None


def _before_line(found: re.Match[str]) -> str:
    """The time as one more column of the line: a number, a label with its number, or a name before names."""
    seconds, line = found[1], found[2]
    if re.match(r'\s*[-+\d.,"]', line):
        separator = next((mark for mark in "\t;," if mark in line), " ")
        return f"{seconds}{separator}{line}"
    if re.search(r"[:=]\s*\[?\s*[-+]?\d", line) or "[" in line:
        return f"time={seconds}; {line}"
    before_names = next((mark for mark in "\t;," if mark in line), "")
    return f"time{before_names}{line}" if before_names and not re.search(r"\d\s*$", line) else line
