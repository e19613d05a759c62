"""Converts dates and times of day in a text to seconds, before the rest of each line is read.

Seconds are Unix time if there is a date, else seconds since midnight. The number of lines does not change, so
many lines can be converted at a time. Arduino's monitor writes `22:13:20.123 -> ` before each line.
"""

import re
from collections.abc import Sequence
from datetime import date
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fltea.recording.wanted import is_missing

_MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
_MONTH = f"(?i:{'|'.join(_MONTHS)})[a-z]{{0,6}}"
_DAY = (
    r"(?P<y>\d{4})[-/.](?P<mo>\d\d?)[-/.](?P<d>\d\d?)"
    r"|(?P<a>\d\d?)(?P<sign>[-/.])(?P<b>\d\d?)[-/.](?P<c>\d{4}|\d\d)"
    rf"|(?P<day>\d\d?)(?:st|nd|rd|th)?[- ](?P<name>{_MONTH})\.?[- ](?P<year>\d{{4}}|\d\d)"
    rf"|(?P<american>{_MONTH})\.? (?P<day_>\d\d?)(?:st|nd|rd|th)?,? (?P<year_>\d{{4}})"
)
_WEEKDAY = "(?:(?i:mon|tue|wed|thu|fri|sat|sun)[a-z]*,? )?"
_HOUR = re.compile(
    rf"(?<![\w:.])(?:{_WEEKDAY}(?:{_DAY})(?:T|[^\S\t]+|,\s|(?P<column>\"?[,;\t]\"?)))?(?P<h>\d\d?)$"
)
"""Matches the date, if any, and the hour in the text before the first colon of a time of day.

The group `column` matches what separates the date from the time if the date is a column of its own.
"""

_LONGEST_BEFORE = 40

_CLOCK = re.compile(
    r":(?<=\d:)([0-5]?\d)(?::([0-5]?\d)"
    r"(?:([.:])(\d+)|,(\d+)(?=[;\t\"]|\s*->|[ ]+[-+\d]))?"
    r"(?:\s?([AaPp])\.?[Mm]\b\.?)?(?:\s?(Z|UTC|GMT|[+-]\d\d:?\d\d)(?![\d:]))?|(?<=:\d\d)([.,])(\d+))(?![\w:])"
)
"""Matches a time of day from its first colon on. The last two groups match the fraction of seconds in times
of the form `59:30.5`, minutes and seconds, as Excel writes them.
"""

_SECONDS = re.compile(r"\s*(\d+)(?:[.,](\d+))?\s*")
"""Matches a time that `Clocks` has converted to seconds."""

_MINUTES = re.compile(r"(?<![\w:.])\d{1,3}$")

A_CLOCK = re.compile(rb"\d:[0-5]?\d[:.,]")
"""Matches bytes that may belong to a time of day. Lines without a match are not converted, which saves time.
"""

_DECIMAL_COMMAS = re.compile(r"[;\t][-+ ]*\d+,\d")
"""Matches a number with a decimal comma in a line whose fields have other separators."""

_ARROW = re.compile(r"^(\d+(?:[.,]\d+)?) -> ?([^\n]*)", re.M)

_LAST = re.compile(r"^[^\n]*?(\d\d?:\d\d?:\d\d?)([.:])(\d+)(?![\d:])", re.M)
"""Matches the first time of day in a line. The three groups are, for `9:46:40.5`: `9:46:40`, the sign `.` (or
`:`) after it, and the digits `5`.
"""

_ENOUGH = 1 << 14
"""Number of characters of a block that are examined to find how fractions of seconds are written."""


class Clocks:
    """Converts the times of one text to seconds, a block of whole lines at a time.

    What follows the seconds can mean three things:
    - Digits after a point are a fraction. But WitMotion's SDK writes 5 ms as `9:46:40.5`: milliseconds
      without leading zeros. `_examine` finds out whether a text is written so.
    - Digits after a third colon are milliseconds; WitMotion's programs write them.
    - But if there are always two digits after the third colon, they may be the number of a film's frame. Such
      times are not converted.
    """

    def __init__(self) -> None:
        self._in_ms: bool | None = None
        self._colon_is_ms = False
        self._last = "", "0"
        self._lengths: set[int] = set()
        self._is_no_fraction = False
        self._order = _DayMonth()

    def with_seconds(self, text: str) -> str:
        """Return lines with seconds in place of dates and times of day."""
        if self._in_ms is None or not self._colon_is_ms:
            self._examine(text[:_ENOUGH])
        with_commas = (";" in text or "\t" in text) and _DECIMAL_COMMAS.search(text) is not None
        mark = "," if with_commas else "."
        pieces: list[str] = []
        done = 0
        for found in _CLOCK.finditer(text):
            colon, end = found.span()
            begin = max(done, colon - _LONGEST_BEFORE, text.rfind("\n", done, colon) + 1)
            before = text[begin:colon]
            seconds = self._seconds(found, before, mark)
            if seconds is None:
                continue
            begin += seconds[0]
            if text[begin - 1 : begin] == '"' == text[end : end + 1] and begin > done:
                begin, end = begin - 1, end + 1
            pieces += text[done:begin], seconds[1]
            done = end
        turned = "".join([*pieces, text[done:]])
        return _ARROW.sub(_before_line, turned) if " -> " in turned else turned

    def _examine(self, text: str) -> None:
        """Find out how the text writes fractions of seconds.

        Milliseconds without leading zeros have one to three digits, and do not begin with a zero: 1.5, 1.10
        and 1.15 are 5, 10 and 15 ms after 1 s. Two signs show that digits of different lengths are no
        fractions. They end in zeros, which a program that writes shortened fractions would drop. Or they
        decrease within a second when read as fractions, as from 0.5 to 0.10.
        """
        for clock, sign, digits in _LAST.findall(text):
            if sign == ":":
                self._colon_is_ms |= len(digits) != 2
            elif self._in_ms is None:
                last_clock, last = self._last
                is_same = clock == last_clock
                begins_with_0, ends_in_0 = (len(digits) > 1 and digits[k] == "0" for k in (0, -1))
                self._lengths.add(len(digits))
                self._is_no_fraction |= ends_in_0 or (is_same and float(f".{digits}") < float(f".{last}"))
                if len(digits) > 3 or begins_with_0 or (is_same and int(digits) < int(last)):
                    self._in_ms = False
                elif len(self._lengths) > 1 and self._is_no_fraction:
                    self._in_ms = True
                self._last = clock, digits

    def _seconds(self, found: re.Match[str], before: str, mark: str) -> tuple[int, str] | None:
        """Return the index in `before` at which a time begins, and the time in seconds; None if it is none.

        `found`: match of `_CLOCK`, from the first colon of the time on. `before`: text before this match,
        which ends in the hour. A date may stand before the hour.
        """
        m, s, sign, digits, behind_comma, half, zone, _, fraction = found.groups()
        if s is None:
            minutes = _MINUTES.search(before)
            if minutes is None:
                return None
            return minutes.start(), f"{60 * int(minutes[0]) + int(m)}.{fraction}"
        if (hour := _hour(before)) is None or (sign == ":" and not self._colon_is_ms):
            return None
        days = self._order.days(*hour.days) if hour.is_either else hour.days[0]
        if days is None:
            return None
        seconds = 86_400 * days + 3600 * hour.hour + 60 * int(m) + int(s)
        if half:
            seconds += 43_200 * ((half in "pP") - (hour.hour == 12))
        if zone and zone[0] in "+-":
            seconds -= (1 if zone[0] == "+" else -1) * (3600 * int(zone[1:3]) + 60 * int(zone[-2:]))
        if digits and (sign == ":" or self._in_ms):
            digits = digits.zfill(3)
        digits = digits or behind_comma
        return hour.begin, f"{seconds}{mark}{digits}" if digits else str(seconds)


def with_seconds(text: str) -> str:
    """Return lines with seconds in place of dates and times of day."""
    return Clocks().with_seconds(text)


def points_of_time(texts: Sequence[str | None], *, is_known: bool = False) -> NDArray[np.datetime64] | None:
    """Return the times in a column of dates or times of day; None if the column holds neither.

    After midnight, a day is added to times of day, so that the times go on rising.

    `is_known`: whether the column is known to hold times. If so, texts that are no times count as missing.
    """
    plain = ["" if text is None or is_missing(text) else text.replace("\n", " ") for text in texts]
    if not is_known and ":" not in next(filter(None, plain), ""):
        return None
    known = [
        (k, _SECONDS.fullmatch(line))
        for k, line in enumerate(with_seconds("\n".join(plain)).split("\n"))
        if plain[k]
    ]
    found = np.full(len(plain), np.datetime64("NaT", "ns"))
    day = 86_400 * 10**9
    last = passed = 0
    for k, seconds in known:
        if seconds is None or ":" not in plain[k]:
            if is_known:
                continue
            return None
        ns = int(seconds[1]) * 10**9 + int((seconds[2] or "")[:9].ljust(9, "0"))
        passed += day if ns < day and last - ns > day // 2 else 0
        found[k], last = np.datetime64(ns + passed, "ns"), ns
    return found


class _DayMonth:
    """Order of day and month in dates such as 03/05/2023, the same for a whole text.

    A number above 12 shows the order. Otherwise the next different date shows the order, since successive
    dates are near each other. Until the order is known, the month is assumed to stand first. If this turns
    out to be wrong, the earlier dates were read wrongly. Then all later dates are shifted by a constant
    number of days, so that no false gap comes between. The shift does no harm, since only steps between dates
    are used.
    """

    def __init__(self) -> None:
        self._is_day_first: bool | None = None
        self._shift = 0
        self._newest: tuple[int, int] | None = None

    def days(self, month_first: int | None, day_first: int | None) -> int | None:
        """Return the number of days from 1970 to a date, or None if there is no such date.

        `month_first`: number of days if the month stands before the day in the text. `day_first`: number of
        days if the day stands before the month. Each is None if there is no such date, as for month 13.
        """
        newest = self._newest
        if self._is_day_first is None and (month_first is None or day_first is None):
            self._is_day_first = month_first is None
        elif self._is_day_first is None and month_first is not None and day_first is not None:
            if newest is not None:
                steps = abs(month_first - newest[0]), abs(day_first - newest[1])
                self._is_day_first = None if steps[0] == steps[1] else steps[1] < steps[0]
            self._newest = month_first, day_first
        if self._is_day_first and newest is not None:
            self._shift, self._newest = newest[0] - newest[1], None
        if self._is_day_first:
            return None if day_first is None else day_first + self._shift
        return month_first


class _Hour(NamedTuple):
    """The date and the hour that stand before the minutes in a text.

    `begin`: index in the text at which the date begins, or the hour if the date is a column of its own.
    `days`: two numbers of days from 1970 to the date. The first holds if the month stands before the day, the
    second if the day stands before the month. None in place of a number means that there is no such date.
    `is_either`: whether the form of the date allows both orders.
    """

    begin: int
    hour: int
    days: tuple[int | None, int | None]
    is_either: bool


@lru_cache(maxsize=256)
def _hour(before: str) -> _Hour | None:
    """Return the date and hour at the end of a text, or None."""
    found = _HOUR.search(before)
    if found is None:
        return None
    part, hour = found.groupdict(), int(found["h"])
    begin = found.start("h") if part["column"] else found.start()
    name = part["name"] or part["american"]
    if part["y"]:
        day = _day(part["y"], part["mo"], part["d"])
    elif part["a"]:
        day = _day(part["c"], part["b"], part["a"])
        if part["sign"] != ".":  # in dates with full stops, the day is first
            month_first = _day(part["c"], part["a"], part["b"])
            if not part["column"] or month_first is not None or day is not None:
                return _Hour(begin, hour, (month_first, day), is_either=True)
    elif name:
        month = str(_MONTHS.index(name[:3].lower()) + 1)
        day = _day(part["year"] or part["year_"], month, part["day"] or part["day_"])
    else:
        day = 0
    if day is None and part["column"]:  # the time of day is known, though there is no such date
        day = 0
    return _Hour(begin, hour, (day, day), is_either=False)


def _day(year: str, month: str, day: str) -> int | None:
    """Return the days from 1970 to a date; None if there is no such date."""
    try:
        return (
            date(int(year if len(year) == 4 else f"20{year}"), int(month), int(day)) - date(1970, 1, 1)
        ).days
    except ValueError:
        return None


def _before_line(found: re.Match[str]) -> str:
    """Return a line from Arduino's monitor, which writes `TIME -> LINE`, with the time as its first column.

    The time gets the form of the other columns: a number, or `time=` and a number if they have labels. A line
    of column names gets the name `time`.
    """
    seconds, line = found[1], found[2]
    if re.match(r'\s*[-+\d.,"]', line):
        separator = next((mark for mark in "\t;," if mark in line), " ")
        return f"{seconds}{separator}{line}"
    if re.search(r"[:=]\s*\[?\s*[-+]?\d", line) or "[" in line:
        return f"time={seconds}; {line}"
    before_names = next((mark for mark in "\t;," if mark in line), "")
    return f"time{before_names}{line}" if before_names and not re.search(r"\d\s*$", line) else line
