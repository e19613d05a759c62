"""Arrays by their names, of any kind of file, as a table."""

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from fltea.recording.column_names import named_axis, tells_sensors
from fltea.recording.files import AT_ONCE, listed
from fltea.recording.groups import gyroscopes_in
from fltea.recording.npz_arrays import KINDS
from fltea.recording.one_sensor import MOST_SENSORS
from fltea.recording.sample_times import SECONDS, Floats
from fltea.recording.sheet import Sheet
from fltea.records.errors import UsageError

MOST_WIDE = 64
"""Columns of one array; what is wider than long lies on its side, as MATLAB writes it."""

_RATE = re.compile(
    r"(?:imu_|gyro_)?(?:fs|rate|odr|sfreq|data_rate|sampl(?:e|ing)_?(?:rate|freq|frequency))(?:_?(k?hz))?"
)
_PERIOD = re.compile(r"(?:dt|(?:sampl(?:e|ing)_?)?(?:period|interval))_(s|ms|us|ns)|wf_increment")
MOST_REASONS = 5
"""In a message."""

_NOT_ONE = "holds {}, not one number in each row"

_SECONDS: Mapping[str, float] = {str(unit): seconds for unit, seconds in SECONDS.items()}
PER_S = {"": 1.0, "hz": 1.0, "khz": 1e3, "1/s": 1.0, "s-1": 1.0, "s^-1": 1.0, "sps": 1.0}

Column = Callable[[int, int], Any]
"""The values from one row to another."""

NONE: Mapping[str, Any] = MappingProxyType({})


class NoNumbers(NamedTuple):
    """In place of an array that cannot be used. reason: a sentence about it, without its subject."""

    reason: str
    rows: int = 0


def is_of_matlab(kind: str) -> str:
    """Say of an array of this class of MATLAB's that it is not read, and what to do."""
    if kind == "cell":
        return "is a cell array; write it as numbers: cell2mat"
    what = f"is a {kind} of MATLAB's, which only MATLAB reads"
    return f"{what}; there, write{kind} makes a .csv of it" if kind in ("table", "timetable") else what


def rate_of(name: str, value: Any, unit: str = "") -> float | None:
    """Return the samples per second that a number with this name states; None if it states none."""
    leaf = re.sub(r"[\s\-]+", "_", name.rpartition(".")[2].rpartition("@")[2].strip().lower())
    found, period = _RATE.fullmatch(leaf), _PERIOD.fullmatch(leaf)
    if found is None and period is None:
        return None
    try:
        number = float(np.asarray(value).reshape(()))
    except (TypeError, ValueError):
        return None
    if period is not None:
        number = 1 / (number * _SECONDS[period[1] or "s"]) if number else 0.0
    scale = PER_S.get((found[1] if found and found[1] else unit).strip().lower())
    return None if scale is None or not 0 < number * scale < math.inf else number * scale


def of_arrays(
    arrays: Mapping[str, Any],
    units: Mapping[str, str] = NONE,
    rates: Mapping[str, float] = NONE,
    doubts: Mapping[str, str] = NONE,
) -> Sheet:
    """Make a table of arrays by their names, (n,) or (n, columns); texts among them may tell units.

    units, doubts: of arrays, where there are some. rates: those that are no arrays of their own.

    Raises:
        UsageError: none of them holds numbers.
    """
    names: list[str] = []
    of: list[str] = []
    lengths: list[int] = []
    columns: list[Column] = []
    stamps: list[str] = []
    rates, reasons = dict(rates), []
    doubts_of: dict[str, str] = {}
    words: dict[str, list[str]] = {}
    texts = {name: text for name, array in arrays.items() if (text := _text(array)) is not None}
    units = {**_units_of(texts), **{name: unit for name, unit in units.items() if unit}}
    for name, array in arrays.items():
        if name in texts:
            continue
        if tells_sensors(name) and (found_words := _words(array)) is not None:
            array, words[name] = found_words
        reason = _reason(array)
        rate_hz = (
            None if reason or math.prod(array.shape) != 1 else rate_of(name, array[()], units.get(name, ""))
        )
        if rate_hz is not None:
            rates[name] = rate_hz
            continue
        if reason:
            reasons.append(f"{listed([name])} {reason}")
            found = [_Labelled(label, _no_numbers, reason) for label in _axes_named(name)]
            rows = array.rows if isinstance(array, NoNumbers) else max((1, *array.shape))
        else:
            found, rows = list(_of_array(name, array)), max(array.shape, default=0)
        for label, column, why in found if rows > 1 or reason else ():
            why = f"{why}." if why else doubts.get(name, "")
            doubts_of |= {label: why} if why else {}
            stamps += [label] if not reason and array.dtype.kind == "M" else []
            names.append(label)
            of.append(name)
            lengths.append(rows)
            columns.append(column)
    if not set(lengths) - {0} or (len(doubts_of) == len(names) and reasons):
        has = "; ".join(reasons[:MOST_REASONS]) or listed(list(arrays)) or "nothing"
        raise UsageError(f"holds no columns of numbers, but {has}.")

    def blocks(places: Sequence[int]) -> Iterator[Floats]:
        rows = min(lengths[place] for place in places)
        for begin in range(0, rows, AT_ONCE):
            end = min(begin + AT_ONCE, rows)
            yield np.stack([np.asarray(columns[p](begin, end), np.float64) for p in places], axis=1)

    beside = [_unit_of(units, name, array) for name, array in zip(names, of, strict=True)]
    return Sheet(
        names,
        beside,
        max(lengths),
        lengths=lengths,
        arrays=of,
        stamps=tuple(stamps),
        rates=rates,
        doubts=doubts_of,
        words=words,
        blocks=blocks,
    )


def _text(array: Any) -> str | None:
    if isinstance(array, str):
        return array
    is_text = (
        not isinstance(array, NoNumbers) and np.dtype(array.dtype).kind in "US" and array.shape in ((), (1,))
    )
    found = np.asarray(array[()]).reshape(-1)[0] if is_text else None
    return (
        found.decode(errors="replace") if isinstance(found, bytes) else None if found is None else str(found)
    )


def _words(array: Any) -> tuple[Any, list[str]] | None:
    """Texts as numbers from 0, and what these mean; None if an array holds no texts, or too many."""
    if isinstance(array, NoNumbers) or np.dtype(array.dtype).kind not in "SUO" or len(array.shape) != 1:
        return None
    values = [one.decode(errors="replace") if isinstance(one, bytes) else one for one in array[()]]
    if not all(isinstance(one, str) for one in values):
        return None
    words, places = np.unique(values, return_inverse=True)
    return (places, words.tolist()) if len(words) <= MOST_SENSORS else None


def _units_of(texts: Mapping[str, str]) -> dict[str, str]:
    """Units by the array or group that texts beside them name: gyro_units, units.gyro, units of a group."""
    found = {}
    for name, text in texts.items():
        group, _, leaf = name.rpartition(".")
        outer, _, inner = group.rpartition(".")
        if (end := re.fullmatch(r"(.+)_units?", leaf, re.I)) is not None:
            found[f"{group}.{end[1]}" if group else end[1]] = text
        elif re.fullmatch(r"units?", leaf, re.I):
            found[f"{group}."] = text
        elif re.fullmatch(r"units?", inner, re.I):
            found[f"{outer}.{leaf}" if outer else leaf] = text
    return found


def _unit_of(units: Mapping[str, str], name: str, array: str) -> str:
    """The unit of a column: its own, its array's, or that of the group it is in."""
    group = f"{array.rpartition('.')[0]}."
    unit = next((units[known] for known in (name, array, f"{array}.", group) if known in units), "")
    return unit.partition(" since ")[0]  # as netCDF says of times


def _reason(array: Any) -> str:
    """Why an array is none of numbers, "" if it is."""
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


def _axes_named(name: str) -> list[str]:
    """The axes of a gyroscope that an array has by its name, or what tells sensors apart."""
    if tells_sensors(name):
        return [name]
    return [label for label in (name, *(named_axis(name, k) for k in range(3))) if gyroscopes_in([label])][:3]


class _Labelled(NamedTuple):
    """A column with its name. reason: why it cannot be used."""

    label: str
    column: Column
    reason: str = ""


def _of_array(name: str, array: Any) -> Iterator[_Labelled]:
    if array.dtype.names is not None:
        for field in array.dtype.names:
            shape, inner = array.dtype[field].shape, f"{name}.{field}" if name else field
            width = math.prod(shape)
            if array.dtype[field].base.kind not in KINDS or width > MOST_WIDE:
                yield _Labelled(inner, _no_numbers, _NOT_ONE.format("other things"))
                continue
            for k in range(width):
                yield _Labelled(_label(inner, k, width), partial(_field, array, field, k if shape else None))
    elif array.dtype.kind == "M":
        yield _Labelled(name, partial(_stamps, array))
    elif len(array.shape) == 1:
        yield _Labelled(name, partial(_rows, array))
    elif len(array.shape) == 2:
        on_side, width = array.shape[0] < array.shape[1], min(array.shape)
        for k in range(width):
            yield _Labelled(_label(name, k, width), partial(_on_side if on_side else _upright, array, k))


def _label(name: str, k: int, width: int) -> str:
    """The name of a column of an array: three are axes; which of others is which, nobody knows."""
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
