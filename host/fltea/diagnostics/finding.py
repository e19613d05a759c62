"""The result of a check of `fltea doctor`."""

from collections.abc import Callable, Iterator
from typing import Literal

import msgspec

from fltea.records.errors import FlteaError

Level = Literal["ok", "warning", "problem"]


class Finding(msgspec.Struct, frozen=True, tag_field="class", tag="finding", kw_only=True):
    """One line of the report of `fltea doctor`: what was checked, the result, and what to do.

    `check`: name of the check.
    `level`: a `problem` prevents the program from working, a `warning` does not.
    `remedy`: what to do; null if there is nothing to do, or if the message says it.
    `device`: name of the source that was checked, or null.
    """

    check: str
    level: Level
    message: str
    remedy: str | None = None
    device: str | None = None


def ok(check: str, message: str) -> Finding:
    """Return a finding that says that all is well. `message`: what was checked."""
    return Finding(check=check, level="ok", message=message)


def warning(check: str, message: str, remedy: str | None = None) -> Finding:
    """Return a finding that says that the program works, but that the user should take care of something."""
    return Finding(check=check, level="warning", message=message, remedy=remedy)


def problem(check: str, message: str, remedy: str | None = None) -> Finding:
    """Return a finding that says that the program cannot do what the user asks for."""
    return Finding(check=check, level="problem", message=message, remedy=remedy)


def refused(check: str, use: Callable[[], object]) -> Iterator[Finding]:
    """Yield a problem if `use`, which does what `fltea run` would do, refuses a setting."""
    try:
        use()
    except FlteaError as error:
        yield problem(check, str(error))
