"""The rows of one of several sensors in a table, by the column that tells them apart (pure)."""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from fltea.recording.files import listed
from fltea.recording.reading import Missing, not_stated
from fltea.recording.sample_times import Marks
from fltea.records.errors import UsageError

MOST_SENSORS = 64
"""Values beyond which a column counts samples and tells no sensors apart."""


class OneSensor:
    """Tells which rows are of the sensor that is read.

    where: for messages. column: the name of the column. value: the sensor's; None: that of the first row, and any
    other value is asked for, since samples of two sensors are never mixed. known: options of the user.
    """

    def __init__(self, where: str, column: str, value: str | None, known: Sequence[str] = ()) -> None:
        self._where, self._column, self._known = where, column, known
        self.value, self._is_given = value, value is not None
        self._kept = 0
        self.others: Counter[str] = Counter()

    def keep(self, values: Sequence[str]) -> Marks:
        """Mark the rows with these values that are to be read.

        Raises:
            NotStated: there are several sensors, and none was chosen.
        """
        if self.value is None and values:
            self.value = values[0]
        marks = np.fromiter((value == self.value for value in values), np.bool_, len(values))
        self._kept += int(marks.sum())
        if not marks.all() and len(self.others) <= MOST_SENSORS:
            self.others.update(value for value, kept in zip(values, marks, strict=True) if not kept)
            if not self._is_given:
                found = listed(sorted({*self.others, str(self.value)}))
                what = f"which sensor is meant: column {self._column} tells several apart ({found})"
                raise not_stated(self._where, [Missing(what, "--sensor ?")], self._known)
        return marks

    def why_none(self) -> UsageError | None:
        """Return that no row was of the sensor that the user names, if it is so."""
        if self._kept or not self.others:
            return None
        has = listed(sorted(self.others))
        return UsageError(
            f"{self._where}: no row has {self.value} in the column {self._column}; it has {has}."
        )


def as_word(value: float) -> str:
    """Return what a number that tells sensors apart is called; those of devices have many digits."""
    return repr(float(value)).removesuffix(".0")
