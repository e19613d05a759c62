"""Arrange tables 1–5 and section 6.2 as rows for JSON and as Markdown, with the numbers of the paper.

Each of our numbers is a median over the seeds whose runs are finite, with its 5–95 % range. Beside each of
the paper's numbers stands its percentile, which is the percentage of these seeds that have a smaller number.
Tables 3 and 4 are each compared with both examples 2 and 3, since the two tables were most likely exchanged
when the paper was printed (`exchange`).
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
EXAMPLES = {2: (1,), 3: (2, 3), 4: (3, 2)}
"""For each table, the examples with which its numbers are compared. The first is the example that the paper
names for the table.
"""


def spread(values: Array, printed: float | None = None) -> Row:
    """Return median and 5–95 % range of `values`, and the paper's number with its percentile among them.

    Median and range are None if there are no values, or if they overflow.
    """
    numbers: list[float | None] = [None] * 3
    if len(values):
        with np.errstate(all="ignore"):
            quantiles = np.percentile(values, [50, 5, 95])
        numbers = [float(q) if np.isfinite(q) else None for q in quantiles]
    row: Row = dict(zip(("median", "p05", "p95"), numbers, strict=True))
    return row | {"paper": printed, "percentile": percentile(values, printed)}


def percentile(values: Array, printed: float | None) -> float | None:
    """Return the percentage of `values` below `printed`, the paper's number; None if either is missing.

    A value that equals `printed` counts half.
    """
    if printed is None or not len(values):
        return None
    return float(100 * (np.mean(values < printed) + np.mean(values == printed) / 2))


def outcome_row(outcome: Outcome, printed: paper.Errors | None) -> Row:
    """Return the numbers of seeds and of diverged runs, and the finite runs' errors: median and range."""
    good = ~outcome.not_finite
    row: Row = {
        "seeds": len(good),
        "not_finite": int(outcome.not_finite.sum()),
        "far_off": int(outcome.far_off.sum()),
    }
    for name in paper.QUANTITIES:
        values = getattr(outcome, name)[good]
        row[name] = spread(values, None if printed is None else getattr(printed, name))
    return row


def changes(results: Mapping[int, Outcome], L: int) -> dict[str, tuple[Array, Array]]:
    """Return how each error changes from the longest L to `L`, and the error at the longest L.

    Both are arrays with one number for each seed. Seeds with an error that is not finite are left out.
    """
    first, short = next(iter(results.values())), results[L]
    found = {}
    for name in paper.QUANTITIES:
        before, after = getattr(first, name), getattr(short, name)
        finite = np.isfinite(before) & np.isfinite(after) & ~first.not_finite & ~short.not_finite
        found[name] = (after[finite] - before[finite], before[finite])
    return found


def printed_change(table: int, L: int, name: str) -> float:
    """Return the difference between the paper's numbers at `L` and at L = 4,000."""
    printed = PAPER[table]
    return float(getattr(printed[L], name) - getattr(printed[paper.SAMPLES], name))


def example_rows(
    table: int, example: int, scenario: Scenario, results: Mapping[int, Outcome], options: Options
) -> list[Row]:
    """Compare table 2, 3 or 4 with one example: return one row for each length L.

    Rows of the shorter lengths also have `change`, the change of the errors from those at the longest length.
    """
    rows = []
    for L, outcome in results.items():
        row: Row = {"example": example, "L": L, **outcome_row(outcome, PAPER[table][L])}
        if scenario.lengths[0] != L:
            row["change"] = {
                name: spread(difference, printed_change(table, L, name))
                for name, (difference, _) in changes(results, L).items()
            }
        rows.append(row | labels(scenario, options))
    return rows


def gyroscope_rows(
    axis: str, scenario: Scenario, results: Mapping[int, Outcome], options: Options
) -> list[Row]:
    """Return the rows of table 5 for one axis: estimates with shorter lengths L compared with the longest."""
    return [
        {"axis": axis, "L": L, "against": scenario.lengths[0]}
        | outcome_row(outcome, paper.TABLE_5[axis])
        | accepted(outcome, paper.GYRO_SETTLED[axis])
        | labels(scenario, options)
        for L, outcome in results.items()
    ]


def unknown_rows(scenario: Scenario, results: Mapping[int, Outcome], options: Options) -> list[Row]:
    """Return the rows of the paper's section 6.2: errors, and final order and parameter.

    The paper gives no numbers for this section.
    """
    return [
        {"L": L, **outcome_row(outcome, None), **accepted(outcome), **labels(scenario, options)}
        for L, outcome in results.items()
    ]


def time_rows(times: Mapping[int, Times]) -> list[Row]:
    """Return the rows of table 1, which are running times for each length L."""
    return [{"L": L, **row._asdict(), "paper_s": paper.TABLE_1[L]} for L, row in times.items()]


def accepted(outcome: Outcome, printed: tuple[float | None, float | None] = (None, None)) -> Row:
    """Return the order and the parameter on which runs settle: median and range over the finite runs.

    A run settles on the mean over its last third.
    """
    good = ~outcome.not_finite
    return {
        "settled_order": spread(outcome.settled_order[good], printed[0]),
        "settled_parameter": spread(outcome.settled_parameter[good], printed[1]),
    }


def labels(scenario: Scenario, options: Options) -> Row:
    """Return the description of data and settings that every row of a table contains."""
    return {"data": scenario.source, "R": scenario.R, "variant": options.variant, "guard": options.guard}


def document(rows: Mapping[str, Sequence[Row]], remarks: Sequence[str] = ()) -> str:
    """Return all tables as Markdown, with remarks below them."""
    return "\n\n".join([*(markdown(table, rows[table]) for table in rows), *remarks]) + "\n"


def markdown(table: str, rows: Sequence[Row]) -> str:
    """Return the rows of one table as Markdown, with a caption."""
    heads, body = _LAYOUT.get(table, _beside_paper)(rows)
    lines = [f"**{_CAPTIONS[table]}**", ""]
    if table != "1":
        lines[1:1] = [_how(rows)]
    lines += ["| " + " | ".join(heads) + " |", "|" + "---|" * len(heads)]
    lines += ["| " + " | ".join(cells) + " |" for cells in body]
    return "\n".join(lines)


def _how(rows: Sequence[Row]) -> str:
    """Return the text above a table. It describes the data, and says how to read the table's numbers."""
    first = rows[0]
    named = [f"Example {row['example']}: {row['data']}" if "example" in row else row["data"] for row in rows]
    how = f"{'; '.join(dict.fromkeys(named))}. Variant {first['variant']}, guard {first['guard']}"
    if first["seeds"] == 1:
        return f"{how}."
    how += f", {first['seeds']:,} seeds; median (5–95 %) of those that are finite."
    if "example" not in first:
        return how
    return (
        f"{how} In brackets after the paper's number: its percentile, the percentage of these seeds with a "
        f"smaller number (standard error up to {50 / first['seeds'] ** 0.5:.2g})."
    )


_CAPTIONS = {
    "1": "Table 1. Seconds for the 4,000 samples of example 1",
    "2": "Table 2. Sums of squared errors, example 1 (constant order, saw-tooth)",
    "3": "Table 3. Sums of squared errors; the paper names example 2 (varying order, saw-tooth)",
    "4": "Table 4. Sums of squared errors; the paper names example 3 (varying order, Gaussian input)",
    "5": "Table 5. Gyroscope: sums of squared differences between L = 3,000 and L = 1,500",
    "6.2": "Section 6.2. Unknown input, itself fractional: x of order 0.4 and f = -1",
}


def _times(rows: Sequence[Row]) -> tuple[list[str], list[list[str]]]:
    heads = ["L", "engine, direct", "engine, compressed", "numpy reference", "paper (MATLAB)"]
    keys = ("direct_s", "compressed_s", "reference_s", "paper_s")
    return heads, [[f"{row['L']:,}", *(f"{row[key]:.4g}" for key in keys)] for row in rows]


def _examples(rows: Sequence[Row]) -> tuple[list[str], list[list[str]]]:
    """Lay out tables 2 to 4.

    For each example, there is a row for each length L, and a row for the change of the errors from the
    longest L to the shortest.
    """
    heads = ["seeds of", "L", "not finite", "far off"]
    for name in paper.QUANTITIES:
        heads += [name, "paper (percentile)"]
    body = []
    for row in rows:
        exchanged = row["example"] != rows[0]["example"]
        label = f"example {row['example']}" + (", exchanged" if exchanged else "")
        cells = [label, f"{row['L']:,}", f"{row['not_finite']:,}", f"{row['far_off']:,}"]
        for name in paper.QUANTITIES:
            cells += [_cell(row[name]), _printed(row[name])]
        body.append(cells)
        if row["L"] == rows[-1]["L"]:
            cells = ["", f"{paper.SAMPLES:,} to {row['L']:,}", "", ""]
            for name in paper.QUANTITIES:
                change = row["change"][name]
                cells += [_cell(change, "+"), _printed(change, "+")]
            body.append(cells)
    return heads, body


def _printed(value: Row, sign: str = "") -> str:
    """Format the paper's number, followed by its percentile in brackets."""
    share = "–" if value["percentile"] is None else percent_text(value["percentile"])
    return f"{value['paper']:{sign}.4g} ({share})"


def percent_text(share: float) -> str:
    """Format a percentile with three digits.

    It is shown as 0 only if it is exactly 0, and as 100 only if it is exactly 100.
    """
    return f"{share:.3g}" if share in {0.0, 100.0} else f"{np.clip(share, 0.01, 99.9):.3g}"


def _beside_paper(rows: Sequence[Row]) -> tuple[list[str], list[list[str]]]:
    """Lay out table 5, with each of our numbers beside the paper's.

    For each axis these are the errors of state, order and parameter, and the order and parameter at the end.
    """
    columns = {name: name for name in paper.QUANTITIES}
    columns |= {"settled_order": "order settles at", "settled_parameter": "parameter settles at"}
    heads = ["axis", "not finite", "far off"]
    for heading in columns.values():
        heads += [heading, "paper"]
    body = []
    for row in rows:
        cells = [row["axis"], f"{row['not_finite']:,}", f"{row['far_off']:,}"]
        for key in columns:
            cells += [_cell(row[key]), f"{row[key]['paper']:.4g}"]
        body.append(cells)
    return heads, body


def _unknown(rows: Sequence[Row]) -> tuple[list[str], list[list[str]]]:
    heads = ["input", "L", "not finite", "far off", "state SSE", "order settles at", "parameter settles at"]
    body = [
        [row["data"].split(",")[0], f"{row['L']:,}", f"{row['not_finite']:,}", f"{row['far_off']:,}"]
        + [_cell(row[key]) for key in ("state", "settled_order", "settled_parameter")]
        for row in rows
    ]
    return heads, body


def _cell(value: Row, sign: str = "") -> str:
    if value["median"] is None:
        return "–"
    if value["p05"] == value["p95"]:
        return f"{value['median']:{sign}.4g}"
    low, high = ("–" if value[key] is None else f"{value[key]:{sign}.3g}" for key in ("p05", "p95"))
    return f"{value['median']:{sign}.{3 if sign else 4}g} ({low} … {high})"


_LAYOUT = {"1": _times, "2": _examples, "3": _examples, "4": _examples, "6.2": _unknown}
