"""Tables of results, for a terminal and as Markdown, and cells with proportions and their intervals."""

from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple, TypeVar

from rich.box import SIMPLE_HEAD
from rich.table import Table as Drawn
from rich.text import Text
from scipy.stats import binomtest, norm

T = TypeVar("T")
K = TypeVar("K", bound=Hashable)

NONE = "–"
"""Text of a cell that has no value."""
Z = float(norm.ppf(0.975))
"""95 % of a normal distribution lie within ± Z standard deviations."""


class Table(NamedTuple):
    """A table: rows of text under a title and headings."""

    title: str
    headings: Sequence[str]
    rows: Sequence[Sequence[str]]
    brief: bool = True
    """Whether the table is short enough to be shown in a terminal. Other tables are only written to the file.
    """

    def markdown(self) -> str:
        """Return the table as Markdown, after its title."""
        lines = [self.headings, ["---"] * len(self.headings), *self.rows]
        return f"### {self.title}\n\n" + "".join("| " + " | ".join(cells) + " |\n" for cells in lines)

    def drawn(self) -> Drawn:
        """Return the table as an object of the library rich, which prints it in a terminal."""
        table = Drawn(title=self.title, title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
        for number, heading in enumerate(self.headings):
            table.add_column(heading, justify="right" if number else "left")
        for row in self.rows:
            table.add_row(*map(Text, row))
        return table


def table(title: str, rows: Iterable[Any], columns: Mapping[str, Callable[[Any], str]]) -> Table:
    """Return a table. In each row, it has the text of each column under the column's heading."""
    return Table(title, tuple(columns), [tuple(of(row) for of in columns.values()) for row in rows])


def number(value: float | None, form: str) -> str:
    """Return a cell with a number, or with NONE."""
    return NONE if value is None or value != value else format(value, form)


def share(count: int, total: int) -> str:
    """Return a cell with a proportion in percent."""
    return number(count / total if total else None, ".1%")


def interval(count: int, total: int) -> tuple[float, float]:
    """Return the 95 % interval of a proportion (Wilson's interval)."""
    found = binomtest(count, total).proportion_ci(method="wilson")
    return float(found.low), float(found.high)


def share_within(count: int, total: int) -> str:
    """Return a cell with a proportion and its 95 % interval."""
    low, high = interval(count, total)
    return f"{share(count, total)} ({100 * low:.0f}…{100 * high:.0f})"


def grouped(rows: Iterable[T], key: Callable[[T], K]) -> dict[K, list[T]]:
    """Return the rows grouped by key, in the order in which the keys first appear."""
    groups: dict[K, list[T]] = {}
    for row in rows:
        groups.setdefault(key(row), []).append(row)
    return groups
