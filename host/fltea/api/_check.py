"""Check the arguments of calls from Python. Errors name the parameters and say what to pass instead."""

import contextlib
import math
import re
import shlex
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from fltea.identification.load import ACCEL_UNIT, GYRO_UNIT
from fltea.recording.candidates import units_table
from fltea.recording.session import HIGHEST_RATE_HZ, LOWEST_RATE_HZ
from fltea.recording.units import (
    ACCEL_UNITS_HELP,
    TIME_UNITS,
    UNITS_HELP,
    accel_unit,
    parse_units,
    rate_unit,
)
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
"""The Python parameter for each flag of `fltea identify`."""

_FLAG = re.compile(
    rf"(?<![\w/.-])({'|'.join(PARAMETERS)})(?![-\w]|\.\w)"
    r"(?:[ =](?:('[^']*')|(?=[^\s'])(\S*?)(?=[.,:;)]*(?:\s|$)))( (?=--))?)?"
)
"""Match a flag in a message, and the word after it if there is one.

The word may be the flag's value, or only the next word of the message: `_parameter` tells the two apart.
Punctuation after the word is not matched.
"""

_SIGNS_OF_VALUES = re.compile(r"[\d/=:?,_]")
_COMMAND = re.compile(r"fltea identify ([^\n]+)")


@contextlib.contextmanager
def python_words() -> Iterator[None]:
    """Let errors name Python parameters in place of command flags: rate_hz=100, not --rate 100."""
    try:
        yield
    except (FlteaError, ValueError) as error:
        error.args = (in_python(str(error)),)
        raise


def in_python(text: str) -> str:
    """Return a text with Python calls in place of commands, and parameters in place of flags."""
    pieces, done = [], 0
    for found in _COMMAND.finditer(text):
        if (call := _call(found[1])) is not None:
            pieces += [_FLAG.sub(_parameter, text[done : found.start()]), call]
            done = found.end()
    return "".join([*pieces, _FLAG.sub(_parameter, text[done:])])


def _call(command: str) -> str | None:
    """Return the Python call that does the same as an `fltea identify` command in a message.

    `command`: the text that follows `fltea identify` in the message, up to the end of the line.

    Return None if anything but flags and their values follows the file's name in this text (the message's
    sentence may go on there), or if there are no flags.
    """
    try:
        path, *words = shlex.split(command)
    except ValueError:
        return None
    arguments = [repr(path)]
    while words:
        flag = words.pop(0)
        if flag not in PARAMETERS or (flag != "--overrule" and not words):
            return None
        arguments.append(PARAMETERS[flag] + _argument(flag, "" if flag == "--overrule" else words.pop(0)))
    return f"fltea.open({', '.join(arguments)})" if len(arguments) > 1 else None


def _parameter(found: re.Match[str]) -> str:
    flag, quoted, word, goes_on = found.groups()
    name = PARAMETERS[flag]
    if flag == "--overrule":
        return f"{name}=True{found[0][len(flag) :]}"
    value = quoted.strip("'") if quoted else word or ""
    is_value = quoted or _SIGNS_OF_VALUES.search(value) or value.isupper() or value in TIME_UNITS
    if not is_value and rate_unit(value) is None and accel_unit(value) is None:
        return name + found[0][len(flag) :]
    return name + _argument(flag, value) + (", " if goes_on else "")


def _argument(flag: str, value: str) -> str:
    if flag == "--overrule":
        return "=True"
    if flag == "--columns":
        names = value.split(",")
        return f"=[{', '.join(one if one.isdigit() or one == '?' else repr(one) for one in names)}]"
    return f"={value}" if flag in ("--rate", "--from-hz") or value == "?" else f"={value!r}"


class Scale(NamedTuple):
    """How samples are converted to `unit`, deg/s or m/s²: they are multiplied by `factor`.

    `counts`: whether the samples are counts of a sensor.
    """

    unit: str
    factor: float
    counts: bool = False


def scale(unit: str | None, y: Array | None = None, rate_hz: float | None = None) -> Scale:
    """Return how samples in the unit `unit` are converted to deg/s or m/s².

    If no unit is stated, the error's text shows the mean and the noise that `y` would have in each unit.
    `rate_hz`: sampling rate [Hz].

    Raises:
        ValueError: no unit is stated, or the unit is not known.
    """
    if unit is None:
        table = "" if y is None else units_table(y[:, np.newaxis], rate_hz)
        raise ValueError(
            "nothing says the unit of the samples. Pass it: for a gyroscope unit='rad/s', unit='deg/s' or "
            "another unit of rates; for an accelerometer unit='m/s^2' or unit='g'."
            + re.sub(r"--units (\S+)", r"unit='\1'", f"\n{table}").rstrip()
        )
    if (ms2 := accel_unit(str(unit))) is not None:
        return Scale(ACCEL_UNIT, ms2)
    try:
        factor, lsb = parse_units(str(unit))
    except UsageError as error:
        # The end of ACCEL_UNITS_HELP is left out. It says that `lsb:N` means N counts per g. In the parameter
        # `unit`, `lsb:N` means N counts per deg/s.
        accel = ACCEL_UNITS_HELP.partition(", or")[0]
        raise ValueError(
            f"unit must be the samples' unit: for a gyroscope {UNITS_HELP}; for an accelerometer {accel}; "
            f"got {unit!r}"
        ) from error
    return Scale(GYRO_UNIT, factor / (lsb or 1.0), lsb is not None)


def period_s(rate_hz: float) -> float:
    """Return the sampling period [s] for a rate in Hz."""
    if not (math.isfinite(rate_hz) and LOWEST_RATE_HZ <= rate_hz <= HIGHEST_RATE_HZ):
        raise ValueError(
            f"rate_hz must be the sampling rate, {LOWEST_RATE_HZ:g} to {HIGHEST_RATE_HZ:g} Hz, got {rate_hz}"
        )
    return 1 / rate_hz


def finite(y: ArrayLike, what: str, remedy: str) -> Array:
    """Return numbers as a float array; `remedy` says what to do about numbers that are not finite."""
    try:
        found = np.asarray(y, dtype=np.float64, order="C")
    except (TypeError, ValueError) as error:
        raise ValueError(f"{what} must consist of numbers: {error}") from error
    bad = np.argwhere(~np.isfinite(found))
    if len(bad):
        at = ", ".join(str(i) for i in bad[0])
        raise ValueError(f"{what} has {len(bad)} values that are not finite, the first at [{at}]: {remedy}")
    return found


def one_axis(y: ArrayLike) -> Array:
    """Check samples of one axis, and return them as an array (n,)."""
    found = finite(y, "y", "leave out such values at the ends only; for gaps, use fltea.Live and its skip().")
    if found.ndim != 1:
        raise ValueError(
            f"y must be one axis, (n,), got shape {found.shape}: pass its axes one by one, as y[:, 0]."
        )
    return found
