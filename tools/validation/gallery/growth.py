"""Measures whether more data ever give a weaker verdict, on growing records of the gallery's noises.

A record of each noise is drawn at the greatest length, and the shorter records are beginnings of it. Each
verdict is compared with the verdict on the next shorter record. It is weaker than that in two cases:

- It is wrong, and the verdict on the shorter record was right.
- It is "white" although "white" is not right, and the verdict on the shorter record was not "white".
"""

import itertools
from collections import Counter

from tools.validation.gallery.noises import NOISES
from tools.validation.gallery.records import draw, judged
from tools.validation.runner import Options, Row, Task
from tools.validation.tables import Table, grouped

SEEDS, QUICK_SEEDS = 4, 1
LENGTHS = (3_000, 20_000, 60_000, 200_000)
RATE_HZ = 100.0
FIRST = 500
"""Number of the first record of each noise.

The gallery's rules were developed with other records, which have other numbers.
"""
SHORT: dict[str, str] = {"fractional or relaxations": "either", "line or resonance": "peak"}
"""Shorter names of some verdicts, for the table."""


def tasks(options: Options) -> list[Task]:
    """Return a task for each noise."""
    return [
        Task(name, grow, (name, options.first + FIRST + number), LENGTHS[-1])
        for name in NOISES
        if options.wanted(name)
        for number in range(options.seeds)
    ]


def grow(name: str, number: int) -> list[Row]:
    """Return the verdict on each beginning of a record."""
    y = draw(name, RATE_HZ, LENGTHS[-1] / RATE_HZ, number)
    return [{"noise": name, "record": number, "samples": n} | judged(name, RATE_HZ, y[:n]) for n in LENGTHS]


def says_less(rows: list[Row]) -> list[Row]:
    """Return the verdicts that are weaker than the verdict before them.

    `rows`: verdicts on the beginnings of one record, the shortest first.
    """
    return [
        after
        for before, after in itertools.pairwise(rows)
        if (before["outcome"] == "right" and after["outcome"] == "wrong")
        or (before["kind"] != "white" and after["kind"] == "white" and after["outcome"] != "right")
    ]


def tables(rows: list[Row]) -> list[Table | str]:
    """Return a sentence and two tables: the verdicts at each length, and those that became weaker.

    The second table has a row for each verdict that is weaker than that on the next shorter record.
    """
    by_noise = grouped(rows, lambda row: row["noise"])
    cells = [
        (str(name), *(_kinds([row for row in some if row["samples"] == n]) for n in LENGTHS))
        for name, some in by_noise.items()
    ]
    records = grouped(rows, lambda row: (row["noise"], row["record"]))
    less = [
        (row["noise"], str(row["record"]), f"{row['samples']:,}", row["kind"])
        for some in records.values()
        for row in says_less(some)
    ]
    return [
        f"Of {len(records)} records {len({cell[:2] for cell in less})} say less when they grow.",
        Table("Verdicts as records grow", ("noise", *(f"{n:,}" for n in LENGTHS)), cells, brief=False),
        Table("Says less", ("noise", "record", "samples", "verdict"), less),
    ]


def _kinds(rows: list[Row]) -> str:
    """Return the verdicts as text, with the number of each if they differ. ✗ marks a wrong verdict."""
    words: list[str] = [
        SHORT.get(str(row["kind"]), str(row["kind"])) + " ✗" * (row["outcome"] == "wrong") for row in rows
    ]
    counts = Counter(words)
    if len(counts) == 1:
        return words[0]
    return ", ".join(f"{kind} {count}" for kind, count in counts.most_common())
