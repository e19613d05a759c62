"""The rows of one of several sensors in a table, and whether a column tells them apart (pure)."""

import math
from collections import Counter
from collections.abc import Collection, Sequence
from itertools import pairwise

import numpy as np

from fltea.recording.files import listed
from fltea.recording.reading import Missing, not_stated
from fltea.recording.sample_times import Floats, Ints, Marks
from fltea.records.errors import UsageError

MOST_SENSORS = 64
"""Values beyond which a column counts samples and tells no sensors apart."""

MOST_IN_TURN, FEWEST_ROWS = 16, 25
"""Sensors that are known by how they take turns alone, and rows that show it."""

LONGEST_TURN, REGULAR, SELDOM = 32, 0.9, 0.7
"""Rows until all sensors had their turns; the share of rows in which one has the same value as so many rows
before; and as the row before, beyond which a column changes too seldom, as a status does."""

CHANCE_SIGMA, APART = 5.0, 5.0
"""How much more regular turns are than chance, in its deviations.

And sensors of two kinds are apart, in theirs.
"""

FEWEST_SHARE, FEWEST_COUNTED = 0.6, 5
"""Of the rows that each sensor has, to an equal share of them; and numbers that a counter goes through."""


class OneSensor:
    """Tells which rows are of the sensor that is read.

    where: for messages. column: the name of the column. value: the sensor's; None: that of the first row, and
    any other value is asked for, since samples of two sensors are never mixed. known: options of the user.
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
                which = which_of(self._column, {*self.others, str(self.value)})
                raise not_stated(self._where, [which], self._known)
        return marks

    def why_none(self) -> UsageError | None:
        """Return that no row was of the sensor that the user names, if it is so."""
        if self._kept or not self.others:
            return None
        has = listed(sorted(self.others))
        return UsageError(
            f"{self._where}: no row has {self.value} in the column {self._column}; it has {has}."
        )


def which_of(column: str, values: Collection[str]) -> Missing:
    """Return the question which sensor is meant of those that a column tells apart."""
    what = f"which sensor is meant: column {column} tells several apart ({listed(sorted(values))})"
    return Missing(what, "--sensor ?")


def as_word(value: float) -> str:
    """Return what a number that tells sensors apart is called; those of devices have many digits."""
    return repr(as_float(value)).removesuffix(".0")


def as_float(value: float) -> float:
    """Return a number as JSON and protobuf give it; a whole one of hundreds of digits is infinite."""
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf


def tells_apart(cells: Sequence[str], times: Floats | None, values: Floats) -> bool:
    """Whether the values of a column, which is neither a time nor an axis, take turns as sensors do.

    A status changes seldom; a digit that is noise changes by chance. Sensors take turns: each value comes
    again after as many rows; or none comes twice at one time; or the times begin again wherever it changes;
    or the figures are of two kinds. cells: of the first rows. times: of the same, if they are known. values:
    of the same rows, (n, columns), the figures that may be of two kinds.
    """
    n, counts = len(cells), Counter(cells)
    if n < FEWEST_ROWS or not 2 <= len(counts) <= MOST_IN_TURN:
        return False
    codes = np.unique(np.array(cells), return_inverse=True)[1].reshape(-1)
    if min(counts.values()) * len(counts) < FEWEST_SHARE * n or _is_counter(cells):
        return _are_of_two_kinds(codes, values)
    return (
        _is_regular(codes, counts)
        or (times is not None and (_is_once_a_time(codes, times) or _begins_again(codes, times)))
        or _are_of_two_kinds(codes, values)
    )


def _is_counter(cells: Sequence[str]) -> bool:
    """Whether whole numbers go up by one each row, and from the last of five or more to the first."""
    if not all(cell.isdecimal() for cell in cells):
        return False
    numbers = [int(cell) for cell in cells]
    around = max(numbers) - min(numbers) + 1
    steps = sum((b - a) % around == 1 for a, b in pairwise(numbers))
    return around >= FEWEST_COUNTED and steps >= REGULAR * (len(numbers) - 1)


def _is_regular(codes: Ints, counts: Counter[str]) -> bool:
    n = len(codes)
    if (codes[1:] == codes[:-1]).mean() > SELDOM:
        return False
    chance = sum((count / n) ** 2 for count in counts.values())
    for lag in range(2, min(LONGEST_TURN, n // 4) + 1):
        deviation = math.sqrt(chance * (1 - chance) / (n - lag))
        same = float((codes[lag:] == codes[:-lag]).mean())
        if same >= max(REGULAR, min(chance + CHANCE_SIGMA * deviation, 1.0)):
            return True
    return False


def _is_once_a_time(codes: Ints, times: Floats) -> bool:
    """Whether rows have the same time, and never the same value beside it."""
    known = np.isfinite(times)
    alone = len(np.unique(times[known]))
    together = len({*zip(times[known].tolist(), codes[known].tolist(), strict=True)})
    return together == known.sum() and alone < SELDOM * together


def _begins_again(codes: Ints, times: Floats) -> bool:
    """Whether the times step back where the value changes, and nowhere else."""
    back = np.diff(times) < 0
    return bool(back.any() and (back == (np.diff(codes) != 0)).all())


def _are_of_two_kinds(codes: Ints, values: Floats) -> bool:
    """Whether the rows with one value are far from those with any other, and the values change often."""
    if (codes[1:] == codes[:-1]).mean() > REGULAR or len(values) != len(codes):
        return False
    groups = [values[codes == code] for code in range(codes.max() + 1)]
    groups = [group[:, np.isfinite(values).all(axis=0)] for group in groups]
    if min(map(len, groups)) < 3 or not groups[0].shape[1]:
        return False
    means, spreads = (np.array([of(group, axis=0) for group in groups]) for of in (np.mean, np.std))
    apart = np.abs(means[:, None] - means[None]) - APART * (spreads[:, None] + spreads[None])
    return bool((apart > 0).any(axis=2)[~np.eye(len(groups), dtype=bool)].all())
