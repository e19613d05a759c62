"""Outcomes as a table."""

import itertools
from collections.abc import Iterator

from tools.fault_script.cases import Case
from tools.fault_script.stage import UNINTERRUPTED_S, Outcome

HEADS = (
    "fault",
    "errors told",
    "new epochs",
    "samples due = delivered + lost + rest",
    "uncounted",
    "estimates again after",
    "other outputs",
)


def steady_cells(case: Case, outcome: Outcome) -> tuple[str, str, str]:
    """What is the same whenever it is played, long or short."""
    told = [kind for kind, _ in itertools.groupby(outcome.errors)]
    return case.name, ", ".join(told) or "–", ", ".join(outcome.epochs) or "–"


def cells(case: Case, outcome: Outcome) -> tuple[str, ...]:
    """One row."""
    a = outcome.account
    rest = f" ({case.rest})" if a.unheard else ""
    others = outcome.others
    if outcome.figures:
        others += "; " + ", ".join(f"{name} {_number(value)}" for name, value in outcome.figures.items())
    return (
        *steady_cells(case, outcome),
        f"{a.due} = {a.delivered} + {a.lost} + {a.unheard}{rest}",
        str(a.uncounted),
        _again(outcome),
        others,
    )


def markdown(rows: list[tuple[Case, Outcome]]) -> Iterator[str]:
    """The table, line by line."""
    yield line(HEADS)
    yield "|---" * len(HEADS) + "|"
    for case, outcome in rows:
        yield line(cells(case, outcome))


def line(found: tuple[str, ...]) -> str:
    """Cells as a line of Markdown."""
    return f"| {' | '.join(found)} |"


def _again(outcome: Outcome) -> str:
    if outcome.pause_s < UNINTERRUPTED_S:
        return "not interrupted"
    return "at once" if outcome.again_s < UNINTERRUPTED_S else f"{outcome.again_s:.1f} s"


def _number(value: float) -> str:
    return str(value) if isinstance(value, int) else f"{value:.2g}"
