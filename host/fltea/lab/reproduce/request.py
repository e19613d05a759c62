"""Choose tables and figures of the paper by number. The numbers are checked before anything is computed."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from fltea.lab.reproduce.runs import Options
from fltea.lab.reproduce.scenarios import SawTooth
from fltea.records.errors import UsageError
from fltea.settings.how import AS_IT_SAYS, How

TABLES = ("1", "2", "3", "4", "5", "6.2")
FIGURES = (*(str(n) for n in range(2, 11)), "6.2", *(str(n) for n in range(12, 21)))
NO_SUCH_FIGURE = "figures 2 to 10 and 12 to 20 can be drawn; 6.2 stands for section 6.2."
NO_FIGURE = {
    "1": "is the block diagram of the algorithm; there is nothing to compute.",
    "11": "is a photograph of the set-up; there is nothing to compute.",
}
DEFAULT_OUT = Path("fltea-reproduce")


@dataclass(frozen=True)
class Request:
    """Tables and figures in the order of the paper, and how to make them."""

    tables: tuple[str, ...]
    figures: tuple[str, ...]
    seeds: int
    options: Options = field(default_factory=Options)
    sawtooth: SawTooth = field(default_factory=SawTooth)
    recording: Path | None = None
    how: How = AS_IT_SAYS
    """How to read the recording."""
    out: Path | None = None
    """Folder for figures and, for each table, a CSV file with one row per seed.

    None stands for DEFAULT_OUT if there are figures, else for no folder.
    """
    everything: bool = False
    """Whether the user named no table or figure. Tables and figures of axes that the recording lacks are then
    left out.
    """

    @property
    def folder(self) -> Path | None:
        """Folder for the files; None if no files are written."""
        return self.out or (DEFAULT_OUT if self.figures else None)


def select(tables: Sequence[str], figures: Sequence[str]) -> tuple[tuple[str, ...], tuple[str, ...], bool]:
    """Return the tables and figures to make, in the paper's order, and whether the user named none.

    If the user named none, these are all tables and figures that can be made.

    Raises:
        UsageError: a table or figure that the user names is not in the paper, or a figure cannot be computed.
    """
    for table in set(tables) - set(TABLES):
        raise UsageError(
            f"--table {table}: the paper has tables 1 to 5; 6.2 stands for the example of section 6.2."
        )
    for figure in set(figures) - set(FIGURES):
        raise UsageError(f"--figure {figure}: {NO_FIGURE.get(figure, NO_SUCH_FIGURE)}")
    if not tables and not figures:
        return TABLES, FIGURES, True
    return tuple(t for t in TABLES if t in tables), tuple(f for f in FIGURES if f in figures), False
