"""Makes a table from the named arrays in a file of any format."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from fltea.recording.column_names import is_time, named_axis, states_units, tells_sensors
from fltea.recording.files import AT_ONCE, listed
from fltea.recording.groups import gyroscopes_in
from fltea.recording.npz_arrays import KINDS
from fltea.recording.one_sensor import MOST_SENSORS
from fltea.recording.readers import file_facts
from fltea.recording.reading import OVERRULE
from fltea.recording.sample_times import Floats
from fltea.recording.sheet import Sheet
from fltea.recording.text_times import points_of_time
from fltea.records.errors import UsageError

MOST_WIDE = 64
"""Largest number of columns of one array. An array with more columns than rows is transposed, since MATLAB
programs write one row for each axis.
"""

MOST_REASONS = 5
"""Largest number of reasons that an error message lists."""

_NOT_ONE = "holds {}, not one number in each row"

Column = Callable[[int, int], Any]
"""Function that returns the values of a column. Its arguments are the first row index and the one after the
last.
"""

NONE: Mapping[str, Any] = MappingProxyType({})


class NoNumbers(NamedTuple):
    """Takes the place of an array that cannot be used.

    `reason`: the reason, as the end of a sentence about the array.
    """

    reason: str
    rows: int = 0


def is_of_matlab(kind: str) -> str:
    """Return why an array of the MATLAB class `kind` is not read, and what the user can do."""
    if kind == "cell":
        return "is a cell array; write it as numbers: cell2mat"
    what = f"is a {kind} of MATLAB's, which only MATLAB reads"
    return f"{what}; there, write{kind} makes a .csv of it" if kind in ("table", "timetable") else what


def of_arrays(
    arrays: Mapping[str, Any],
    units: Mapping[str, str] = NONE,
    attributes: Mapping[str, Any] = NONE,
    doubts: Mapping[str, str] = NONE,
) -> Sheet:
    """Return a table of arrays (n,) or (n, columns), which are given by name.

    An array may also be a fact, such as a unit or the sampling rate. `units`: units of arrays, by name.
    `doubts`: reasons why the numbers of arrays may be wrong, by name. `attributes`: further facts, such as
    `gyro@units`, an attribute of the array `gyro`.

    Raises:
        UsageError: no array holds numbers.
    """
    facts = {**_facts(arrays), **attributes, **{f"{name}@units": unit for name, unit in units.items()}}
    found, rates = _Columns(facts, doubts), file_facts.rates_of(facts)
    for name, array in arrays.items():
        if name not in rates:
            found.add(name, array)
    return found.sheet(rates, arrays)


def _facts(arrays: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arrays that are facts on other arrays, by name.

    Such facts are texts, single numbers, and arrays with one value for each column.
    """
    found = {}
    for name, array in arrays.items():
        if isinstance(array, str):
            found[name] = array
            continue
        size = MOST_WIDE + 1 if isinstance(array, NoNumbers) else math.prod(array.shape)
        if size == 1 or (size <= MOST_WIDE and file_facts.is_of_columns(name)):
            found[name] = array[()]
    return found


class _TableColumn(NamedTuple):
    """A column of the table. `array`: name of its array. `rows`: number of rows.

    `is_of_dates`: whether the array holds dates.
    """

    name: str
    unit: str
    array: str
    rows: int
    column: Column
    is_of_dates: bool


class _Columns:
    """Collects columns from arrays for a table. `facts`: what the file states about the arrays."""

    def __init__(self, facts: Mapping[str, Any], doubts: Mapping[str, str]) -> None:
        self._facts, self._doubts, self._said = facts, doubts, file_facts.units_of(facts)
        self._called, self._scales = (
            file_facts.Near(facts, file_facts.COLUMNS),
            file_facts.Near(facts, file_facts.SCALES),
        )
        self._found: list[_TableColumn] = []
        self._reasons: list[str] = []
        self._unread: dict[str, str] = {}
        self._changed: dict[str, str] = {}
        self._words: dict[str, list[str]] = {}

    def add(self, name: str, array: Any) -> None:
        is_of_words = tells_sensors(name) or (states_units(name) and name not in self._facts)
        if is_of_words and (words := _words(array)) is not None:
            array, self._words[name] = words
        is_fact = name in self._facts and name not in self._words and file_facts.texts_of(self._facts[name])
        if isinstance(array, str) or is_fact:
            return
        if name not in self._words and not isinstance(array, NoNumbers) and array.dtype.kind in "SUO":
            points = points_of_time(file_facts.texts_of(array[()])) if len(array.shape) == 1 else None
            array = array if points is None else points
        if reason := _reason(array):
            self._reasons.append(f"{listed([name])} {reason}")
            found = [_Labelled(label, _no_numbers, f"{reason}.") for label in axes_named(name)]
            rows = array.rows if isinstance(array, NoNumbers) else max((1, *array.shape))
        else:
            found, rows = list(_of_array(name, array, self._called.of(name))), max(array.shape, default=0)
        labels, scales = [one.label for one in found], self._scales.of(name)
        for place, (label, column, why) in enumerate(found if rows > 1 or reason else ()):
            unit = file_facts.unit_of(self._said, label, name, place, len(found))
            is_whole = not reason and array.dtype.kind in "iu"
            scale = file_facts.scale_of(scales, name, labels, unit, is_whole=is_whole)
            if scale and is_time(label):
                why = why or f"{scale} may change its numbers, and the file does not say how. {OVERRULE}"
            elif scale:
                self._changed[label] = scale
            why = why or self._doubts.get(name, "") or self._wrong_units(name, len(found))
            self._unread |= {label: why} if why else {}
            is_of_dates = not reason and array.dtype.kind == "M"
            self._found.append(_TableColumn(label, unit, name, rows, column, is_of_dates))

    def _wrong_units(self, name: str, width: int) -> str:
        said = self._said.get(name, [])
        wrong = f"{len(said)} units ({listed(said)}) are stated for {width} columns. {OVERRULE}"
        return wrong if len(said) not in (0, 1, width) else ""

    def sheet(self, rates: Mapping[str, float], arrays: Mapping[str, Any]) -> Sheet:
        """Return all columns as a table."""
        found = self._found
        if not any(one.rows for one in found) or (len(self._unread) == len(found) and self._reasons):
            has = "; ".join(self._reasons[:MOST_REASONS]) or listed(list(arrays)) or "nothing"
            raise UsageError(f"holds no columns of numbers, but {has}.")

        def blocks(places: Sequence[int]) -> Iterator[Floats]:
            rows, columns = min(found[p].rows for p in places), [found[p].column for p in places]
            for begin in range(0, rows, AT_ONCE):
                end = min(begin + AT_ONCE, rows)
                yield np.stack([np.asarray(of(begin, end), np.float64) for of in columns], axis=1)

        return Sheet(
            [one.name for one in found],
            [one.unit for one in found],
            max(one.rows for one in found),
            lengths=[one.rows for one in found],
            arrays=[one.array for one in found],
            stamps=tuple(one.name for one in found if one.is_of_dates),
            rates=dict(rates),
            doubts=self._unread,
            changed=self._changed,
            words=self._words,
            blocks=blocks,
        )


def _words(array: Any) -> tuple[Any, list[str]] | None:
    """Return an array of texts as numbers from 0, and the words that these numbers stand for.

    Return None if the array does not hold texts, or if there are too many different ones to name sensors.
    """
    if isinstance(array, NoNumbers | str) or np.dtype(array.dtype).kind not in "SUO" or len(array.shape) != 1:
        return None
    values = [one.decode(errors="replace") if isinstance(one, bytes) else one for one in array[()]]
    if not all(isinstance(one, str) for one in values):
        return None
    words, places = np.unique(values, return_inverse=True)
    return (places, words.tolist()) if len(words) <= MOST_SENSORS else None


def _reason(array: Any) -> str:
    """Return why an array does not hold numbers; "" if it does."""
    if isinstance(array, NoNumbers):
        return array.reason
    dtype, shape = np.dtype(array.dtype), array.shape
    if dtype.kind == "V" and dtype.names and len(shape) == 1:
        return ""
    if dtype.kind not in KINDS + "M":
        kinds = {
            "S": "text",
            "U": "text",
            "O": "objects or lists of different lengths",
            "c": "complex numbers",
        }
        return _NOT_ONE.format(kinds.get(dtype.kind, f"the type {dtype}"))
    fits = len(shape) < 2 or (len(shape) == 2 and min(shape) <= MOST_WIDE and dtype.kind in KINDS)
    return "" if fits else f"has the shape {tuple(shape)}, not one number in each row"


def axes_named(name: str) -> list[str]:
    """Return the columns of interest that an array should have by its name; empty if there are none.

    These are gyroscope axes, a column that distinguishes sensors, or a column of units.
    """
    if tells_sensors(name) or states_units(name):
        return [name]
    return [label for label in (name, *(named_axis(name, k) for k in range(3))) if gyroscopes_in([label])][:3]


class _Labelled(NamedTuple):
    """A column with its name. `reason`: why the column cannot be used, or ""."""

    label: str
    column: Column
    reason: str = ""


def _of_array(name: str, array: Any, facts: Mapping[str, Any]) -> Iterator[_Labelled]:
    if array.dtype.names is not None:
        for field in array.dtype.names:
            shape, inner = array.dtype[field].shape, f"{name}.{field}" if name else field
            width = math.prod(shape)
            if array.dtype[field].base.kind not in KINDS or width > MOST_WIDE:
                yield _Labelled(inner, _no_numbers, f"{_NOT_ONE.format('other things')}.")
                continue
            for k in range(width):
                yield _Labelled(_label(inner, k, width), partial(_field, array, field, k if shape else None))
    elif array.dtype.kind == "M":
        yield _Labelled(name, partial(_stamps, array))
    elif len(array.shape) == 1:
        yield _Labelled(name, partial(_rows, array))
    elif len(array.shape) == 2:
        on_side, width = array.shape[0] < array.shape[1], min(array.shape)
        named, wrong = file_facts.columns_of(facts, name, width)
        for k in range(width):
            label = _named(name, named[k]) if named else _label(name, k, width)
            column = partial(_on_side if on_side else _upright, array, k)
            yield _Labelled(label, column, wrong and f"{wrong} {OVERRULE}")


def _named(array: str, column: str) -> str:
    """Return the full name of a column of `array`. `column`: name that the file gives the column."""
    axis = "xyz".find(column.strip().lower()) if len(column.strip()) == 1 else -1
    return named_axis(array, axis) if axis >= 0 else f"{array}.{column}"


def _label(name: str, k: int, width: int) -> str:
    """Return the name of column `k` of an array: an axis if the array has three columns, else a number."""
    return name if width == 1 else named_axis(name, k) if width == 3 else f"{name}#{k + 1}"


def _rows(array: Any, begin: int, end: int) -> Any:
    return array[begin:end]


def _no_numbers(begin: int, end: int) -> Any:
    return np.full(end - begin, math.nan)


def _field(array: Any, name: str, k: int | None, begin: int, end: int) -> Any:
    values = array[begin:end][name]
    return values if k is None else values.reshape(len(values), -1)[:, k]


def _upright(array: Any, column: int, begin: int, end: int) -> Any:
    return array[begin:end, column]


def _on_side(array: Any, column: int, begin: int, end: int) -> Any:
    return array[column, begin:end]


def _stamps(array: Any, begin: int, end: int) -> Any:
    return (array[begin:end] - array[:1]) / np.timedelta64(1, "s")
