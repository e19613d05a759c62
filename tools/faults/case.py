"""A fault with its expected outcome, functions that cause faults, and the table of outcomes in Markdown."""

import tempfile
import traceback
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from tools.faults.expected import Expected, shown
from tools.faults.outcome import Outcome
from tools.faults.program import Skip
from tools.faults.stage import Stage

HEADS = ("part", "fault", "reported", "account", "uncounted", "more")
NOT_PLAYED = "not played"


class Case(NamedTuple):
    """A fault: its name in the report, the function that causes it, and its expected outcome.

    `tested`: whether the second tier of tests includes this fault; faults that take too long are left out.
    """

    name: str
    play: Callable[[Stage], Outcome]
    expected: Expected
    tested: bool = True


def play(case: Case, **how: Any) -> Outcome:
    """Cause a fault in a folder of its own, and compare its outcome with the expected outcome.

    A difference from the expected outcome counts as an error, and so does an exception.

    `how`: options of `Stage`.

    Raises:
        Skip: a program or a permission that the fault needs is missing on this machine.
    """
    # The last child of a killed browser may still write into the folder while it is removed.
    with tempfile.TemporaryDirectory(prefix="fault-", ignore_cleanup_errors=True) as folder:
        try:
            with Stage(Path(folder), **how) as stage:
                outcome = case.play(stage)
                differences = case.expected.differences(outcome, short=stage.short)
                return replace(outcome, wrong=[*outcome.wrong, *differences])
        except Skip:
            raise
        except ModuleNotFoundError as error:
            raise Skip(f"{error.name} is not installed: pip install 'fltea[all]'") from error
        except (Exception, SystemExit):
            return Outcome([], 0, {}, wrong=[traceback.format_exc()])


def play_all(cases: Sequence[Case], *, at_once: int, **how: Any) -> dict[str, "Future[Outcome]"]:
    """Cause several faults, `at_once` of them at the same time.

    Several faults can run at once, because they mostly wait and need little processor time.

    Return immediately: for each fault's name, a `Future` whose result will be the outcome.
    """
    pool = ThreadPoolExecutor(at_once)
    found = {case.name: pool.submit(play, case, **how) for case in cases}
    pool.shutdown(wait=False)
    return found


def line(cells: tuple[str, ...]) -> str:
    """Return the cells as a row of a table in Markdown."""
    return f"| {' | '.join(cell.replace('|', '/').replace(chr(10), ' ') for cell in cells)} |"


def cells(name: str, one: Outcome) -> tuple[str, ...]:
    """Return the cells of a fault's row in the report's table, except the first (the part of the system)."""
    parts = " + ".join(f"{count} {where}" for where, count in one.where.items() if count) or "0"
    figures = (f"{what} {_number(value)}" for what, value in one.figures.items())
    wrong = f" **{'; '.join(one.wrong)}**" if one.wrong else ""
    return (
        name,
        shown(one.reported),
        f"{one.due} {one.of} = {parts}",
        str(one.uncounted),
        ("; ".join(filter(None, (one.more, *figures))) or "–") + wrong,
    )


def report(rows: list[tuple[str, str, Outcome]]) -> str:
    """Return a table in Markdown from `rows` (part, name of the fault, outcome), with a summary below it."""
    lines = [line(HEADS), "|---" * len(HEADS) + "|"]
    lines += [line((part, *cells(name, one))) for part, name, one in rows]
    wrong = sum(not one.is_right for _, _, one in rows)
    left_out = sum(one.more.startswith(NOT_PLAYED) for _, _, one in rows)
    summary = f"{len(rows)} faults; {wrong} that are wrong or do not add up; {left_out} not played."
    return "\n".join((*lines, "", summary)) + "\n"


def _number(value: float) -> str:
    return str(value) if isinstance(value, int) else f"{value:.2g}"
