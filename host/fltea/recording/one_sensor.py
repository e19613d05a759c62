"""Selects the rows of one of several sensors, and recognises columns that distinguish sensors."""

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
"""Largest number of different values in a column that distinguishes sensors. A column with more values is a
counter.
"""

MOST_IN_TURN, FEWEST_ROWS = 16, 25
"""A column whose name does not say so may still distinguish sensors, if its values alternate. It must have at
most MOST_IN_TURN different values, in at least FEWEST_ROWS rows.
"""

LONGEST_TURN, REGULAR, SELDOM = 32, 0.9, 0.7
"""Thresholds for alternating sensors: the longest cycle [rows], and two fractions of the rows.

REGULAR: least fraction of rows that must have the same value as the row one cycle before. SELDOM: largest
fraction of rows that may have the same value as the previous row; a column that changes less often holds a
status.
"""

CHANCE_SIGMA, APART = 5.0, 5.0
"""Thresholds in standard deviations. CHANCE_SIGMA: in a cycle, more rows have the same value as the row one
cycle before than by chance. Their fraction must exceed that of chance by this many standard deviations.
APART: the mean numbers of two sensors must differ by this many times the sum of their standard deviations.
"""

FEWEST_SHARE, FEWEST_COUNTED = 0.6, 5
"""FEWEST_SHARE: if k sensors alternate, each has about 1/k of the rows. Each must have at least this
fraction of 1/k. FEWEST_COUNTED: whole numbers that rise in a cycle are a counter if the cycle has at
least this many.
"""


class OneSensor:
    """Selects the rows of the sensor to read.

    `where`: file, for messages. `column`: name of the column that distinguishes sensors.
    `value`: value of the sensor to read. None: the value in the first row; a later row with another value
    then raises an error, since samples of two sensors are never mixed.
    `known`: options that the user gave, for messages.
    """

    def __init__(self, where: str, column: str, value: str | None, known: Sequence[str] = ()) -> None:
        self._where, self._column, self._known = where, column, known
        self.value, self._is_given = value, value is not None
        self._kept = 0
        self.others: Counter[str] = Counter()

    def keep(self, values: Sequence[str]) -> Marks:
        """Mark the rows of the sensor to read. `values`: text of each row in the column of sensors.

        Raises:
            NotStated: there are several sensors, and the user named none.
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
        """Return an error if rows were read but none of them is of the sensor to read; else None."""
        if self._kept or not self.others:
            return None
        has = listed(sorted(self.others))
        return UsageError(
            f"{self._where}: no row has {self.value} in the column {self._column}; it has {has}."
        )


def which_of(column: str, values: Collection[str]) -> Missing:
    """Return the question that asks the user which of the sensors in a column to read."""
    what = f"which sensor is meant: column {column} tells several apart ({listed(sorted(values))})"
    return Missing(what, "--sensor ?")


def as_word(value: float) -> str:
    """Return a number that distinguishes sensors as text, with all its digits but without a final `.0`."""
    return repr(as_float(value)).removesuffix(".0")


def as_float(value: float) -> float:
    """Return a number of JSON or protobuf as a float; a number that is too large becomes infinite."""
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf


def tells_apart(cells: Sequence[str], times: Floats | None, values: Floats) -> bool:
    """Return whether the values of a column, which is neither a time nor an axis, alternate between sensors.

    A status changes seldom, and a noisy digit changes by chance. Sensors show one of these patterns: their
    values repeat in a fixed cycle; several rows have the same time, and no value occurs twice at that time;
    the times restart wherever the value changes; or the numbers in the rows of one value differ clearly from
    those of another.

    `cells`: texts in the first rows of the column. `times`: times of these rows, if known. `values`: numbers
    (n, columns) in these rows.
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
    """Return whether the texts are whole numbers that rise by one from row to row, in a cycle.

    After its highest number, the cycle begins again. A cycle has at least five numbers.
    """
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
    """Return whether many rows have equal times, and the rows of one time all have different values.

    Several sensors that are sampled together give such rows.

    `codes`: number of each row's value in the column, equal for equal values.
    """
    known = np.isfinite(times)
    alone = len(np.unique(times[known]))
    together = len({*zip(times[known].tolist(), codes[known].tolist(), strict=True)})
    return together == known.sum() and alone < SELDOM * together


def _begins_again(codes: Ints, times: Floats) -> bool:
    """Return whether the times step back exactly where the value of a column changes.

    `codes`: number of each row's value in the column, equal for equal values.
    """
    back = np.diff(times) < 0
    return bool(back.any() and (back == (np.diff(codes) != 0)).all())


def _are_of_two_kinds(codes: Ints, values: Floats) -> bool:
    """Return whether the numbers in rows of one value differ clearly from those in rows of any other value.

    The value also has to change often: the value of a status changes seldom.

    `codes`: number of each row's value in the column, equal for equal values.
    """
    if (codes[1:] == codes[:-1]).mean() > REGULAR or len(values) != len(codes):
        return False
    groups = [values[codes == code] for code in range(codes.max() + 1)]
    groups = [group[:, np.isfinite(values).all(axis=0)] for group in groups]
    if min(map(len, groups)) < 3 or not groups[0].shape[1]:
        return False
    means, spreads = (np.array([of(group, axis=0) for group in groups]) for of in (np.mean, np.std))
    apart = np.abs(means[:, None] - means[None]) - APART * (spreads[:, None] + spreads[None])
    return bool((apart > 0).any(axis=2)[~np.eye(len(groups), dtype=bool)].all())
