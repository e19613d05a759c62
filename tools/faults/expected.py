"""The expected outcome of a fault, and its comparison with the real outcome."""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from tools.faults.outcome import LOST, Outcome

Bounds = float | tuple[float, float] | None
"""What is expected of a number.

A float: exactly this value. A pair: a value from the first to the second. None: any value, since the number
depends on the machine's speed.
"""
SOME = (1, math.inf)
"""Bounds of a number that depends on the machine's speed, but must not be 0."""


@dataclass(frozen=True)
class Expected:
    """The expected outcome of a fault.

    Attributes:
        reported: Kinds of errors and alerts, and reasons of new epochs (runs of samples without a break), in
            this order. If this is a set, any order is right: the order then depends on the machine's speed.
        perhaps: Kinds that may be reported in addition, since they depend on the machine's speed.
        instead: Kinds that may be reported instead of expected ones. The key is the expected kind, the value
            the kind that may be reported in its place.
        due: Number of records that have to arrive or to be counted as lost.
        lost: Number of records that are counted as lost.
        excused: Number of records that neither arrived nor are counted as lost, but with a reason.
        figures: Bounds of the outcome's figures.

    The expected numbers of records hold for faults that last seconds, but not for those that `--long`
    prolongs.
    """

    reported: tuple[str, ...] | frozenset[str] = ()
    perhaps: frozenset[str] = frozenset()
    instead: Mapping[str, str] = field(default_factory=dict)
    due: Bounds = None
    lost: Bounds = 0
    excused: Bounds = 0
    figures: Mapping[str, Bounds] = field(default_factory=dict)

    def differences(self, outcome: Outcome, *, short: bool = True) -> list[str]:
        """Return a sentence for each difference between an outcome and this expected outcome.

        `short`: whether the fault lasted seconds; only then the numbers of records are compared.
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
        """Return whether the kinds of errors that were reported are those that this fault has to cause.

        Their order has to be right, too, if one is expected.
        """
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
    """Return the kinds as the text of a table's cell.

    A kind that occurs several times in a row is listed once.
    """
    order = sorted(kinds) if isinstance(kinds, frozenset) else kinds
    return ", ".join(kind for kind, _ in itertools.groupby(order)) or "–"
