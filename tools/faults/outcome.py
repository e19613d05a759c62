"""What a fault led to, and what became of each record."""

from dataclasses import dataclass, field

LOST = "counted as lost"


@dataclass(frozen=True)
class Outcome:
    """The outcome of a fault.

    `reported`: kinds of errors and alerts, and reasons of new epochs (runs of samples without a break).
    `due`: number of records that had to arrive or to be counted as lost. `where`: for each thing that can
    become of a record, such as "delivered" or "lost", the number of records; the first entry counts those
    that arrived. `of`: name of the records, such as samples. `more`: further results as text. `figures`:
    further results as numbers. `wrong`: texts, each on something that is not as it has to be.
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
        """Number of records that are not accounted for."""
        return self.due - sum(self.where.values())

    @property
    def is_right(self) -> bool:
        """Whether it is known what became of every record, and nothing else is wrong."""
        return not self.wrong and self.uncounted == 0
