"""Faults of a fleet of daemons and its page, as `tools.fleet_faults` plays them."""

from collections.abc import Callable, Iterator
from functools import update_wrapper
from pathlib import Path

from tools import fleet_faults
from tools.faults.fleet_stage import Outcome
from tools.faults.played import played
from tools.faults.row import Row

PART = "fleet"


def rows(words: list[str]) -> Iterator[Row]:
    """One of each case."""
    return played(PART, map(_case, fleet_faults.CASES), words, at_once=2)


def _case(case: Callable[[Path], Outcome]) -> Callable[[Path], Row]:
    def play(folder: Path) -> Row:
        one = case(folder)
        return Row(PART, one.name, one.told, one.of, one.due, one.where, one.account, one.wrong)

    update_wrapper(play, case)
    return play
