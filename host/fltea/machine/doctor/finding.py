"""What a check of `fltea doctor` found."""

from typing import Literal

import msgspec

Level = Literal["ok", "warning", "problem"]


class Finding(msgspec.Struct, frozen=True, tag_field="class", tag="finding", kw_only=True):
    """One line of the report: what was looked at, how it is, and what to do.

    level: a `problem` keeps the program from its work, a `warning` does not. remedy: what to do, or null
    where there is nothing to do or the message says it. device: name of the source it is about, or null.
    """

    check: str
    level: Level
    message: str
    remedy: str | None = None
    device: str | None = None


def ok(check: str, message: str) -> Finding:
    """Return a finding that all is well, with what was seen."""
    return Finding(check=check, level="ok", message=message)


def warning(check: str, message: str, remedy: str | None = None) -> Finding:
    """Return a finding that the program works, but somebody should look at this."""
    return Finding(check=check, level="warning", message=message, remedy=remedy)


def problem(check: str, message: str, remedy: str | None = None) -> Finding:
    """Return a finding that the program cannot do what it is asked for."""
    return Finding(check=check, level="problem", message=message, remedy=remedy)
