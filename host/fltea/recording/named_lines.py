"""Chooses the columns to read in lines that name each of their numbers: JSON objects, or labelled numbers."""

from collections.abc import Callable, Sequence

from fltea.recording.columns import Chosen, choose
from fltea.recording.dialects import Facts
from fltea.recording.evidence import axes_of
from fltea.recording.files import listed
from fltea.recording.text_fields import MOST_COLUMNS, rows_alike
from fltea.recording.text_labels import decode_object, labelled, units_beside, values_in
from fltea.recording.wanted import wanted_of
from fltea.settings.how import How

MOST_LOOKED_AT = 200
"""Largest number of lines whose labels are collected before columns are chosen."""


class NamedLines:
    """Chooses the columns to read in lines that name their numbers.

    `where`: file, for messages. `sample`: function that returns the lines read so far. `facts`: function that
    takes the names in a line, and returns what else the file states. `are_names`: function that takes names
    and their units, and returns whether the wanted columns are among them.
    `why_not`: reason why the columns of a line cannot be read, "" if there is none.
    """

    def __init__(
        self,
        where: str,
        how: How,
        sample: Callable[[], Sequence[str]],
        facts: Callable[[Sequence[str]], Facts],
        are_names: Callable[[Sequence[str], Sequence[str]], bool],
    ) -> None:
        self.why_not = ""
        self._where, self._how, self._sample, self._facts = where, how, sample, facts
        self._are_names, self._wanted = are_names, wanted_of(how)
        self._alike: tuple[int, list[str]] = -1, []

    def of_object(self, number: int, line: str) -> Chosen | None:
        """Return the columns to read, if a line is a JSON object with the wanted names; else None."""
        try:
            found = decode_object(line)
        except (ValueError, RecursionError):  # msgspec's errors are ValueErrors
            return None
        names = list(found)
        if len(names) > MOST_COLUMNS or not self._are_meant(names, ()):
            return None
        at = f"{self._where}:{number}"
        chosen = choose(at, names, units_beside(found), len(names), self._how, self._facts(names))
        if all(found[name] is None or type(found[name]) in (int, float) for name in chosen.read):
            return chosen
        self.why_not = f"{at}: {listed(chosen.read)}: not all are numbers."
        return None

    def of_labels(self, number: int, line: str) -> Chosen | None:
        """Return the columns to read, if a line such as `gx:1.2,gy:0.3` has the wanted names; else None."""
        found = labelled(line)
        if found is None:
            return None
        names, units = list(found.values), list(found.units.values())
        if not self._are_meant(names, units):
            return None
        at = f"{self._where}:{number}"
        lines = self._sample()[:MOST_LOOKED_AT]
        others = sorted({name for one in lines for name in values_in(one)} - {*names})
        axes = axes_of(names, units)
        if self._wanted.columns is None and axes and (elsewhere := axes_of(others).keys() - axes.keys()):
            axis = ", ".join(sorted(elsewhere))
            self.why_not = (
                f"{at}: the axis {axis} stands on another line, so which numbers are of one sample "
            )
            self.why_not += "is not known. Write the axes of a sample in one line: gx:1.2,gy:0.3,gz:0.1"
            return None
        facts = self._facts(names)._replace(beside=others)
        return choose(at, names, units, len(names), self._how, facts)

    def _are_meant(self, names: Sequence[str], units: Sequence[str]) -> bool:
        """Return whether the wanted columns are among these names of a line.

        If the user gives positions, they count only in lines that have the most common names.
        """
        if not self._wanted.by_position or self._wanted.is_in(names):
            return self._are_names(names, units)
        lines = self._sample()
        if self._alike[0] != len(lines):
            kind, alike = rows_alike(lines)
            if kind == "row" or not alike:
                self._alike = len(lines), []
            else:
                first = decode_object(alike[0]) if kind == "object" else values_in(alike[0])
                self._alike = len(lines), list(first)
        return names == self._alike[1] and all(int(place) <= len(names) for place in self._wanted.names)
