"""Recordings in CSV files."""

import csv
import io
import math
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from fltea.recording.files import (
    AT_ONCE,
    EVEN_SHARE,
    EVENNESS,
    LARGEST_DPS,
    LONGEST_S,
    SHORTEST_STEP_S,
    Recording,
    Stored,
    check_span,
    listed,
    parse_units,
    too_large,
)
from fltea.recording.lines import lines, shown
from fltea.recording.npz_arrays import NUMBER_BYTES
from fltea.recording.spool import Spool
from fltea.records.errors import UsageError
from fltea.records.records import AXES
from fltea.settings.limits import DEFAULT_LIMITS, Limits

TIME_COLUMN = "time_s"


def read_csv(
    path: Path,
    columns: list[str] | None = None,
    units: str = "dps",
    rate_hz: float | None = None,
    *,
    limits: Limits = DEFAULT_LIMITS,
) -> Recording:
    """`open_csv`, all of it in memory."""
    return open_csv(path, columns, units, rate_hz, limits=limits).whole()


def open_csv(
    path: Path,
    columns: list[str] | None = None,
    units: str = "dps",
    rate_hz: float | None = None,
    *,
    limits: Limits = DEFAULT_LIMITS,
    file: BinaryIO | None = None,
) -> Stored:
    """Read named columns of a CSV file with a header, once; its numbers wait in a temporary file.

    columns: one to three names, for the axes x, y, z; by default those called gyro_x_dps, ….
    rate_hz: samples per second; may be left out where the file has a column `time_s`. file: what is behind
    the path, if it has been opened already.

    Raises:
        UsageError: names file, line and reason.
    """
    factor, lsb = parse_units(units)
    spool = Spool()
    timed = rate_hz is None
    try:
        with io.TextIOWrapper(file or path.open("rb"), encoding="utf-8-sig", newline="") as text:
            rows = csv.reader(lines(path, text))
            header = [name.strip() for name in next(rows, [])]
            names = columns or [f"{axis}_dps" for axis in AXES if f"{axis}_dps" in header]
            _check_columns(path, header, names)
            has_time = TIME_COLUMN in header
            places = [header.index(n) for n in names] + ([header.index(TIME_COLUMN)] if has_time else [])
            most = limits.whole_bytes // NUMBER_BYTES
            for numbers, values in _csv_blocks(path, rows, places, header):
                fits = most // len(places) - spool.length("gyro")
                if len(values) > fits:
                    size = (most // len(places) + 1) * len(places) * NUMBER_BYTES
                    raise limits.whole_too_large(f"{path}:{numbers[fits]}", size)
                with np.errstate(over="ignore"):
                    gyro = values[:, : len(names)] * factor
                beyond = too_large(gyro, lsb)
                if beyond.any():
                    line = numbers[int(np.argmax(beyond))]
                    raise UsageError(
                        f"{path}:{line}: more than {LARGEST_DPS:g} deg/s; is --units {units} right?"
                    )
                spool.append("gyro", gyro)
                if has_time and timed:
                    spool.append("time_s", values[:, -1])
                    spool.append("line", np.array(numbers))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise UsageError(f"{path}: cannot be read as CSV ({error}).") from error
    n = spool.length("gyro")
    if not n:
        raise UsageError(f"{path}: has a header but no rows.")
    if timed and not has_time:
        raise UsageError(f"{path}: has no column '{TIME_COLUMN}', so give its rate: --rate 100.")
    if rate_hz is None:
        rate_hz = _rate_of(path, spool)
        spool.drop("line")
    else:  # given: it wins over a column of times
        check_span(path, rate_hz, n, (n - 1) / rate_hz)
    return Stored(n, rate_hz, lsb, None, partial(_spooled, spool, rate_hz, lsb))


def _csv_blocks(
    path: Path, rows: Any, places: list[int], header: list[str]
) -> Iterator[tuple[list[int], NDArray[np.float64]]]:
    """Numbers of lines, and what they hold in the chosen columns, many lines at a time."""
    while True:
        numbers, block = [], []
        for row in rows:
            if row:
                block.append(row)
                numbers.append(rows.line_num)
                if len(block) == AT_ONCE:
                    break
        if not block:
            return
        yield numbers, _csv_values(path, numbers, block, places, header)


def _csv_values(
    path: Path, numbers: list[int], block: list[list[str]], places: list[int], header: list[str]
) -> NDArray[np.float64]:
    """All at once; line by line only to find which one is wrong."""
    values = np.empty((len(block), len(places)))
    try:
        for i, place in enumerate(places):
            column = [row[place] for row in block]
            values[:, i] = list(map(float, column))
            if "_" in "".join(column):  # 1_0 is a number in Python only
                raise ValueError
        if np.isfinite(values).all():
            return values
    except (ValueError, IndexError):
        pass
    return np.array(
        [_csv_row(path, line, row, places, header) for line, row in zip(numbers, block, strict=True)]
    )


def _spooled(spool: Spool, rate_hz: float, lsb: float | None) -> Iterator[Recording]:
    timed = "time_s" in spool
    row = 0
    for gyro, *time_s in spool.blocks(["gyro", "time_s"] if timed else ["gyro"], AT_ONCE):
        device_s = time_s[0] if timed else np.arange(row, row + len(gyro)) / rate_hz
        yield Recording(gyro, rate_hz, device_s, lsb)
        row += len(gyro)


def _rate_of(path: Path, spool: Spool) -> float:
    """Rate of samples whose times are a device's: even, but for gaps."""
    if spool.length("time_s") < 2:
        raise UsageError(f"{path}: one row alone tells no rate; give it: --rate 100.")
    steps = np.diff(spool.whole("time_s"))
    if (steps <= 0).any():
        line = int(spool.whole("line")[int(np.argmax(steps <= 0)) + 1])
        raise UsageError(f"{path}:{line}: column '{TIME_COLUMN}': the time does not increase.")
    least, largest = float(steps.min()), float(steps.max())
    typical = float(np.median(steps, overwrite_input=True))  # one array of a day in memory, not two
    del steps
    steps = np.diff(spool.whole("time_s"))
    even = np.abs(steps - typical) <= EVENNESS * typical
    farthest_s = max(float(np.abs(times).max()) for (times,) in spool.blocks(["time_s"], AT_ONCE))
    if even.mean() < EVEN_SHARE or typical < SHORTEST_STEP_S or farthest_s > LONGEST_S:
        raise UsageError(
            f"{path}: column '{TIME_COLUMN}': the steps are too uneven for a device's clock (median "
            f"{typical:.3g} s, from {least:.3g} to {largest:.3g} s). If these are times of "
            "arrival, give the rate: --rate 100 (the column is then left aside)."
        )
    return 1.0 / float(steps[even].mean())


def _check_columns(path: Path, header: list[str], names: list[str]) -> None:
    has = listed(header) or "no header"
    if not names:
        raise UsageError(f"{path}:1: no columns gyro_x_dps, …; name yours with --columns (it has: {has}).")
    if len(names) > len(AXES):
        raise UsageError(f"--columns names {len(names)} columns; a gyroscope has up to {len(AXES)} axes.")
    missing = [n for n in names if n not in header]
    if missing:
        raise UsageError(f"{path}:1: no column {', '.join(missing)} (it has: {has}).")


def _csv_row(path: Path, line: int, row: list[str], places: list[int], header: list[str]) -> list[float]:
    values = []
    for place in places:
        if place >= len(row):
            raise UsageError(
                f"{path}:{line}: has {len(row)} fields; column {shown(header[place])} is number {place + 1}."
            )
        try:
            value = float(row[place].replace("_", "x"))  # 1_0 is a number in Python only
        except ValueError:
            raise UsageError(
                f"{path}:{line}: column {shown(header[place])}: {shown(row[place])} is not a number."
            ) from None
        if not math.isfinite(value):
            column, text = shown(header[place]), row[place].strip()
            raise UsageError(f"{path}:{line}: column {column}: {text} is not a finite number.")
        values.append(value)
    return values
