"""Named columns of numbers out of any kind of file, and the recording that they are.

A new format is one module in `readers` whose `read` gives a `Sheet`, and a row in `formats`.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np

from fltea.recording.column_names import is_time
from fltea.recording.columns import Chosen, choose
from fltea.recording.files import Stored
from fltea.recording.npz_arrays import NUMBER_BYTES
from fltea.recording.sample_times import Floats
from fltea.recording.suggest import options, with_hint
from fltea.recording.table import Rows, gather, row_place
from fltea.records.errors import Implausible, UsageError
from fltea.settings.how import How
from fltea.settings.limits import Limits

NO_ROWS: Floats = np.empty((0, 0))

SAMPLE_ROWS = 60


class Sheet(NamedTuple):
    """What a file holds. names: of its columns. units: of each, "" where the file states none.

    blocks: gives the rows of the columns at some places, (n, places) at a time. stamps: columns that hold
    points of time, given as seconds since the first one. rate_hz: None unless the file states it. sample: the
    first rows of all columns, NaN where there are no numbers.
    """

    names: list[str]
    units: list[str]
    rows: int
    blocks: Callable[[Sequence[int]], Iterator[Floats]]
    stamps: tuple[str, ...] = ()
    rate_hz: float | None = None
    sample: Floats = NO_ROWS


def open_sheet(path: Path, sheet: Sheet, how: How, limits: Limits) -> Stored:
    """Read the columns of a gyroscope.

    Raises:
        UsageError: the columns are not clear, or what `table.gather` refuses.
    """
    names = sheet.names
    has_times = how.time_column is not None or any(map(is_time, names))
    if not has_times and len(sheet.stamps) == 1:
        how = msgspec.structs.replace(how, time_column=sheet.stamps[0])
    elif not has_times and how.rate_hz is None:
        how = msgspec.structs.replace(how, rate_hz=sheet.rate_hz)
    units = [("s" if name in sheet.stamps else unit) for name, unit in zip(names, sheet.units, strict=True)]
    try:
        chosen = choose(str(path), names, units, len(names), how)
    except UsageError as error:
        raise with_hint(error, options(names, sheet.sample, how)) from error
    size_bytes = sheet.rows * len(chosen.places) * NUMBER_BYTES
    if size_bytes > limits.whole_bytes:
        raise limits.whole_too_large(f"{path}: declares {sheet.rows} rows", size_bytes)
    try:
        return gather(path, chosen, _rows(sheet, chosen), how, limits, partial(row_place, path))
    except Implausible as error:
        raise with_hint(error, options(names, sheet.sample, how)) from error


def _rows(sheet: Sheet, chosen: Chosen) -> Iterator[Rows]:
    row = 0
    for values in sheet.blocks(chosen.places):
        numbers = np.arange(row, row + len(values))
        yield Rows(numbers, chosen.scale(values), numbers)
        row += len(values)
