"""Recordings in .npy files: one array, whose columns have no names unless its type has fields."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from fltea.recording.columns import Chosen, choose, wanted_of
from fltea.recording.files import AT_ONCE, UNITS_HELP, Stored
from fltea.recording.npz_arrays import KINDS, NUMBER_BYTES
from fltea.recording.table import Rows, gather, row_place
from fltea.records.errors import UsageError
from fltea.records.records import AXES
from fltea.settings.how import AS_IT_SAYS, How
from fltea.settings.limits import DEFAULT_LIMITS, Limits

Columns = list[NDArray[Any]]


def open_npy(path: Path, how: How = AS_IT_SAYS, limits: Limits = DEFAULT_LIMITS) -> Stored:
    """Read an array (n,), (n, columns) or of a type with fields.

    Up to three columns beside the times are the axes; of more `how.columns` has to say which, by their
    positions from 1.

    Raises:
        UsageError: not such a file, numbers without a unit, or what `table.gather` refuses.
    """
    array = _mapped(path)
    names = list(array.dtype.names) if array.dtype.names is not None else None
    columns = [array[name] for name in names] if names is not None else list(np.atleast_2d(array.T))
    width = len(columns)
    size_bytes = len(array) * NUMBER_BYTES
    if size_bytes > limits.whole_bytes:
        raise limits.whole_too_large(f"{path}: declares the shape {array.shape}", size_bytes)
    if names is None:
        if how.units is None:
            raise UsageError(f"{path}: an array says no unit; say it: --units {UNITS_HELP}.")
        how = _all_axes(how, width)
    chosen = choose(str(path), names, None, width, how)
    for name, column in zip(chosen.read, (columns[place] for place in chosen.places), strict=True):
        if column.ndim != 1 or column.dtype.kind not in KINDS:
            raise UsageError(f"{path}: column {name} does not hold numbers, one in each row.")
    return gather(path, chosen, _blocks(columns, chosen), how, limits, partial(row_place, path))


def _mapped(path: Path) -> NDArray[Any]:
    try:
        found: NDArray[Any] = np.load(path, mmap_mode="r", allow_pickle=False)
        if not isinstance(found, np.ndarray):
            found.close()
            raise ValueError("it is an archive of arrays; call it .npz")
    except Exception as error:  # whatever numpy raises on damaged bytes
        reason = str(error) or type(error).__name__
        raise UsageError(f"{path}: cannot be read as .npy ({reason}).") from error
    if found.dtype.names is None and found.dtype.kind not in KINDS:
        raise UsageError(f"{path}: holds the type {found.dtype}, which is none of numbers.")
    if found.ndim not in ((1,) if found.dtype.names is not None else (1, 2)) or not found.size:
        raise UsageError(f"{path}: has the shape {found.shape}; (samples,) or (samples, columns) is needed.")
    if found.ndim == 2 and found.shape[1] > found.shape[0]:
        raise UsageError(
            f"{path}: has the shape {found.shape}: rows have to be samples, so save its transpose (array.T)."
        )
    return found


def _all_axes(how: How, width: int) -> How:
    """Without names all columns beside the times are the axes, if they are no more than three."""
    if how.columns is not None or wanted_of(how).columns is not None:
        return how
    rest = [str(place + 1) for place in range(width) if str(place + 1) != how.time_column]
    return msgspec.structs.replace(how, columns=rest) if len(rest) <= len(AXES) else how


def _blocks(columns: Columns, chosen: Chosen) -> Iterator[Rows]:
    n = len(columns[0])
    for begin in range(0, n, AT_ONCE):
        rows = slice(begin, min(begin + AT_ONCE, n))
        values = [np.asarray(columns[place][rows], dtype=np.float64) for place in chosen.places]
        row = np.arange(rows.start, rows.stop)
        yield Rows(row, chosen.scale(np.stack(values, axis=1)), row)
