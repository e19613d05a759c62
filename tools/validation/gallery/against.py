"""Compares two runs of the gallery: which verdicts became better, worse, or only different.

The verdicts are compared separately in each cell, which is a noise at one rate and length.
"""

from collections import Counter
from typing import Any

from tools.validation.runner import Row
from tools.validation.tables import Table, share

RANK = {"wrong": 0, "cannot be told": 1, "right": 2}
CHANGES = ("better", "worse", "other, as good", "same")
CELL = ("noise", "rate_hz", "duration_s", "record")


def change(before: Row, after: Row) -> str:
    """Return how the verdict on one record changed between two runs: one of `CHANGES`."""
    gain = RANK[after["outcome"]] - RANK[before["outcome"]]
    if gain:
        return "better" if gain > 0 else "worse"
    return "same" if before["kind"] == after["kind"] else "other, as good"


def tables(before: list[Row], after: list[Row]) -> list[Table | str]:
    """Compare two runs: return the number of changes as text, and a table of changed verdicts.

    Another text says how often α's interval contains the true α.
    """
    known = {_cell(row): row for row in before}
    pairs = [(known[_cell(row)], row) for row in after if _cell(row) in known]
    changes = [(change(*pair), *pair) for pair in pairs]
    count = Counter(what for what, _, _ in changes)
    cells = [
        (what, *map(str, _cell(new)), _said(old), _said(new), ", ".join(new["right"]))
        for what, old, new in sorted(changes, key=lambda one: CHANGES.index(one[0]))
        if what != "same"
    ]
    counted = ", ".join(f"{count[what]} {what}" for what in CHANGES)
    return [
        f"Of {len(pairs)} cells of both runs: {counted}.",
        f"Intervals that hold the true α: {_holding([old for old, _ in pairs])} before, "
        f"{_holding([new for _, new in pairs])} now.",
        Table("Changed cells", ("change", *CELL, "before", "now", "right would be"), cells),
    ]


def _cell(row: Row) -> tuple[Any, ...]:
    return tuple(row[name] for name in CELL)


def _said(row: Row) -> str:
    return f"{row['kind']} ({row['outcome']})"


def _holding(rows: list[Row]) -> str:
    """Return a text that says how many of the intervals with two ends contain the true α."""
    with_ends = [
        row for row in rows if row["true_alpha"] is not None and row["alpha"] and None not in row["alpha"]
    ]
    held = sum(row["alpha"][1] <= row["true_alpha"] <= row["alpha"][2] for row in with_ends)
    return f"{held} of {len(with_ends)} ({share(held, len(with_ends))})"
