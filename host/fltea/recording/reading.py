"""Describes how a file was understood: answers with their evidence, and questions without an answer.

There are five kinds of evidence. The strongest kind is first in this list. A fact without evidence is missing
and is never guessed.

- given: the user states it by an option;
- stated: the file states it, by a name, a row of units, its head or its metadata;
- dialect: the logger is recognized, and its documentation states it (`dialects.toml`);
- convention: the file's format prescribes it, but programs that write such files can break the rule (for
example, ROS prescribes rad/s);
- measured: the numbers show it (for example, the steps between times give the rate, and gravity shows the
accelerometer's unit).
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
    """One answer to a question about a file. `value`: text such as "gx, gy, gz".

    `why`: what states the value, such as "--units".
    """

    question: Question
    value: str
    evidence: Evidence
    why: str

    def __str__(self) -> str:
        """Return the answer as one line, without its question."""
        return f"{self.value} ({self.evidence}: {self.why})"


class Missing(msgspec.Struct, frozen=True):
    """One missing fact.

    `what`: the fact. `option`: the option by which the user states it, with `?` in place of the value.
    """

    what: str
    option: str


OVERRULE = "If the file is wrong, add --overrule."
"""If the user's options contradict the file, the message about this ends in this sentence."""

ASK = "Say it, with the right value for each ?: "
"""Text before the options in a `NotStated` message. Callers insert the command to type after this text."""


def says_otherwise(where: str, fact: str, option: str, given: object) -> UsageError:
    """Return the error for an option, whose value is `given`, that contradicts a fact about the file."""
    return UsageError(f"{where}: {fact}, and {option} {given} says otherwise. Leave {option} out. {OVERRULE}")


class NotStated(UsageError):
    """Raised if facts about a file are missing that the user must state.

    `missing`, `table`: see `not_stated`.
    """

    missing: Sequence[Missing] = ()
    table: str = ""


def not_stated(
    where: str, missing: Sequence[Missing], known: Sequence[str] = (), table: str = ""
) -> NotStated:
    """Return the error that asks the user for the missing facts about a file.

    `where`: file, for messages. `known`: options, with values, that the user gave. `missing`: the missing
    facts.
    `table`: lines of text that show the result of each possible answer for these data.
    """
    what = "; and ".join(one.what for one in missing)
    options = " ".join([*known, *(one.option for one in missing if one.option)])
    text = f"{where}: nothing says {what}. {ASK}{options}"
    error = NotStated(f"{text}\n{table}" if table else text)
    error.missing, error.table = missing, table
    return error


def asked_with(where: str, first: Missing, known: Sequence[str], then: Callable[[], object]) -> NotStated:
    """Return the error that asks the user for the missing fact `first`, and for further missing facts.

    `then`: function that goes on as if `first` were known. It raises `NotStated` if further facts are
    missing.
    """
    try:
        then()
    except NotStated as error:
        return not_stated(where, [first, *error.missing], known, error.table)
    except UsageError:
        pass  # an error of another kind may disappear once the user states `first`
    return not_stated(where, [first], known)


def given_options(how: How) -> list[str]:
    """Return the options that the user gave, in the form in which they are typed."""
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
