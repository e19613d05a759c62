"""Shows the user what each possible answer to a question would mean for the numbers of a file.

This module decides nothing. One table shows what the columns hold. Another shows the noise and the mean that
the rates would have in each candidate unit.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from fltea.recording.files import LONGEST_NAME, listed
from fltea.recording.raw_lines import shown
from fltea.recording.sample_times import PLAUSIBLE_HZ, SECONDS, Floats
from fltea.recording.units import parse_units
from fltea.records.units import SQRT_HOUR, STANDARD_GRAVITY_MS2

GRAVITY = {
    "m/s^2": STANDARD_GRAVITY_MS2,
    "g": 1.0,
    "mg": 1000.0,
    "cm/s^2": 100 * STANDARD_GRAVITY_MS2,
    "mm/s^2": 1000 * STANDARD_GRAVITY_MS2,
}
"""Length of the vector of gravity in each unit of acceleration."""

GRAVITY_COUNTS = (2048, 4096, 8192, 16384)
"""Length of gravity in 16-bit counts of accelerometers with ranges of ±16, ±8, ±4 and ±2 g."""

GRAVITY_TOLERANCE = 0.15
"""A vector has the length of gravity if its length differs from gravity by at most this proportion. Cheap
accelerometers are wrong by about 5 %. So the units mg and cm/s², which differ by 2 %, cannot be
distinguished.
"""

STEADY = 0.1
"""Vectors may be gravity only if they are about equally long. The median deviation from their median length
may be at most this proportion of the median length.
"""

UNITS = ("rad/s", "deg/s", "mrad/s", "mdps", "deg/h")
COUNTS = ("lsb:131", "lsb:65.5", "lsb:32.8", "lsb:16.4")
"""Units of raw counts: `lsb:131` means 131 counts per deg/s. The commonest gyroscopes have these units at the
ranges ±250, ±500, ±1000 and ±2000 deg/s.
"""

MOST_N, MOST_MEAN_DPS = 5.0, 20.0
"""Largest plausible noise N [deg/√h] and largest plausible mean [deg/s] of MEMS gyroscopes at rest."""

USUAL = "MEMS gyroscopes have N 0.1 to 3 deg/√h, and at rest a mean of up to some 10 deg/s."

LIKELY_HZ = PLAUSIBLE_HZ[0] / 5, PLAUSIBLE_HZ[1] * 2
"""Range of sampling rates that the tables show [Hz]. It is wider than the range of accepted rates."""

MOST_COLUMNS = 40
NOBODY_MEASURES = 1e100
"""Numbers of this size or more are no measurements. They are left out, since their squares might overflow."""


def units_table(values: Floats, rate_hz: float | None, when: Mapping[str, str] | None = None) -> str:
    """Return a table with a row for each possible unit of the rates.

    A row shows N and the mean that each axis would have in that unit.

    `values`: rates (n, axes) as in the file. `rate_hz`: sampling rate; if None, the table shows σ instead of
    N.
    `when`: candidate units, each with the case in which it applies; None: the usual units.
    """
    values = _possible_rows(values)
    if len(values) < 3:
        return ""
    is_whole = bool((values == np.rint(values)).all())
    units = dict(when) if when is not None else dict.fromkeys(UNITS + (COUNTS if is_whole else ()), "")
    std = _white_std(values)
    what = "σ in deg/s" if rate_hz is None else "N in deg/√h"
    lines = []
    for unit, circumstances in units.items():
        factor, lsb = parse_units(unit)
        factor /= lsb or 1.0
        noise = std * factor * (1.0 if rate_hz is None else SQRT_HOUR / math.sqrt(rate_hz))
        mean = values.mean(axis=0) * factor
        text = f"  --units {unit:<9} {what} {_numbers(noise)}; mean in deg/s {_numbers(mean)}"
        lines.append(f"{text}  ({circumstances})" if circumstances else text)
    lines = ["What each unit would mean here, axis by axis:", *lines, USUAL]
    if values.shape[1] == 3 and (gravity := gravity_units(values)):
        said = f"Their length is {length_of(values):.4g}, as gravity in {' or '.join(gravity)}"
        lines.append(f"{said}: are they accelerations?")
    return "\n".join(lines)


def columns_table(names: Sequence[str] | None, values: Floats) -> str:
    """Return a table with a row for each column of a file: position, name, mean, σ, and what it may hold."""
    if len(values) < 3:
        return ""
    values = np.where(np.abs(values) < NOBODY_MEASURES, values, math.nan)
    width = min(values.shape[1], MOST_COLUMNS)
    remarks = _remarks(values[:, :width])
    lines = ["The columns, and what the first rows show:"]
    for place in range(width):
        column = values[:, place]
        column = column[np.isfinite(column)]
        name = "" if names is None else f"{_shown(names[place])}: "
        figures = f"mean {column.mean():.6g}, σ {column.std():.3g}" if len(column) else "no numbers"
        lines.append(f"  {place + 1}  {name}{figures}{remarks.get(place, '')}")
    if width < values.shape[1]:
        lines.append(f"  … {values.shape[1]} columns in all")
    return "\n".join(lines)


def times_table(step: float, limits_hz: tuple[float, float] = LIKELY_HZ, also: str = "") -> list[str]:
    """Return a line for each unit of time in which `step` gives a possible sampling rate.

    A line shows the option that states the unit, and the rate: `--time-unit ms: 100 Hz`.

    `step`: usual step between times in the file. `also`: text to add after the option.
    """
    rates = {unit: 1 / (step * unit_s) for unit, unit_s in SECONDS.items()} if step > 0 else {}
    return [
        f"  --time-unit {unit}{also}: {rate:.6g} Hz"
        for unit, rate in rates.items()
        if limits_hz[0] <= rate <= limits_hz[1]
    ]


def ticks_table(step: float, units: Sequence[str]) -> str:
    """Return a text on the sampling rate that the step between times gives in each unit of time.

    `units`: lines that `times_table` returned for this step. The text ends with the option for times in
    counts of unknown length.
    """
    return "\n".join([f"A step of {step:.6g} would be:", *units, "  or in ticks of unknown length: --rate ?"])


def gravity_units(values: Floats) -> list[str]:
    """Return the units in which an accelerometer's axes (n, 3) at rest have the length of gravity.

    If the length fits raw counts and also another unit, nothing shows which is right: the list is empty.
    """
    values = _possible_rows(values)
    length = np.linalg.norm(values, axis=1)
    mean = length_of(values)
    if not (0 < mean < NOBODY_MEASURES) or float(np.median(np.abs(length - mean))) > STEADY * mean:
        return []
    found = [unit for unit, g in GRAVITY.items() if abs(mean / g - 1) < GRAVITY_TOLERANCE]
    if bool((values == np.rint(values)).all()):
        found += [f"lsb:{g}" for g in GRAVITY_COUNTS if abs(mean / g - 1) < GRAVITY_TOLERANCE]
    return [] if len(found) > 1 and found[-1].startswith("lsb:") else found


def length_of(values: Floats) -> float:
    """Return the median length of vectors (n, 3); NaN if no vector consists of plausible numbers."""
    lengths = np.linalg.norm(_possible_rows(values), axis=1)
    return float(np.median(lengths)) if len(lengths) else math.nan


def is_rising(column: Floats) -> bool:
    """Return whether numbers never fall and sometimes rise, as times do."""
    steps = np.diff(column[np.isfinite(column)])
    return len(steps) > 1 and bool((steps >= 0).all() and steps.any())


def _remarks(values: Floats) -> dict[int, str]:
    """Return remarks for the user on columns that may be times or accelerations, by column index.

    Times rise. Three neighbouring columns may be accelerations if their vector is as long as gravity.
    """
    found = {}
    numbers = []
    for place in range(values.shape[1]):
        if is_rising(values[:, place]):
            step = float(np.diff(values[np.isfinite(values[:, place]), place]).mean())
            rates = ", ".join(line.removeprefix("  --time-unit ") for line in times_table(step))
            found[place] = ": rises, as times and counters do" + (f" ({rates})" if rates else "")
        elif np.isfinite(values[:, place]).any():
            numbers.append(place)
    for first in sorted(
        range(len(numbers) - 2), key=lambda place: (place % 3, place)
    ):  # groups of three columns that begin at column 1, 4, 7 and so on are tried first
        three = numbers[first : first + 3]
        units = gravity_units(values[:, three])
        if units and not any(place in found for place in three):
            length = length_of(values[:, three])
            for place in three:
                found[place] = f": columns {three[0] + 1} to {three[2] + 1} have the length {length:.4g}"
                counts = units[0].startswith("lsb:")
                found[place] += (
                    f", which is gravity in {'counts, as it seems' if counts else ' or '.join(units)}"
                )
    return found


def _possible_rows(values: Floats) -> Floats:
    """Return the rows of (n, columns) in which each number is finite and may be a measurement."""
    return values[(np.abs(values) < NOBODY_MEASURES).all(axis=1)] if values.size else values


def _white_std(values: Floats) -> Floats:
    """Return σ of each axis's white noise, computed from differences of successive values.

    Drift hardly affects these differences.
    """
    steps = np.diff(values, axis=0)
    robust = 1.4826 * np.median(np.abs(steps - np.median(steps, axis=0)), axis=0)
    return np.asarray(np.where(robust > 0, robust, steps.std(axis=0)) / math.sqrt(2))


def _numbers(values: Floats) -> str:
    return ", ".join(f"{value:.2g}" for value in np.atleast_1d(values).tolist())


def _shown(name: str) -> str:
    return listed([name]) if len(name) < LONGEST_NAME else shown(name)
