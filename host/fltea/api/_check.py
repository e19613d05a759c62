"""What a caller may pass; a mistake gives an error that says, in Python's words, what to pass instead."""

import contextlib
import math
import re
from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike

from fltea.recording.session import HIGHEST_RATE_HZ, LOWEST_RATE_HZ
from fltea.records.arrays import Array
from fltea.records.errors import FlteaError

PARAMETERS = {
    "--columns": "columns",
    "--units": "units",
    "--rate": "rate_hz",
    "--time-column": "time_column",
    "--time-unit": "time_unit",
    "--topic": "topic",
    "--channels": "axes",
    "--from-hz": "from_hz",
    "--notch": "notch_hz",
}
"""What the flags of `fltea identify` are called here."""

_VALUE = r"\d[\d.]*(?![\w,])|\w+(?:,\w+)+|/[\w/]+|[A-Z]+\b|deg/s|rad/s|m?dps|lsb:\S+|(?:[mun]?s\b)"
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
    if value is None:
        return ""
    if flag == "--columns":
        return f"={[int(one) if one.isdigit() else one for one in value.split(',')]}"
    return f"={value}" if flag in ("--rate", "--from-hz") else f"={value!r}"


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
