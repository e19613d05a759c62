"""Accounts for every sample.

Each sample was delivered, or it was counted as lost, or no program can know that it is missing.
"""

from collections import Counter
from collections.abc import Callable, Collection, Sequence
from typing import Any, NamedTuple

from tools.faults.outcome import LOST
from tools.faults.program import Program

Sample = tuple[Any, int]
"""A sample, identified by its source (such as a board's name) and by its number at that source."""
Record = dict[str, Any]


class Heard(NamedTuple):
    """What one program reported: for each sample, how often it was delivered or counted as lost.

    `dropped`: number of records that the program dropped because its standard output was full, from its last
    `stats` record.
    """

    delivered: Counter[Sample]
    lost: Counter[Sample]
    dropped: int


class Account(NamedTuple):
    """Numbers of samples, by what became of them.

    `due`: number of samples that were due. `where`: how many of these were delivered, lost and so on.

    `wrong`: a text for each contradiction that was found.
    """

    due: int
    where: dict[str, int]
    wrong: list[str]


def heard(records: Sequence[Record], sample: Callable[[Record], Sample]) -> Heard:
    """Count the delivered, lost and dropped samples in a program's records.

    `sample`: function that names the sample of a record: of a `sample` record the one that it contains, of a
    `gap` record the first one that is missing.
    """
    delivered, lost, dropped = Counter[Sample](), Counter[Sample](), 0
    for record in records:
        if record["class"] == "sample":
            delivered[sample(record)] += 1
        elif record["class"] == "gap":
            whose, number = sample(record)
            lost.update((whose, number + k) for k in range(record["missing"]))
        elif record["class"] == "stats":
            dropped = record.get("outputs", {}).get("stdout", {}).get("dropped", 0)
    return Heard(delivered, lost, dropped)


def account(
    due: set[Sample],
    programs: Sequence[Heard],
    excused: Collection[Sample] = (),
    excuse: str = "",
    *,
    once: bool = False,
) -> Account:
    """Compare what the programs reported with the samples that were due.

    `excused`: due samples of which no program can know that they are missing. `excuse`: the reason for this.
    `once`: each sample may be delivered only once, and counted as lost only once.
    """
    delivered, lost = Counter[Sample](), Counter[Sample]()
    for program in programs:
        delivered.update(program.delivered)
        lost.update(program.lost)
    both = delivered.keys() & lost.keys()
    missed = lost.keys() - delivered.keys()
    rest = set(excused) - delivered.keys() - missed
    unknown = due - delivered.keys() - lost.keys() - rest
    dropped = len(unknown) if len(unknown) <= sum(one.dropped for one in programs) else 0
    checks = {
        "nobody sent": (delivered.keys() | lost.keys()) - due,
        "counted as lost, but delivered": both,
        "counted as lost, but nothing came after it": missed & set(excused) if once else set(),
        "nobody knows of": set() if dropped else unknown,
        "delivered twice": {one for one, times in delivered.items() if once and times > 1},
        "counted as lost twice": {one for one, times in lost.items() if once and times > 1},
    }
    where = {"delivered": len(delivered), LOST: len(missed)}
    where |= ({excuse: len(rest)} if excuse else {}) | ({"dropped by its output": dropped} if dropped else {})
    return Account(len(due), where, [f"{what}: {shown(which)}" for what, which in checks.items() if which])


def shown(samples: set[Sample]) -> str:
    """Return a text with the number of these samples and the smallest sample number, for each source."""
    counts = Counter(whose for whose, _ in samples)
    return ", ".join(
        f"{count} of {whose} from {min(number for one, number in samples if one == whose)}"
        for whose, count in sorted(counts.items())
    )


def wrong_ends(program: Program) -> list[str]:
    """Return what is wrong about a program's end and the last counts of its outputs.

    The list is empty if the program was killed.
    """
    if program.code is None or program.code < 0:
        return []
    found = [f"exit code {program.code}: {program.stderr[-500:]}"] if program.code else []
    found += [program.stderr[-500:]] if "Traceback" in program.stderr else []
    return found + wrong_sums(program.records)


def wrong_sums(records: Sequence[Record]) -> list[str]:
    """Return a text for each output whose counts are wrong.

    For each output, the numbers of written, dropped and queued records must add up to the number of published
    records.

    The sum may be too small by up to the number of error records: between the counting and the publication of
    the counts, another thread may publish an error record.
    """
    last = max((k for k, record in enumerate(records) if record["class"] == "stats"), default=None)
    outputs = {} if last is None else records[last].get("outputs", {})
    if last is None or "stdout" not in outputs:
        return []
    published = last + outputs["stdout"]["dropped"]
    errors = sum(record["class"] == "error" for record in records)
    sums = {name: one["written"] + one["dropped"] + one["queued"] for name, one in outputs.items()}
    # The output `record` is left out, because it also counts the recorded chunks of bytes from the serial
    # port.
    return [
        f"{name} accounts for {count} of {published} records"
        for name, count in sums.items()
        if name != "record" and not 0 <= published - count <= errors
    ]
