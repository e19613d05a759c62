"""What became of every sample: it was delivered, or counted as lost, or nobody can know."""

from collections import Counter
from collections.abc import Callable, Collection, Sequence
from typing import Any, NamedTuple

Sample = tuple[Any, int]
"""Whose sample it is, such as the name of a board, and its number there."""
Record = dict[str, Any]


class Heard(NamedTuple):
    """What one program reported: how often it delivered each sample, and how often it counted it as lost."""

    delivered: Counter[Sample]
    lost: Counter[Sample]


class Account(NamedTuple):
    """Where so many samples are, by name of the place; wrong: what cannot be."""

    due: int
    where: dict[str, int]
    wrong: list[str]


def heard(records: Sequence[Record], sample: Callable[[Record], Sample]) -> Heard:
    """Read a program's records. sample: which one a `sample` is, or the first that a `gap` misses."""
    found = Heard(Counter(), Counter())
    for record in records:
        if record["class"] == "sample":
            found.delivered[sample(record)] += 1
        elif record["class"] == "gap":
            whose, number = sample(record)
            found.lost.update((whose, number + k) for k in range(record["missing"]))
    return found


def account(
    due: set[Sample],
    programs: Sequence[Heard],
    excused: Collection[Sample] = (),
    excuse: str = "",
    *,
    once: bool = False,
) -> Account:
    """Hold what the programs reported together against the samples that were due.

    excused: due samples of which nobody can know, if they were not delivered; excuse: why. once: each may be
    delivered once only, and counted as lost once.
    """
    delivered, lost = Counter[Sample](), Counter[Sample]()
    for program in programs:
        delivered.update(program.delivered)
        lost.update(program.lost)
    both = delivered.keys() & lost.keys()
    missed = lost.keys() - delivered.keys()
    rest = set(excused) - delivered.keys() - missed
    checks = {
        "nobody sent": (delivered.keys() | lost.keys()) - due,
        "counted as lost, but delivered": both,
        "counted as lost, but nothing came after it": missed & set(excused) if once else set(),
        "nobody knows of": due - delivered.keys() - lost.keys() - rest,
        "delivered twice": {one for one, times in delivered.items() if once and times > 1},
        "counted as lost twice": {one for one, times in lost.items() if once and times > 1},
    }
    where = {"delivered": len(delivered), "counted as lost": len(missed)} | (
        {excuse: len(rest)} if excuse else {}
    )
    return Account(len(due), where, [f"{what}: {shown(which)}" for what, which in checks.items() if which])


def shown(samples: set[Sample]) -> str:
    """How many there are of each source, and from which number on."""
    counts = Counter(whose for whose, _ in samples)
    return ", ".join(
        f"{count} of {whose} from {min(number for one, number in samples if one == whose)}"
        for whose, count in sorted(counts.items())
    )
