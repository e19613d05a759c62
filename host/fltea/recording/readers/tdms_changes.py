"""Finds the part of a LabVIEW file (TDMS) from which on another unit, rate or scale holds.

Each part may state properties again. The library for TDMS gives those that the last part states, for the
values of all parts.
"""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from fltea.recording.readers.file_facts import SCALES, UNITS, number_of, rate_of
from fltea.recording.readers.tdms_parts import Part, stated_in
from fltea.recording.sample_times import SECONDS
from fltea.recording.units import parse_units, rate_unit, time_scale

SAME = 0.01
"""Rates, and scales, count as equal if their relative difference is at most this."""

_OF_CHANNEL = re.compile(rf"NI_Scal.*|wf_xunit_string|{SCALES}", re.I)
_OF_ALL = re.compile(UNITS, re.I)
_QUOTED = re.compile(r"'((?:[^']|'')*)'")

_Value = str | float | None


class Change(NamedTuple):
    """A part that states another unit, rate or scale than an earlier one: its index, and a text on this."""

    part: int
    what: str


def change_in(path: Path, parts: Sequence[Part]) -> Change | None:
    """Return the first part with data for which a unit, rate or scale holds that differs from before.

    Return None if there is none. What is stated for the first time is not taken for a change.
    """
    used, new = dict[tuple[bytes, bytes], _Value](), dict[tuple[bytes, bytes], _Value]()
    for place, stated in enumerate(stated_in(path, parts)):
        new.update({key: value for key, value in stated.properties.items() if _counts(*key)})
        if not stated.has_data:
            continue
        for (owner, name), value in new.items():
            before = used.get((owner, name))
            if before not in (None, "") and value not in (None, "") and not _same(name, before, value):
                of = ".".join(_QUOTED.findall(owner.decode(errors="replace"))) or "the file"
                text = f"{name.decode(errors='replace')} {_shown(value)} for {of}, and before it"
                return Change(place, f"{text} {_shown(before)}")
        used.update(new)
        new.clear()
    return None


def _counts(owner: bytes, name: bytes) -> bool:
    """Return whether a property states a unit, a rate or a scale."""
    text = name.decode(errors="replace")
    is_of_channel = owner.count(b"'/'") == 1 and _OF_CHANNEL.fullmatch(text)
    return bool(is_of_channel or _OF_ALL.fullmatch(text) or _rate(text, 1.0))


def _rate(name: str, value: _Value) -> float | None:
    """Return the rate that a property states; None if it states none, or the unit of it is not known."""
    return rate_of(name, value) or rate_of(name, value, "Hz") or rate_of(name, value, "s")


def _same(name: bytes, before: _Value, value: _Value) -> bool:
    text = name.decode(errors="replace")
    rates = _rate(text, before), _rate(text, value)
    if rates[0] is not None and rates[1] is not None:
        return abs(rates[1] / rates[0] - 1) <= SAME
    if isinstance(before, str) and isinstance(value, str):
        return before.strip() == value.strip() or _same_unit(before, value)
    old, now = number_of(before), number_of(value)
    return old == now or abs(now - old) <= SAME * abs(old)


def _same_unit(before: str, value: str) -> bool:
    if rate_unit(before) is not None and rate_unit(value) is not None:
        return parse_units(before) == parse_units(value)
    ticks = [SECONDS[one[0]] * one[1] for one in map(time_scale, (before, value)) if one is not None]
    return len(ticks) == 2 and ticks[0] == ticks[1]


def _shown(value: _Value) -> str:
    return f"{value:.6g}" if isinstance(value, int | float) else str(value).strip()
