"""Which options probably make a recording of columns that do not name themselves (pure).

They are a guess for a person to check: rising numbers are times, three whose length is that of gravity are an
accelerometer, and the next three are the gyroscope.
"""

import contextlib
import math
import re
import shlex
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fltea.recording.column_names import (
    accel_axis_of,
    are_in_rads,
    axis_of,
    is_time,
    rate_unit_of,
    time_unit_of,
)
from fltea.recording.columns import is_number
from fltea.recording.sample_times import PLAUSIBLE_HZ, SECONDS, Floats
from fltea.recording.text_labels import decode_object, values_in
from fltea.recording.text_layout import MOST_COLUMNS, bare_fields, is_comment, separator_of, split
from fltea.records.errors import UsageError
from fltea.records.records import AXES
from fltea.settings.how import How, TimeUnit

GRAVITY = 9.81, 1.0, 1000.0, 2048.0, 4096.0, 8192.0, 16384.0
"""In m/s², g, mg and counts of the usual ranges."""

SPREAD = 0.15
"""Of what is gravity, to its mean, and of this to the true one."""

FEWEST = 3
"""Rows."""

MOST_FILLED = 0.8

OTHER = re.compile(
    "temp|humid|press|baro|mag|compass|light|lux|lat|lon|alt|speed|veloc|volt|current|batt|price"
)
"""In names of what is no angular rate."""

NOBODY_MEASURES = 1e100
"""A number as large is none; the squares of smaller ones are still numbers."""

TRY = "Probably this reads it; check which columns are the gyroscope's: "


def with_hint(error: UsageError, found: str) -> UsageError:
    """Return the error with options behind it, unless its text names some already."""
    text = str(error)
    says_it = "--" in text and "--columns" not in text
    return error if not found or TRY in text or says_it else type(error)(f"{text} {TRY}{found}")


def options(names: Sequence[str] | None, values: Floats, how: How) -> str:
    """Return options for columns of numbers (rows, columns), NaN where is none; "" if they tell none."""
    if len(values) < FEWEST:
        return ""
    values = np.where(np.abs(values) < NOBODY_MEASURES, values, math.nan)
    width = values.shape[1]
    labels = [str(place + 1) for place in range(width)]
    if names is not None and len(set(names)) == width and not any("," in name for name in names):
        labels = list(names)
    filled = np.isfinite(values).mean(axis=0) >= MOST_FILLED
    time = _times(names, values, filled)
    numbers = [p for p in range(width) if filled[p] and not is_rising(values[:, p])]
    gravity = _accelerometer(names, values, numbers)
    rest = [p for p in numbers if p not in gravity]
    named = [p for p in rest if names is not None and axis_of(names[p])]
    likely = [p for p in rest if names is None or not OTHER.search(names[p].lower())]
    moving = [p for p in likely if np.nanstd(values[:, p]) > 0]
    axes = (named or moving or likely)[: len(AXES)]
    if not axes:
        return ""
    if sorted(labels[p].lower() for p in axes) == list("xyz"):
        axes.sort(key=lambda p: labels[p].lower())
    found = ["--columns", ",".join(labels[p] for p in axes)]
    if time is not None:
        found += ["--time-column", labels[time]]
        unit = how.time_unit or _unit(values[:, time])
        if unit is not None and (names is None or time_unit_of(names[time]) is None):
            found += ["--time-unit", unit]
    else:
        found += ["--rate", f"{how.rate_hz or 100:g}"]
    if names is None or not all(rate_unit_of(names[p]) for p in axes):
        whole = bool((values[:, axes] == np.rint(values[:, axes])).all())
        likely_unit = "lsb:131" if whole else "rad/s" if are_in_rads(names or ()) else "dps"
        found += ["--units", how.units or likely_unit]
    return shlex.join(found)


def _times(names: Sequence[str] | None, values: Floats, filled: "np.typing.NDArray[np.bool_]") -> int | None:
    """The first column that is called so, or else rises, at a rate that a gyroscope may have."""
    rising = [
        place
        for place in np.flatnonzero(filled).tolist()
        if is_rising(values[:, place]) and _unit(values[:, place]) is not None
    ]
    named = [place for place in rising if names is not None and is_time(names[place])]
    return next(iter(named or rising), None)


def is_rising(column: Floats) -> bool:
    """Whether numbers never fall, as times do."""
    steps = np.diff(column[np.isfinite(column)])
    return len(steps) > 1 and bool((steps >= 0).all() and steps.any())


def _unit(times: Floats) -> TimeUnit | None:
    """The unit in which steps are a gyroscope's."""
    steps = np.diff(times[np.isfinite(times)])
    mean = float(steps.mean()) if len(steps) else math.nan
    fits: list[TimeUnit] = [
        unit
        for unit, s in SECONDS.items()
        if mean > 0 and PLAUSIBLE_HZ[0] <= 1 / (mean * s) <= PLAUSIBLE_HZ[1]
    ]
    return fits[0] if fits else None


def _accelerometer(names: Sequence[str] | None, values: Floats, numbers: Sequence[int]) -> set[int]:
    """Columns of an accelerometer, by their names or by the length of three in a row.

    numbers: the columns that are no times. Sensors stand in threes: three that begin at a third of these are
    rather meant than others, which have the axis with gravity and two of another sensor.
    """
    if names is not None and (named := {p for p, name in enumerate(names) if accel_axis_of(name)}):
        return named
    found = []
    for k in range(len(numbers) - 2):
        three = numbers[k : k + 3]
        length = np.linalg.norm(values[:, three], axis=1)
        spread = length.std() / length.mean() if np.isfinite(length).all() and length.any() else math.inf
        if spread < SPREAD and any(abs(length.mean() / g - 1) < SPREAD for g in GRAVITY):
            found.append((k % len(AXES) != 0, k))
    return set(numbers[min(found)[1] :][: len(AXES)]) if found else set()


def hint_for(lines: Sequence[str], how: How) -> str:
    """Options that probably read lines whose columns are not clear, or ""."""
    rows: list[Mapping[str, Any]] = []
    names: list[str] | None = None
    for line in lines:
        if line.lstrip().startswith("{"):
            with contextlib.suppress(ValueError, RecursionError):
                rows.append(decode_object(line))
        elif not is_comment(line) and any(is_number(field) for field in split(line, separator_of(line))):
            fields = split(line, separator_of(line))
            rows.append({str(k + 1): field for k, field in enumerate(fields)})
        elif found := values_in(line):
            rows.append(found)
        elif len(names_here := bare_fields(line)) > 1:
            names = names_here
    keys: list[str] = max(map(list, rows), key=len, default=[])
    if not 0 < len(keys) <= MOST_COLUMNS:
        return ""
    values = np.array([[_value(row.get(key)) for key in keys] for row in rows if len(row) == len(keys)])
    by_position = keys[0] == "1"
    known = (names if names is not None and len(names) == len(keys) else None) if by_position else keys
    return options(known, values, how)


def _value(field: Any) -> float:
    if isinstance(field, str):
        return float(field.replace(",", ".")) if is_number(field) else math.nan
    return float(field) if isinstance(field, int | float) else math.nan
