"""Describe steps of a bias and motions of the sensor in words, for the page, the table and the log."""

from datetime import UTC, datetime, timedelta

from fltea.records.plus_minus import plus_minus
from fltea.records.records import Motion, Step
from fltea.sinks.words import figure

MOVES = "the sensor moves"
MINUS = "\u2212"
UNIX_FROM_NS = 366 * 86400 * 10**9
"""A time of at least this counts as Unix time [ns]. A smaller one is the time since the start of a recording
without a date.
"""


def sentence(record: Step | Motion, at: str = "") -> str:
    """Return a description of the step or motion, without a full stop. `at`: text for its time."""
    if isinstance(record, Step):
        return f"{record.axis}: {step_words(record.size, record.size_std, record.unit, at)}"
    since = f" since {at}" if at else ""
    if record.begins:
        shown = "as the caller says" if record.by == "caller" else f"shown by {record.by}"
        return f"{MOVES}{since} ({shown})"
    return f"the sensor is at rest again{since}" + moved(record.samples, record.largest)


def step_words(size: float, size_std: float, unit: str, at: str = "") -> str:
    """Return the description of a step of a bias. `at`: text for the time of the step."""
    return f"step of {signed_size(size, size_std, unit)}" + (f" at {at}" if at else "")


def size(step: Step) -> str:
    """Return the size of a step of a bias, with sign, standard deviation and unit."""
    return signed_size(step.size, step.size_std, step.unit)


def signed_size(size: float, size_std: float, unit: str) -> str:
    """Return a text with the size of a step, its sign, its standard deviation and its unit."""
    sign = MINUS if size < 0 else "+"
    return f"{sign}{plus_minus(abs(size), size_std)} {unit.replace('^2', '²')}"


def short_size(step: Step) -> str:
    """Return the size of a step in two digits, without its standard deviation, for a mark in a diagram."""
    return f"{step.size:+#.2g}".rstrip(".").replace("-", MINUS)


def moved(samples: int | None, largest: float | None) -> str:
    """Return the duration and the largest angular rate of a motion as text, as far as they are known."""
    known = [] if samples is None else [f"it moved for {samples:,} samples"]
    known += [] if largest is None else [f"at most by {figure(largest, 3, significant=True)} deg/s"]
    return f": {', '.join(known)}" if known else ""


def time_of(record: Step | Motion) -> str:
    """Return the local time of day of a record, or its time since the start of a recording without a date."""
    if record.host_ns < UNIX_FROM_NS:
        return str(timedelta(seconds=record.host_ns // 10**9))
    return f"{datetime.fromtimestamp(record.host_ns // 10**9, UTC).astimezone():%H:%M:%S}"
