"""Recordings in .npy files: one array; its columns have positions for names, unless its type has fields."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from fltea.recording.columns import wanted_of
from fltea.recording.files import AT_ONCE, Stored
from fltea.recording.npz_arrays import KINDS
from fltea.recording.sample_times import Floats
from fltea.recording.sheet import SAMPLE_ROWS, Sheet, open_sheet
from fltea.recording.units import UNITS_HELP
from fltea.records.errors import UsageError
from fltea.records.records import AXES
from fltea.settings.how import AS_IT_SAYS, How
from fltea.settings.limits import DEFAULT_LIMITS, Limits


def open_npy(path: Path, how: How = AS_IT_SAYS, limits: Limits = DEFAULT_LIMITS) -> Stored:
    """Read an array (n,), (n, columns) or of a type with fields.

    Up to three columns beside the times are the axes; of more `how.columns` has to say which, by their
    positions from 1.

    Raises:
        UsageError: not such a file, numbers without a unit, or what `table.gather` refuses.
    """
    array = _mapped(path)
    if array.dtype.names is not None:
        names = list(array.dtype.names)
        columns = [array[name] for name in names]
    else:
        columns = list(np.atleast_2d(array.T))
        names = [str(place + 1) for place in range(len(columns))]
        if how.units is None:
            raise UsageError(
                f"{path}: an array has no unit, so give it: --units dps; known are {UNITS_HELP}."
            )
        rest = [name for name in names if name != how.time_column]
        if wanted_of(how).columns is None and len(rest) <= len(AXES):
            how = msgspec.structs.replace(how, columns=rest)

    def blocks(places: Sequence[int]) -> Iterator[Floats]:
        for place in places:
            if columns[place].ndim != 1 or columns[place].dtype.kind not in KINDS:
                raise UsageError(f"{path}: column {names[place]} does not hold numbers, one in each row.")
        for begin in range(0, len(array), AT_ONCE):
            rows = slice(begin, begin + AT_ONCE)
            yield np.stack([np.asarray(columns[place][rows], np.float64) for place in places], axis=1)

    return open_sheet(
        path, Sheet(names, [""] * len(names), len(array), blocks, sample=_sample(columns)), how, limits
    )


def _sample(columns: list[NDArray[Any]]) -> Floats:
    """The first rows, NaN in columns without numbers."""
    are_numbers = [column.ndim == 1 and column.dtype.kind in KINDS for column in columns]
    rows = [
        np.asarray(column[:SAMPLE_ROWS], np.float64) if fits else np.full(len(column[:SAMPLE_ROWS]), np.nan)
        for column, fits in zip(columns, are_numbers, strict=True)
    ]
    return np.stack(rows, axis=1)


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
