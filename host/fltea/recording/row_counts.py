"""Counts the rows of a table. Says how many rows are no samples, and what is wrong with them."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from fltea.recording.columns import Chosen
from fltea.recording.files import LARGEST_DPS, Note, listed
from fltea.recording.sample_times import Floats
from fltea.records.errors import NoNumbers, UsageError

Place = Callable[[int], str]
"""Function that takes the number of a row, and returns its position in words, for messages."""


class RowCounts:
    """Counts of a table's rows. `chosen`: the columns of the table that are read."""

    def __init__(self, chosen: Chosen) -> None:
        self._chosen = chosen
        self._rows = 0
        self._left_out: dict[str, tuple[int, int]] = {}
        self._some = np.zeros(len(chosen.needed), dtype=bool)

    def add(self, values: Floats, left_out: dict[str, tuple[int, int]]) -> None:
        """Count rows of the table.

        `values`: numbers in these rows. `left_out`: the rows that are no samples. The key is the reason; the
        value is the number of the first row left out for it, and the count of such rows.
        """
        self._rows += len(values)
        self._some |= np.isfinite(values[:, : len(self._some)]).any(axis=0)
        for reason, (first, count) in left_out.items():
            before = self._left_out.get(reason, (first, 0))
            self._left_out[reason] = before[0], before[1] + count

    def none(self, path: Path, place: Place) -> UsageError:
        """Return the error that says why no row is a sample."""
        chosen = self._chosen
        if not self._rows:
            return UsageError(f"{path}: has a header but no rows.")
        reason, (first, _) = next(iter(self._left_out.items()))
        where = place(first)
        if reason == "too_large":
            return UsageError(
                f"{where}: more than {LARGEST_DPS:g} deg/s; is --units {chosen.unit.name} right?"
            )
        if reason == "time":
            return UsageError(f"{where}: column '{chosen.time_name}' has an impossible time.")
        empty = [name for name, some in zip(chosen.read, self._some, strict=False) if not some]
        what = f"column {listed(empty)} is empty" if empty else "no row has numbers in all columns"
        return NoNumbers(f"{where}: {what} ({listed(chosen.read)} are read).", self._rows)

    def notes(self, place: Place) -> list[Note]:
        """Return a warning for each reason for which rows are left out."""
        found = []
        for reason, (first, count) in self._left_out.items():
            where = f"{place(first)}: the first of {count} rows (of {self._rows}) "
            match reason:
                case "not_finite":
                    text = "with an empty field, NaN or the like: their samples count as lost."
                    found.append(Note("missing_numbers", where + text))
                case "too_large":
                    right = f"is --units {self._chosen.unit.name} right?"
                    text = f"with more than {LARGEST_DPS:g} deg/s, which are left out; {right}"
                    found.append(Note("bad_lines", where + text))
                case _:
                    text = f"with an impossible time in '{self._chosen.time_name}'; they are left out."
                    found.append(Note("bad_lines", where + text))
        return found
