"""What a caller may pass; a mistake gives an error that says, in Python's words, what to pass instead."""

import contextlib
import math
import re
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from fltea.identification.load import ACCEL_UNIT, GYRO_UNIT
from fltea.recording.candidates import units_table
from fltea.recording.session import HIGHEST_RATE_HZ, LOWEST_RATE_HZ
from fltea.recording.units import ACCEL_UNITS_HELP, UNITS_HELP, accel_unit, parse_units
from fltea.records.arrays import Array
from fltea.records.errors import FlteaError, UsageError

PARAMETERS = {
    "--columns": "columns",
    "--units": "units",
    "--accel-units": "accel_units",
    "--rate": "rate_hz",
    "--time-column": "time_column",
    "--time-unit": "time_unit",
    "--topic": "topic",
    "--sensor": "topic",
    "--overrule": "overrule",
    "--channels": "axes",
    "--from-hz": "from_hz",
    "--notch": "notch_hz",
}
"""What the flags of `fltea identify` are called here."""

_UNITS = r"m?deg/[sh]|m?rad/s|m?dps|lsb:[\d.]*\d|lsb:N|m?m/s(?:\^2|²)|m?g\b|[mun]?s\b"
_SENSORS = r"\d+/\d+|\w+:\d+|\w+=\w+|/[\w/]+(?::[\w?]+)?"
_VALUE = rf"\?(?:,\?)*|{_SENSORS}|\d[\d.]*(?![\w,])|\w+(?:,\w+)+|[A-Z]+\b|{_UNITS}|'[^']+'"
_FLAG = re.compile(rf"({'|'.join(PARAMETERS)})\b(?!-)(?:[ =]({_VALUE})( (?=--))?)?")


@contextlib.contextmanager
def python_words() -> Iterator[None]:
    """Let errors name parameters where they name flags of the command: rate_hz=100, not --rate 100."""
    try:
        yield
    except (FlteaError, ValueError) as error:
        error.args = (in_python(str(error)),)
        raise


def in_python(text: str) -> str:
    """Return a text with parameters for flags, those that follow each other separated by commas."""
    return _FLAG.sub(
        lambda found: PARAMETERS[found[1]] + _argument(found[1], found[2]) + (", " if found[3] else ""), text
    )


def _argument(flag: str, value: str | None) -> str:
    if flag == "--overrule":
        return "=True"
    if value is None:
        return ""
    value = value.strip("'")
    if flag == "--columns":
        return (
            "=["
            + ", ".join(one if one.isdigit() or one == "?" else repr(one) for one in value.split(","))
            + "]"
        )
    return f"={value}" if flag in ("--rate", "--from-hz") or value == "?" else f"={value!r}"


class Scale(NamedTuple):
    """How samples become figures: in `unit`, deg/s or m/s², of which 1 of theirs is `factor`.

    counts: they are counts of a sensor.
    """

    unit: str
    factor: float
    counts: bool = False


def scale(unit: str | None, y: Array | None = None, rate_hz: float | None = None) -> Scale:
    """Return the scale of a unit that a caller states; y and rate_hz are shown in each, where none is.

    Raises:
        ValueError: no unit is stated, or one that is not known.
    """
    if unit is None:
        table = "" if y is None else units_table(y[:, np.newaxis], rate_hz)
        raise ValueError(
            "nothing says the unit of the samples. Pass it: unit='rad/s', unit='deg/s' or another of a "
            "gyroscope; unit='m/s^2' or unit='g' of an accelerometer."
            + re.sub(r"--units (\S+)", r"unit='\1'", f"\n{table}").rstrip()
        )
    if (ms2 := accel_unit(str(unit))) is not None:
        return Scale(ACCEL_UNIT, ms2)
    try:
        factor, lsb = parse_units(str(unit))
    except UsageError as error:
        accel = ACCEL_UNITS_HELP.partition(", or")[0]  # N counts would be 1 deg/s, not 1 g
        raise ValueError(
            f"unit is that of the samples, of a gyroscope {UNITS_HELP}; of an accelerometer {accel}; "
            f"got {unit!r}"
        ) from error
    return Scale(GYRO_UNIT, factor / (lsb or 1.0), lsb is not None)


def period_s(rate_hz: float) -> float:
    """Return the sampling period of a rate in Hz."""
    if not (math.isfinite(rate_hz) and LOWEST_RATE_HZ <= rate_hz <= HIGHEST_RATE_HZ):
        raise ValueError(
            f"rate_hz is the sample rate in Hz, {LOWEST_RATE_HZ:g} to {HIGHEST_RATE_HZ:g}, got {rate_hz}"
        )
    return 1 / rate_hz


def finite(y: ArrayLike, what: str, remedy: str) -> Array:
    """Return numbers as an array of float; `remedy` is what to do about one that is not finite."""
    try:
        found = np.asarray(y, dtype=np.float64, order="C")
    except (TypeError, ValueError) as error:
        raise ValueError(f"{what} has to be numbers: {error}") from error
    bad = np.argwhere(~np.isfinite(found))
    if len(bad):
        at = ", ".join(str(i) for i in bad[0])
        raise ValueError(f"{what} has {len(bad)} values that are not finite, the first at [{at}]: {remedy}")
    return found


def one_axis(y: ArrayLike) -> Array:
    """Return samples of one axis, (n,)."""
    found = finite(
        y, "y", "leave them out only at the ends, or use fltea.Live and its skip(), which knows gaps."
    )
    if found.ndim != 1:
        raise ValueError(
            f"y is one axis, (n,), got shape {found.shape}: pass its axes one by one, as y[:, 0]."
        )
    return found
