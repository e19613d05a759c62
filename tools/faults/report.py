"""Outcomes as a table in Markdown."""

import itertools

from tools.faults.case import Outcome

HEADS = ("part", "fault", "reported", "account", "uncounted", "more")
NOT_PLAYED = "not played"


def line(cells: tuple[str, ...]) -> str:
    """Cells as a line of a table."""
    return f"| {' | '.join(cell.replace('|', '/').replace(chr(10), ' ') for cell in cells)} |"


def cells(name: str, one: Outcome) -> tuple[str, ...]:
    """What stands in a row, but for the part."""
    parts = " + ".join(f"{count} {where}" for where, count in one.where.items() if count) or "0"
    figures = (f"{what} {_number(value)}" for what, value in one.figures.items())
    wrong = f" **{'; '.join(one.wrong)}**" if one.wrong else ""
    return (
        name,
        ", ".join(kind for kind, _ in itertools.groupby(one.reported)) or "–",
        f"{one.due} {one.of} = {parts}",
        str(one.uncounted),
        ("; ".join(filter(None, (one.more, *figures))) or "–") + wrong,
    )


def report(rows: list[tuple[str, str, Outcome]]) -> str:
    """The table of parts, names and outcomes, and what it comes to."""
    lines = [line(HEADS), "|---" * len(HEADS) + "|"]
    lines += [line((part, *cells(name, one))) for part, name, one in rows]
    wrong = sum(not one.is_right for _, _, one in rows)
    left_out = sum(one.more.startswith(NOT_PLAYED) for _, _, one in rows)
    summary = f"{len(rows)} faults; {wrong} that are wrong or do not add up; {left_out} not played."
    return "\n".join((*lines, "", summary)) + "\n"


def _number(value: float) -> str:
    return str(value) if isinstance(value, int) else f"{value:.2g}"
