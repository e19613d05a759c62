"""Faults of the daemon's line, outputs and program, as `tools.fault_script` plays them."""

from collections.abc import Iterator
from itertools import groupby

from tools.fault_script.cases import CASES, Case, play_all
from tools.fault_script.stage import Outcome, Skip
from tools.faults.row import Row

PART = "daemon"
AT_ONCE = 2


def rows(words: list[str]) -> Iterator[Row]:
    """One of each case, in the short form."""
    cases = [case for case in CASES if not words or any(word in case.name for word in words)]
    playing = play_all(cases, short=True, at_once=AT_ONCE)
    for case in cases:
        try:
            yield row_of(case, playing[case.name].result())
        except Skip as why:  # others need less
            yield Row(PART, case.name, [], "samples", 0, {}, f"not played: {why}", [])


def row_of(case: Case, outcome: Outcome) -> Row:
    """An outcome in the report's words."""
    books = outcome.account
    where = {
        "delivered": books.delivered,
        "counted as lost": books.lost,
        case.rest or "unheard": books.unheard,
    }
    told = [kind for kind, _ in groupby((*outcome.errors, *outcome.epochs))]
    return Row(PART, case.name, told, "samples", books.due, where, outcome.others, list(outcome.wrong))
