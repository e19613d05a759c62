"""One row of the report, whoever played the fault."""

from typing import NamedTuple


class Row(NamedTuple):
    """What a fault led to, and where each record went.

    told: kinds of the errors and alerts, or what the device reported. of: what is counted, such as samples.
    due: how many there were; where: what became of how many of them. more: what else there is to say. wrong:
    what should not be.
    """

    part: str
    fault: str
    told: list[str]
    of: str
    due: int
    where: dict[str, int]
    more: str
    wrong: list[str]

    @property
    def uncounted(self) -> int:
        """Those of which nobody knows; 0 if all adds up."""
        return self.due - sum(self.where.values())

    @property
    def is_right(self) -> bool:
        """Whether all is accounted for, and nothing else is wrong."""
        return not self.wrong and self.uncounted == 0

    @property
    def cells(self) -> tuple[str, ...]:
        """The row as text."""
        parts = " + ".join(f"{count} {name}" for name, count in self.where.items() if count) or "0"
        wrong = f" **{'; '.join(self.wrong)}**" if self.wrong else ""
        return (
            self.part,
            self.fault,
            ", ".join(self.told) or "–",
            f"{self.due} {self.of} = {parts}",
            str(self.uncounted),
            (self.more or "–") + wrong,
        )


HEADS = ("part", "fault", "told", "account", "uncounted", "more")


def markdown(cells: tuple[str, ...]) -> str:
    """Cells as a line of a table."""
    return f"| {' | '.join(cell.replace('|', '/').replace(chr(10), ' ') for cell in cells)} |"
