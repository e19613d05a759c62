"""Finds the sampling rate and the gyroscope's unit where the head of a text states them in words.

The head of a text consists of the lines before the names of the columns.

Examples are `# Sample rate: 100 Hz`, `Sampling Frequency;0.1 kHz`, `dt = 10 ms`; `Units: deg/s`, `gyro in
rad/s`,
`scale: 131 LSB/(deg/s)`. A line that names another sensor, or holds an unknown word, states nothing.
"""

import re
from collections.abc import Iterator
from functools import lru_cache
from typing import NamedTuple

from fltea.recording.files import LONGEST_NAME
from fltea.recording.sample_times import SECONDS
from fltea.recording.units import PER_UNIT, is_unit, rate_unit, time_scale
from fltea.recording.wanted import UNSIGNED

MOST_HZ, LEAST_HZ = 1e5, 0.1
LONGEST_LINE = 300
"""Longest line of a head that is examined [characters]."""

_FACT = re.compile(rf"([^\d:=;,|\t]{{1,60}}?)[ :=;,|\t]*(?<![\w.-])({UNSIGNED})[ ]*([^\s\d,;|()\[\]]*)")
"""Matches a statement: words, followed by a number and its unit."""

_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-zµ]+")
_SAID_OF_ALL = {
    "the",
    "of",
    "is",
    "in",
    "at",
    "per",
    "s",
    "second",
    "data",
    "sensor",
    "device",
    "imu",
    "samples",
    "sample",
    "sampling",
    "sampled",
}
_GYRO = {"gyro", "gyros", "gyroscope", "gyroscopes", "gyr", "angular", "velocity", "velocities", "rotation"}
_RATE = {
    "rate",
    "frequency",
    "freq",
    "odr",
    "fs",
    "samplerate",
    "samplingrate",
    "samplefrequency",
    "samplingfrequency",
}
_SAMPLING = {
    *["odr", "fs", "sample", "sampling", "samplerate", "samplingrate", "samplefrequency", "samplingfrequency"]
}
_OF_RATES = {
    "update",
    "output",
    "acquisition",
    "recording",
    "logging",
    "measurement",
    "hz",
    "khz",
    "sps",
    "nominal",
}
_PERIOD = {"period", "interval", "dt", "ts"}
_HZ = {"hz": 1.0, "khz": 1e3, "sps": 1.0, "samples/s": 1.0, "1/s": 1.0}
_FULL_SCALES = {125.0, 245.0, 250.0, 500.0, 1000.0, 2000.0, 4000.0}
"""Usual full scales of gyroscopes [deg/s]. If one of these numbers follows `fs`, it may be a full scale
instead of a sampling rate.
"""

_OF_UNITS = {"unit", "units", "rates", "values", "measured", "are"}
_LABEL = re.compile(r"(?:(.*?)([:=(\[]|\bin\b))?(.*)")
_BEFORE_UNIT = re.compile(r"^\s*(?:now|units?)\s+", re.I)
_SCALE = re.compile(
    rf"({UNSIGNED})[ ]*(?:(?:LSBs?|counts?|digits?)[ ]*(?:/|per)[ ]*(?P<of>.+)"
    r"|(?P<unit>[^\d\s]+?)[ ]*(?:/|per)[ ]*(?:LSB|count|digit))\W*$",
    re.I,
)


class Head(NamedTuple):
    """Facts that the head of a text states, each with the line that states it.

    `rates`: sampling rates [Hz]. `units`: units in the notation of `--units`.
    """

    rates: dict[str, float]
    units: dict[str, str]


@lru_cache(maxsize=16)
def stated_in(head: str) -> Head:
    """Return all sampling rates and units that the lines of a text's head state.

    If several different rates or units are returned, the head contradicts itself.

    Statements in lines that name the gyroscope have priority over those in lines that name no sensor.
    """
    rates: dict[bool, dict[str, float]] = {True: {}, False: {}}
    units: dict[bool, dict[str, str]] = {True: {}, False: {}}
    for line in head.splitlines():
        if len(line) > LONGEST_LINE:
            continue
        text = re.sub(r"""^[\s#%/]+|[{}"']""", " ", line).strip()
        shown = text[:LONGEST_NAME]
        for is_of_gyro, rate_hz in _rates(text):
            if rate_hz not in rates[is_of_gyro].values():
                rates[is_of_gyro][shown] = rate_hz
        for is_of_gyro, unit in _units(text):
            if unit not in units[is_of_gyro].values():
                units[is_of_gyro][f"{shown} ({unit})" if shown in units[is_of_gyro] else shown] = unit
    return Head(rates[True] or rates[False], units[True] or units[False])


def _rates(text: str) -> Iterator[tuple[bool, float]]:
    """Yield each sampling rate that a line states [Hz], and whether the line names the gyroscope."""
    for found in _FACT.finditer(text):
        words = {word.lower() for word in _WORD.findall(found[1])}
        number, unit = float(found[2]), found[3].lower().rstrip(".")
        unit = unit or next((word for word in words if word in _HZ or time_scale(word)), "")
        others = words - _SAID_OF_ALL - _GYRO - {unit}
        rate_hz = 0.0
        if words & _RATE and others <= _RATE | _OF_RATES:
            if unit in _HZ:
                rate_hz = number * _HZ[unit]
            elif not unit and words & _SAMPLING and not ("fs" in words and number in _FULL_SCALES):
                rate_hz = number
        elif words & _PERIOD and others <= _PERIOD | {"time", "update", "output"} and number > 0:
            scale = time_scale(unit)
            rate_hz = 0.0 if scale is None else 1 / (number * SECONDS[scale[0]] * scale[1])
        if LEAST_HZ <= rate_hz <= MOST_HZ:
            yield bool(words & _GYRO), rate_hz


def _units(text: str) -> Iterator[tuple[bool, str]]:
    """Yield each unit of angular rates that a line states, and whether the line names the gyroscope."""
    if (found := _SCALE.search(text)) is not None:
        unit = rate_unit((found["of"] or found["unit"]).strip(" ()"))
        words = {word.lower() for word in _WORD.findall(text[: found.start()])}
        number = float(found[1])
        if (
            unit is not None
            and number > 0
            and (not words or words & (_GYRO | {"scale", "sensitivity", "resolution"}))
        ):
            lsb = number / PER_UNIT[unit] if found["of"] else 1 / (number * PER_UNIT[unit])
            yield bool(words & _GYRO), f"lsb:{lsb:.9g}"
        return
    label = ""
    for piece in re.split(r"[,;|\t]|\band\b", text):
        found = _LABEL.match(piece)
        assert found is not None  # the regular expression matches any text
        words_before, mark, value = found.groups()
        if mark:
            label = words_before
        value = value if mark else _BEFORE_UNIT.sub("", value, count=1)
        unit = rate_unit(value.strip(" ()[]"))
        if not mark and not is_unit(value.strip(" ()[]")):
            label = value
        words = {word.lower() for word in _WORD.findall(label)}
        is_known = words <= _GYRO | _SAID_OF_ALL | _OF_UNITS and words & (_GYRO | {"unit", "units"})
        if unit is not None and (is_known or not words):
            yield bool(words & _GYRO), unit
