"""A reading: how a file was understood, each answer with its evidence; and what is missing for one.

There are five kinds of evidence, the strongest first. What has none of them is missing: nothing is made up.

- given: the user says it, by an option;
- stated: the file says it itself, by a name, a row of units, its head or its metadata;
- dialect: the logger is recognised, and its documentation says it (`dialects.toml`);
- convention: the format's, which programs can break (messages of ROS are in rad/s);
- measured: the numbers show it (the steps of the times are the rate, gravity is the accelerometer's unit).
"""

import shlex
from collections.abc import Callable, Sequence
from typing import Literal

import msgspec

from fltea.records.errors import UsageError
from fltea.settings.how import How

Evidence = Literal["given", "stated", "dialect", "convention", "measured", "missing"]

Question = Literal["rows", "sensor", "columns", "unit", "clock", "accelerometer"]


class Answer(msgspec.Struct, frozen=True):
    """One answer: `value` for a person, such as "gx, gy, gz"; `why` names the evidence, such as "--units"."""

    question: Question
    value: str
    evidence: Evidence
    why: str

    def __str__(self) -> str:
        """Return the answer as one line, without its question."""
        return f"{self.value} ({self.evidence}: {self.why})"


class Missing(msgspec.Struct, frozen=True):
    """One fact that nothing tells: what it is, and the option that says it, with `?` for the value."""

    what: str
    option: str


OVERRULE = "If the file is wrong, add --overrule."
"""Ends the text of what contradicts the file."""

ASK = "Say it, with the right value for each ?: "
"""Before the options in the text of `NotStated`; whoever knows the file puts the command between."""


class NotStated(UsageError):
    """Facts are missing, and the user has to say them. missing, table: as `not_stated` has them."""

    missing: Sequence[Missing] = ()
    table: str = ""


def not_stated(
    where: str, missing: Sequence[Missing], known: Sequence[str] = (), table: str = ""
) -> NotStated:
    """Return the error that asks for what is missing.

    where: the file, for messages. known: options with their values that the user gave. missing: what has to
    be said. table: lines that show what each candidate would mean for these data.
    """
    what = "; and ".join(one.what for one in missing)
    options = " ".join([*known, *(one.option for one in missing if one.option)])
    text = f"{where}: nothing says {what}. {ASK}{options}"
    error = NotStated(f"{text}\n{table}" if table else text)
    error.missing, error.table = missing, table
    return error


def asked_with(where: str, first: Missing, known: Sequence[str], then: Callable[[], object]) -> NotStated:
    """Return the error that asks for a fact, and for all that `then` lacks beside it."""
    try:
        then()
    except NotStated as error:
        return not_stated(where, [first, *error.missing], known, error.table)
    except UsageError:
        pass  # it depends on what is asked for
    return not_stated(where, [first], known)


def given_options(how: How) -> list[str]:
    """Return what the user said, as it is typed."""
    given = {
        "--columns": None if how.columns is None else ",".join(how.columns),
        "--units": how.units,
        "--rate": None if how.rate_hz is None else f"{how.rate_hz:g}",
        "--time-column": how.time_column,
        "--time-unit": how.time_unit,
        "--sensor": how.topic,
        "--accel-units": how.accel_units,
    }
    words = [f"{flag} {shlex.quote(value)}" for flag, value in given.items() if value is not None]
    return [*words, "--overrule"] if how.overrule else words
