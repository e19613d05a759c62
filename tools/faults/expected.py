"""States what a fault has to lead to, and compares it with what the fault did lead to."""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from tools.faults.outcome import LOST, Outcome

Bounds = float | tuple[float, float] | None
"""A value, or its smallest and largest value, or None if it depends on the machine's speed."""
SOME = (1, math.inf)
"""Bounds of a number that depends on the machine's speed, and is not 0."""


@dataclass(frozen=True)
class Expected:
    """What a fault has to lead to.

    Attributes:
        reported: Kinds of errors and alerts, and reasons of new epochs, in this order. A set: in any order,
            since the order depends on the machine's speed.
        perhaps: Kinds that may be reported too, since they depend on the machine's speed.
        instead: Kinds that may be reported in place of others.
        due: Number of records.
        lost: Number of records that are counted as lost.
        excused: Number of records that are neither lost nor in the outcome's first row, each of which has a
            reason.
        figures: Bounds of the outcome's figures.

    Numbers of records hold for faults that last seconds, and not for those that `--long` prolongs.
    """

    reported: tuple[str, ...] | frozenset[str] = ()
    perhaps: frozenset[str] = frozenset()
    instead: Mapping[str, str] = field(default_factory=dict)
    due: Bounds = None
    lost: Bounds = 0
    excused: Bounds = 0
    figures: Mapping[str, Bounds] = field(default_factory=dict)

    def differences(self, outcome: Outcome, *, short: bool = True) -> list[str]:
        """Return a sentence for each difference between the outcome and what is expected.

        `short`: the fault lasted seconds, so the numbers of records are those expected.
        """
        found = []
        if not self.allows(outcome.reported):
            found.append(f"reported {shown(outcome.reported)}, expected {shown(self.reported)}")
        arrived, *others = outcome.where or [""]
        if not outcome.where.get(arrived):
            found.append(f"no {outcome.of} {arrived}")
        excuses = [where for where in others if where != LOST]
        numbers = {
            "due": (outcome.due, self.due),
            LOST: (outcome.where.get(LOST, 0), self.lost),
            " + ".join(excuses) or "excused": (sum(outcome.where[one] for one in excuses), self.excused),
        }
        compared = {what: (outcome.figures.get(what), bounds) for what, bounds in self.figures.items()}
        for what, (value, bounds) in {**(numbers if short else {}), **compared}.items():
            if value is None or not within(value, bounds):
                found.append(f"{what}: {value}, expected {bounds}")
        return found

    def allows(self, reported: Sequence[str]) -> bool:
        """Return whether these are the expected kinds."""
        normal = {instead: kind for kind, instead in self.instead.items()}
        kinds = [normal.get(kind, kind) for kind in reported if kind not in self.perhaps]
        return (set(kinds) if isinstance(self.reported, frozenset) else tuple(kinds)) == self.reported


def within(value: float, bounds: Bounds) -> bool:
    """Return whether the value is the expected one, or lies within its bounds."""
    if bounds is None:
        return True
    low, high = bounds if isinstance(bounds, tuple) else (bounds, bounds)
    return low <= value <= high


def shown(kinds: Sequence[str] | frozenset[str]) -> str:
    """Return the kinds as a cell of a table, in which a kind that follows itself stands once."""
    order = sorted(kinds) if isinstance(kinds, frozenset) else kinds
    return ", ".join(kind for kind, _ in itertools.groupby(order)) or "–"
