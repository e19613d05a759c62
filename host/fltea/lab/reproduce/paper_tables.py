"""Tables 1–5 and section 6.2 as rows for JSON and as Markdown, beside the numbers of the paper.

Every number is a median over the seeds that have not diverged (`runs` says what that means), with the range
in which 5 to 95 % of them lie.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fltea.lab.reproduce import paper
from fltea.lab.reproduce.runs import Options, Outcome
from fltea.lab.reproduce.scenarios import Scenario
from fltea.lab.reproduce.timing import Times
from fltea.records.arrays import Array

Row = dict[str, Any]

PAPER = {2: paper.TABLE_2, 3: paper.TABLE_3, 4: paper.TABLE_4}


def spread(values: Array, printed: float | None = None) -> Row:
    """Median and 5–95 % of `values`, None where there are none or they overflow; the paper's number."""
    numbers: list[float | None] = [None] * 3
    if len(values):
        with np.errstate(all="ignore"):
            quantiles = np.percentile(values, [50, 5, 95])
        numbers = [float(q) if np.isfinite(q) else None for q in quantiles]
    return {**dict(zip(("median", "p05", "p95"), numbers, strict=True)), "paper": printed}


def outcome_row(outcome: Outcome, printed: paper.Errors | None) -> Row:
    """Seeds, divergences and the spread of the three errors."""
    good = ~outcome.diverged
    row: Row = {"seeds": len(good), "diverged": int(outcome.diverged.sum())}
    for name in paper.QUANTITIES:
        values = getattr(outcome, name)[good]
        row[name] = spread(values, None if printed is None else getattr(printed, name))
    return row


def example_rows(
    table: int, scenario: Scenario, results: Mapping[int, Outcome], options: Options
) -> list[Row]:
    """Tables 2, 3, 4: a row for each length."""
    return [
        {"L": L, **outcome_row(outcome, PAPER[table][L]), **labels(scenario, options)}
        for L, outcome in results.items()
    ]


def gyroscope_rows(
    axis: str, scenario: Scenario, results: Mapping[int, Outcome], options: Options
) -> list[Row]:
    """Table 5, one axis: the shorter length against the longest."""
    return [
        {"axis": axis, "L": L, "against": scenario.lengths[0]}
        | outcome_row(outcome, paper.TABLE_5[axis])
        | settled(outcome, paper.GYRO_SETTLED[axis])
        | labels(scenario, options)
        for L, outcome in results.items()
    ]


def unknown_rows(scenario: Scenario, results: Mapping[int, Outcome], options: Options) -> list[Row]:
    """Section 6.2: errors, and where order and parameter settle; the paper prints no numbers."""
    return [
        {"L": L, **outcome_row(outcome, None), **settled(outcome), **labels(scenario, options)}
        for L, outcome in results.items()
    ]


def time_rows(times: Mapping[int, Times]) -> list[Row]:
    """Table 1."""
    return [{"L": L, **row._asdict(), "paper_s": paper.TABLE_1[L]} for L, row in times.items()]


def settled(outcome: Outcome, printed: tuple[float | None, float | None] = (None, None)) -> Row:
    """Means of order and parameter over the last third of each run."""
    good = ~outcome.diverged
    return {
        "settled_order": spread(outcome.settled_order[good], printed[0]),
        "settled_parameter": spread(outcome.settled_parameter[good], printed[1]),
    }


def labels(scenario: Scenario, options: Options) -> Row:
    """What went in and what worked on it, so that no row can be read without."""
    return {"data": scenario.source, "R": scenario.R, "variant": options.variant, "guard": options.guard}


def document(rows: Mapping[str, Sequence[Row]]) -> str:
    """All tables as Markdown."""
    return "\n\n".join(markdown(table, rows[table]) for table in rows) + "\n"


def markdown(table: str, rows: Sequence[Row]) -> str:
    """The rows of one table as Markdown, with a caption."""
    heads, body = _LAYOUT.get(table, _beside_paper)(rows)
    lines = [f"**{_CAPTIONS[table]}**", ""]
    if table != "1":
        first = rows[0]
        data = "; ".join(dict.fromkeys(row["data"] for row in rows))
        how = f"variant {first['variant']}, guard {first['guard']}"
        many = f"{first['seeds']:,} seeds, {how}; median (5–95 %) of those that did not diverge"
        lines[1:1] = [f"{data}. {many if first['seeds'] > 1 else how}."]
    lines += ["| " + " | ".join(heads) + " |", "|" + "---|" * len(heads)]
    lines += ["| " + " | ".join(cells) + " |" for cells in body]
    return "\n".join(lines)


_CAPTIONS = {
    "1": "Table 1. Seconds for the 4,000 samples of example 1",
    "2": "Table 2. Sums of squared errors, example 1 (constant order)",
    "3": "Table 3. Sums of squared errors, example 2 (varying order)",
    "4": "Table 4. Sums of squared errors, example 3 (varying order, Gaussian input)",
    "5": "Table 5. Gyroscope: sums of squared differences between L = 3,000 and L = 1,500",
    "6.2": "Section 6.2. Unknown input, itself fractional: x of order 0.4 and f = -1",
}


def _times(rows: Sequence[Row]) -> tuple[list[str], list[list[str]]]:
    heads = ["L", "engine, direct", "engine, compressed", "numpy reference", "paper (MATLAB)"]
    keys = ("direct_s", "compressed_s", "reference_s", "paper_s")
    return heads, [[f"{row['L']:,}", *(f"{row[key]:.4g}" for key in keys)] for row in rows]


def _beside_paper(rows: Sequence[Row]) -> tuple[list[str], list[list[str]]]:
    """A column for each error, and where a gyroscope settles, with the paper's number beside it."""
    first = "axis" if "axis" in rows[0] else "L"
    columns = {name: name for name in paper.QUANTITIES}
    if first == "axis":
        columns |= {"settled_order": "order settles at", "settled_parameter": "parameter settles at"}
    heads = [first, "diverged"]
    for heading in columns.values():
        heads += [heading, "paper"]
    body = []
    for row in rows:
        cells = [row[first] if first == "axis" else f"{row[first]:,}", f"{row['diverged']:,}"]
        for key in columns:
            cells += [_cell(row[key]), f"{row[key]['paper']:.4g}"]
        body.append(cells)
    return heads, body


def _unknown(rows: Sequence[Row]) -> tuple[list[str], list[list[str]]]:
    heads = ["input", "L", "diverged", "state SSE", "order settles at", "parameter settles at"]
    body = [
        [row["data"].split(",")[0], f"{row['L']:,}", f"{row['diverged']:,}"]
        + [_cell(row[key]) for key in ("state", "settled_order", "settled_parameter")]
        for row in rows
    ]
    return heads, body


def _cell(value: Row) -> str:
    if value["median"] is None:
        return "–"
    if value["p05"] == value["p95"]:
        return f"{value['median']:.4g}"
    return f"{value['median']:.4g} ({value['p05']:.3g} … {value['p95']:.3g})"


_LAYOUT = {"1": _times, "6.2": _unknown}
