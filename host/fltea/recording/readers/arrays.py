"""Arrays by their names, of any kind of file, as a table."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np

from fltea.recording.column_names import axis_of, named_axis
from fltea.recording.files import AT_ONCE, listed
from fltea.recording.npz_arrays import KINDS
from fltea.recording.sample_times import Floats
from fltea.recording.sheet import Sheet
from fltea.records.errors import UsageError

MOST_WIDE = 64
"""Columns of one array; what is wider than long lies on its side, as MATLAB writes it."""

RATES = ("fs", "fs_hz", "rate", "rate_hz", "sample_rate", "sampling_rate", "sample_rate_hz", "imu_rate")
"""Names of a number that is a rate."""

Column = Callable[[int, int], Any]
"""The values from one row to another."""


def of_arrays(arrays: Mapping[str, Any], units: Mapping[str, str] = MappingProxyType({})) -> Sheet:
    """Arrays by their names, (n,) or (n, columns): of those alike in length, the ones that have axes.

    units: of arrays, where they are known.

    Raises:
        ValueError: none of them holds numbers.
    """
    columns: dict[int, dict[str, Column]] = {}
    stated: dict[str, str] = {}
    stamps = []
    rate_hz = None
    for name, array in arrays.items():
        kind, shape = np.dtype(array.dtype).kind, array.shape
        if kind in KINDS and math.prod(shape) == 1 and name.rpartition(".")[2].lower() in RATES:
            rate_hz = float(np.asarray(array[()]).reshape(()))
        if kind == "V" and len(shape) == 1:
            for field in array.dtype.names:
                if array.dtype[field].kind in KINDS and not array.dtype[field].shape:
                    columns.setdefault(shape[0], {})[field] = partial(_field, array, field)
        elif kind == "M" and len(shape) == 1:
            stamps.append(name)
            columns.setdefault(shape[0], {})[name] = partial(_stamps, array)
        elif kind in KINDS and (len(shape) == 1 or (len(shape) == 2 and min(shape) <= MOST_WIDE)):
            for label, column in _of_array(name, array):
                columns.setdefault(max(shape), {})[label] = column
                stated[label] = units.get(name, "")
    columns.pop(1, None)
    if not columns:
        raise UsageError(f"holds no columns of numbers, but {listed(list(arrays)) or 'nothing'}.")
    rows = max(columns, key=lambda n: (sum(axis_of(name) is not None for name in columns[n]), n))
    found = columns[rows]
    wanted = list(found.values())

    def blocks(places: Sequence[int]) -> Iterator[Floats]:
        for begin in range(0, rows, AT_ONCE):
            end = min(begin + AT_ONCE, rows)
            yield np.stack([np.asarray(wanted[p](begin, end), np.float64) for p in places], axis=1)

    beside = [stated.get(name, "") for name in found]
    there = tuple(stamp for stamp in stamps if stamp in found)
    return Sheet(list(found), beside, rows, blocks, there, rate_hz)


def _of_array(name: str, array: Any) -> Iterator[tuple[str, Column]]:
    if len(array.shape) == 1:
        yield name, partial(_rows, array)
        return
    on_side = array.shape[0] < array.shape[1]
    width = min(array.shape)
    for k in range(width):
        label = name if width == 1 else named_axis(name, k) if width == 3 else f"{name}[{k}]"
        yield label, partial(_on_side if on_side else _upright, array, k)


def _rows(array: Any, begin: int, end: int) -> Any:
    return array[begin:end]


def _field(array: Any, name: str, begin: int, end: int) -> Any:
    return array[begin:end][name]


def _upright(array: Any, column: int, begin: int, end: int) -> Any:
    return array[begin:end, column]


def _on_side(array: Any, column: int, begin: int, end: int) -> Any:
    return array[column, begin:end]


def _stamps(array: Any, begin: int, end: int) -> Any:
    return (array[begin:end] - array[:1]) / np.timedelta64(1, "s")
