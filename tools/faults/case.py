"""A fault and its outcome, functions that play faults, and the table of outcomes in Markdown."""

import itertools
import tempfile
import traceback
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from tools.faults.program import Skip
from tools.faults.stage import Stage

HEADS = ("part", "fault", "reported", "account", "uncounted", "more")
NOT_PLAYED = "not played"


@dataclass(frozen=True)
class Outcome:
    """What a fault led to, and what became of each record.

    `reported`: kinds of errors and alerts, and reasons of new epochs. `due`: number of records. `where`:
    number of records by what became of them. `of`: name of the records, such as samples. `more`, `figures`:
    further results as text and as numbers. `wrong`: what must not be.
    """

    reported: list[str]
    due: int
    where: dict[str, int]
    of: str = "samples"
    more: str = ""
    figures: dict[str, float] = field(default_factory=dict)
    wrong: list[str] = field(default_factory=list)

    @property
    def uncounted(self) -> int:
        """Number of records that are not accounted for; 0 if all are."""
        return self.due - sum(self.where.values())

    @property
    def is_right(self) -> bool:
        """Whether all records are accounted for, and nothing else is wrong."""
        return not self.wrong and self.uncounted == 0


class Case(NamedTuple):
    """A fault: its name in the report, and the function that plays it."""

    name: str
    play: Callable[[Stage], Outcome]


def play(case: Case, **how: Any) -> Outcome:
    """Play a fault in a folder of its own. An exception becomes a wrong outcome.

    `how`: see `Stage`.

    Raises:
        Skip: something is missing on this machine.
    """
    # The last child of a killed browser may still write into the folder while it is removed.
    with tempfile.TemporaryDirectory(prefix="fault-", ignore_cleanup_errors=True) as folder:
        try:
            with Stage(Path(folder), **how) as stage:
                return case.play(stage)
        except Skip:
            raise
        except ModuleNotFoundError as error:
            raise Skip(f"{error.name} is not installed: pip install 'fltea[all]'") from error
        except (Exception, SystemExit):
            return Outcome([], 0, {}, wrong=[traceback.format_exc()])


def play_all(cases: Sequence[Case], *, at_once: int, **how: Any) -> dict[str, "Future[Outcome]"]:
    """Play several faults, `at_once` at a time, since they mostly wait; return the outcomes by name."""
    pool = ThreadPoolExecutor(at_once)
    found = {case.name: pool.submit(play, case, **how) for case in cases}
    pool.shutdown(wait=False)
    return found


def line(cells: tuple[str, ...]) -> str:
    """Return the cells as a row of a table."""
    return f"| {' | '.join(cell.replace('|', '/').replace(chr(10), ' ') for cell in cells)} |"


def cells(name: str, one: Outcome) -> tuple[str, ...]:
    """Return the cells of a row, without the part."""
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
    """Return the table of parts, names and outcomes, and a summary."""
    lines = [line(HEADS), "|---" * len(HEADS) + "|"]
    lines += [line((part, *cells(name, one))) for part, name, one in rows]
    wrong = sum(not one.is_right for _, _, one in rows)
    left_out = sum(one.more.startswith(NOT_PLAYED) for _, _, one in rows)
    summary = f"{len(rows)} faults; {wrong} that are wrong or do not add up; {left_out} not played."
    return "\n".join((*lines, "", summary)) + "\n"


def _number(value: float) -> str:
    return str(value) if isinstance(value, int) else f"{value:.2g}"
