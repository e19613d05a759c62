"""Reads .npy files. An array's columns are named by their positions from 1, or by the array's fields."""

import math
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.lib import format
from numpy.typing import NDArray

from fltea.recording.files import Note, Stored
from fltea.recording.npz_arrays import KINDS
from fltea.recording.readers.arrays import of_arrays
from fltea.recording.sheet import open_sheet, with_sample
from fltea.records.errors import UsageError
from fltea.records.records import AXES
from fltea.settings.how import AS_IT_SAYS, How
from fltea.settings.limits import DEFAULT_LIMITS, Limits


def open_npy(path: Path, how: How = AS_IT_SAYS, limits: Limits = DEFAULT_LIMITS) -> Stored:
    """Read an array of shape (n,) or (n, columns), or of shape (n,) with named fields.

    Named fields are columns. Columns without names are named by their positions from 1. If these are at most
    three without the times, they are the axes; the user may name others. If there are more, `how.columns`
    must name the axes.

    Raises:
        UsageError: the file holds no such array, the unit is unknown, or `open_sheet` refuses the columns.
    """
    array, missing, said = *_mapped(path), how
    if array.dtype.names is not None:
        sheet = of_arrays({"": array})
    else:
        columns = list(np.atleast_2d(array.T))
        names = [str(place + 1) for place in range(len(columns))]
        rest = [name for name in names if name != how.time_column]
        if how.columns is None and len(rest) <= len(AXES):
            how = msgspec.structs.replace(how, columns=rest)
        sheet = of_arrays(dict(zip(names, columns, strict=True)))
    stored = open_sheet(path, with_sample(sheet), how, limits)
    if missing:
        text = f"{path}: is cut off: {len(array)} of {len(array) + missing} rows are whole, and are read."
        stored = stored._replace(notes=(Note("cut_recording", text), *stored.notes))
    if how is said:
        return stored
    why = "columns without names, at most as many as a gyroscope has axes"
    answers = (
        msgspec.structs.replace(one, evidence="convention", why=why) if one.question == "columns" else one
        for one in stored.reading
    )
    return stored._replace(reading=tuple(answers))


def _mapped(path: Path) -> tuple[NDArray[Any], int]:
    """Return the array in a file, and the number of rows that are missing since the file is cut off."""
    try:
        cut = _cut(path)
        found: NDArray[Any]
        found, missing = cut or (np.load(path, mmap_mode="r", allow_pickle=False), 0)
        if not isinstance(found, np.ndarray):
            found.close()
            raise ValueError("it is an archive of arrays; call it .npz")
    except Exception as error:  # numpy raises various errors for damaged bytes
        reason = str(error) or type(error).__name__
        raise UsageError(f"{path}: cannot be read as .npy ({reason}).") from error
    if found.dtype.names is None and found.dtype.kind not in KINDS:
        raise UsageError(f"{path}: holds the type {found.dtype}, which is not a type of numbers.")
    if found.ndim not in ((1,) if found.dtype.names is not None else (1, 2)) or not found.size:
        raise UsageError(f"{path}: has the shape {found.shape}; (samples,) or (samples, columns) is needed.")
    if found.ndim == 2 and found.shape[1] > found.shape[0] + missing:
        raise UsageError(
            f"{path}: has the shape {found.shape}: rows have to be samples, so save its transpose (array.T)."
        )
    return found, missing


def _cut(path: Path) -> tuple[NDArray[Any], int] | None:
    """Return the whole rows of a file that is cut off, and the number of its other rows; None if it is whole.

    Raises:
        ValueError: it is cut off, and no row is whole.
    """
    with path.open("rb") as file:
        version = format.read_magic(file)
        read = format.read_array_header_1_0 if version == (1, 0) else format.read_array_header_2_0
        shape, is_fortran, dtype = read(file)
        begin, size = file.tell(), file.seek(0, 2)
    row_bytes = dtype.itemsize * math.prod(shape[1:])
    if dtype.hasobject or not row_bytes or not shape or size - begin >= row_bytes * shape[0]:
        return None
    rows = (size - begin) // row_bytes
    if not rows or (is_fortran and len(shape) > 1):
        what = "it stands column by column, so that no row is" if rows else "no row is"
        raise ValueError(f"it is cut off, and {what} whole; copy it again")
    return np.memmap(path, dtype, "r", begin, (rows, *shape[1:])), shape[0] - rows
