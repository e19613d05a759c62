"""Recording files read whole: .npz and CSV, each to one `Recording`.

A file is checked before its first sample goes out, so that bad input gives one clear error (file,
line, reason) and no half of an output.
"""

import csv
import io
import math
from array import array
from collections.abc import Sequence
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fltea.recording.lines import lines, shown
from fltea.recording.npz_arrays import NUMBER_BYTES, read_arrays
from fltea.recording.session import HIGHEST_RATE_HZ, LOWEST_RATE_HZ
from fltea.records.errors import UsageError
from fltea.records.records import AXES
from fltea.settings.limits import DEFAULT_LIMITS, Limits

PER_UNIT = {"deg/s": 1.0, "°/s": 1.0, "dps": 1.0, "mdps": 1e-3, "rad/s": math.degrees(1.0)}
"""Degrees per second in one of each unit."""

UNITS_HELP = f"{', '.join(PER_UNIT)}, or lsb:N (counts, N LSB per deg/s)"
TIME_COLUMN = "time_s"
LARGEST_DPS = 1e6
"""Hundreds of times what any gyroscope measures; beyond it the unit is wrong, and squares overflow."""

LONGEST_NAME, MOST_NAMES = 60, 30
"""How much of what a file says of itself goes into a message."""

EVENNESS, EVEN_SHARE = 0.2, 0.9
"""Times are a device's if nine steps in ten are within a fifth of the median."""

SHORTEST_STEP_S, LONGEST_S = 1e-6, 4e9
"""The second is 126 years; so many nanoseconds fit into 64 bits."""

LARGEST_COUNT, LARGEST_NUMBER = 2.0**31, 2.0**53
"""Of a sensor's register, and what a float tells from its neighbours."""

HOST_TOLERANCE = 0.05


class Recording(NamedTuple):
    """A resting gyroscope, as recorded.

    gyro: (n, axes) counts where lsb_per_dps is given, else deg/s.
    accel: (n, 3) counts or None, accel_lsb_per_g their scale. device_s: (n,) time of each sample by the
    device's clock.
    host_s: (n,) arrival times by the host's clock, or None where they were not recorded.
    seq: (n,) number of each sample, or None: then the times number them. epoch: (n,) number of the epoch.
    """

    gyro: NDArray[np.float64]
    rate_hz: float
    device_s: NDArray[np.float64]
    lsb_per_dps: float | None = None
    host_s: NDArray[np.float64] | None = None
    accel: NDArray[np.float64] | None = None
    seq: NDArray[np.int64] | None = None
    epoch: NDArray[np.int64] | None = None
    accel_lsb_per_g: float | None = None


def parse_units(text: str) -> tuple[float, float | None]:
    """Factor to deg/s and LSB per deg/s (None unless the unit is counts) of a unit's name.

    Raises:
        UsageError: an unknown unit.
    """
    if text in PER_UNIT:
        return PER_UNIT[text], None
    if text.startswith("lsb:"):
        try:
            lsb = float(text[4:])
        except ValueError:
            lsb = math.nan
        if lsb > 0 and math.isfinite(lsb):
            return 1.0, lsb
    raise UsageError(f"--units {text}: not a unit that this program knows. Give {UNITS_HELP}.")


NPZ_ARRAYS = (
    "gyro_raw",
    "gyro_dps",
    "fs_hz",
    "lsb_per_dps",
    "t_host_s",
    "accel_raw",
    "accel_lsb_per_g",
    "time_s",
    "seq",
    "epoch",
)
"""What is read of a file, whatever else may be in it."""


def read_npz(path: Path, limits: Limits = DEFAULT_LIMITS) -> Recording:
    """Read `gyro_raw` with `lsb_per_dps`, or `gyro_dps`; `fs_hz`; optional `t_host_s`, `accel_raw`.

    A recording with gaps also has `time_s` (of the device), `seq` and `epoch`, as `fltea export` writes them.

    Raises:
        UsageError: not such a file, values that are not finite, or more of them than the limits allow.
    """
    data, names = read_arrays(path, NPZ_ARRAYS, limits)
    key = next((k for k in ("gyro_raw", "gyro_dps") if k in data), None)
    needed = ["fs_hz"] + (["lsb_per_dps"] if key == "gyro_raw" else [])
    missing = [k for k in needed if k not in data] + ([] if key else ["gyro_raw or gyro_dps"])
    if key is None or missing:
        has = _listed(names) or "nothing"
        raise UsageError(f"{path}: has no {', '.join(missing)} (it holds {has}).")
    gyro = _numeric(path, key, data[key])
    if gyro.ndim != 2 or not 1 <= gyro.shape[1] <= len(AXES):
        raise UsageError(f"{path}: {key} has the shape {gyro.shape}; (samples, 1 to 3 axes) is needed.")
    if len(gyro) == 0:
        raise UsageError(f"{path}: {key} has no rows.")
    rate_hz = _positive(path, "fs_hz", data["fs_hz"])
    host_s = _numeric(path, "t_host_s", data["t_host_s"]) if "t_host_s" in data else None
    accel = _numeric(path, "accel_raw", data["accel_raw"]) if "accel_raw" in data else None
    for name, extra, shape in (("t_host_s", host_s, (len(gyro),)), ("accel_raw", accel, (len(gyro), 3))):
        if extra is not None and extra.shape != shape:
            raise UsageError(f"{path}: {name} has the shape {extra.shape}; {shape} is needed, as {key} has.")
    for name, extra in ((key, gyro if key == "gyro_raw" else None), ("accel_raw", accel)):
        if extra is not None and np.abs(extra).max() >= LARGEST_COUNT:
            raise UsageError(f"{path}: {name} holds numbers beyond 32 bits, which are no sensor's counts.")
    device_s, seq, epoch = _read_gaps(path, data, len(gyro), rate_hz)
    _check_span(path, rate_hz, device_s)
    if host_s is not None and len(host_s) > 1:
        _check_host_times(path, host_s, rate_hz, device_s)
    lsb = _positive(path, "lsb_per_dps", data["lsb_per_dps"]) if key == "gyro_raw" else None
    too_large = _too_large(gyro, lsb)
    if too_large.any():
        raise UsageError(
            f"{path}: {key} is more than {LARGEST_DPS:g} deg/s in row {int(np.argmax(too_large))}."
        )
    accel_lsb = (
        _positive(path, "accel_lsb_per_g", data["accel_lsb_per_g"]) if "accel_lsb_per_g" in data else None
    )
    return Recording(gyro, rate_hz, device_s, lsb, host_s, accel, seq, epoch, accel_lsb)


def _read_gaps(
    path: Path, data: dict[str, NDArray[Any]], n: int, rate_hz: float
) -> tuple[NDArray[np.float64], NDArray[np.int64] | None, NDArray[np.int64] | None]:
    """Time, number and epoch of each sample; without them one follows the other."""
    found = {name: _numeric(path, name, data[name]) for name in ("time_s", "seq", "epoch") if name in data}
    for name, values in found.items():
        if values.shape != (n,):
            raise UsageError(f"{path}: {name} has the shape {values.shape}; ({n},) is needed.")
    if "time_s" not in found:
        return np.arange(n) / rate_hz, None, None
    if (np.diff(found["time_s"]) <= 0).any() or np.abs(found["time_s"]).max() > LONGEST_S:
        row = int(np.argmax(np.diff(found["time_s"]) <= 0)) + 1
        raise UsageError(f"{path}: time_s does not increase in row {row}, or is beyond {LONGEST_S:g} s.")
    for name in ("seq", "epoch"):
        if name in found and np.abs(found[name]).max() > LARGEST_NUMBER:
            raise UsageError(f"{path}: {name} holds numbers beyond 53 bits, which number no samples.")
    whole = {name: values.astype(np.int64) for name, values in found.items() if name != "time_s"}
    return found["time_s"], whole.get("seq"), whole.get("epoch")


def _check_span(path: Path, rate_hz: float, device_s: NDArray[np.float64]) -> None:
    if not LOWEST_RATE_HZ <= rate_hz <= HIGHEST_RATE_HZ or device_s[-1] - device_s[0] > LONGEST_S:
        raise UsageError(
            f"{path}: a rate of {rate_hz:.6g} Hz is no gyroscope's ({len(device_s)} samples over "
            f"{device_s[-1] - device_s[0]:.3g} s)."
        )


def _check_host_times(
    path: Path, host_s: NDArray[np.float64], rate_hz: float, device_s: NDArray[np.float64]
) -> None:
    """Arrivals may come in bursts, but neither backwards nor at another rate than the one stated."""
    steps = np.diff(host_s)
    if (steps < 0).any():
        raise UsageError(f"{path}: t_host_s runs backwards in row {int(np.argmax(steps < 0)) + 1}.")
    seconds, expected_s = float(host_s[-1] - host_s[0]), float(device_s[-1] - device_s[0])
    if abs(seconds - expected_s) > HOST_TOLERANCE * expected_s + 1.0:
        raise UsageError(
            f"{path}: t_host_s spans {seconds:.6g} s, but {len(host_s)} samples at fs_hz = {rate_hz:.6g} "
            f"take {expected_s:.6g} s: one of the two is wrong, or samples are missing."
        )


def read_csv(
    path: Path,
    columns: list[str] | None = None,
    units: str = "dps",
    rate_hz: float | None = None,
    *,
    limits: Limits = DEFAULT_LIMITS,
    file: BinaryIO | None = None,
) -> Recording:
    """Read named columns of a CSV file with a header.

    columns: one to three names, for the axes x, y, z; by default those called gyro_x_dps, ….
    rate_hz: samples per second; may be left out where the file has a column `time_s`. file: what is behind
    the path, if it has been opened already.

    Raises:
        UsageError: names file, line and reason.
    """
    factor, lsb = parse_units(units)
    try:
        with io.TextIOWrapper(file or path.open("rb"), encoding="utf-8-sig", newline="") as text:
            rows = csv.reader(lines(path, text))
            header = [name.strip() for name in next(rows, [])]
            names = columns or [f"{axis}_dps" for axis in AXES if f"{axis}_dps" in header]
            _check_columns(path, header, names)
            has_time = TIME_COLUMN in header
            places = [header.index(n) for n in names] + ([header.index(TIME_COLUMN)] if has_time else [])
            table, numbers = array("d"), array("q")
            most = limits.whole_bytes // NUMBER_BYTES
            for row in filter(None, rows):
                table.extend(_csv_row(path, rows.line_num, row, places, header))
                numbers.append(rows.line_num)
                if len(table) > most:
                    raise limits.whole_too_large(f"{path}:{rows.line_num}", len(table) * NUMBER_BYTES)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise UsageError(f"{path}: cannot be read as CSV ({error}).") from error
    if not table:
        raise UsageError(f"{path}: has a header but no rows.")
    values = np.frombuffer(table).reshape(len(numbers), len(places))
    with np.errstate(over="ignore"):
        gyro = values[:, : len(names)] * factor
    too_large = _too_large(gyro, lsb)
    if too_large.any():
        line = numbers[int(np.argmax(too_large))]
        raise UsageError(f"{path}:{line}: more than {LARGEST_DPS:g} deg/s; is --units {units} right?")
    if rate_hz is not None:  # given: it wins over a column of times
        device_s = np.arange(len(gyro)) / rate_hz
        _check_span(path, rate_hz, device_s)
        return Recording(gyro, rate_hz, device_s, lsb)
    if not has_time:
        raise UsageError(f"{path}: has no column '{TIME_COLUMN}', so give its rate: --rate 100.")
    time_s = values[:, -1]
    rate_hz = _rate_of(path, time_s, numbers)
    return Recording(gyro, rate_hz, time_s, lsb)


def _rate_of(path: Path, time_s: NDArray[np.float64], numbers: Sequence[int]) -> float:
    """Rate of samples whose times are a device's: even, but for gaps."""
    if len(time_s) < 2:
        raise UsageError(f"{path}: one row alone tells no rate; give it: --rate 100.")
    steps = np.diff(time_s)
    if (steps <= 0).any():
        line = numbers[int(np.argmax(steps <= 0)) + 1]
        raise UsageError(f"{path}:{line}: column '{TIME_COLUMN}': the time does not increase.")
    typical = float(np.median(steps))
    even = np.abs(steps - typical) <= EVENNESS * typical
    if even.mean() < EVEN_SHARE or typical < SHORTEST_STEP_S or np.abs(time_s).max() > LONGEST_S:
        raise UsageError(
            f"{path}: column '{TIME_COLUMN}': the steps are too uneven for a device's clock (median "
            f"{typical:.3g} s, from {steps.min():.3g} to {steps.max():.3g} s). If these are times of "
            "arrival, give the rate: --rate 100 (the column is then left aside)."
        )
    return 1.0 / float(steps[even].mean())


def _check_columns(path: Path, header: list[str], names: list[str]) -> None:
    has = _listed(header) or "no header"
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


def _listed(names: Sequence[str]) -> str:
    """Names of columns or arrays, for a message."""
    known = [name if name.isprintable() and len(name) < LONGEST_NAME else shown(name) for name in names]
    return ", ".join(known[:MOST_NAMES]) + (f", … {len(known)} in all" if len(known) > MOST_NAMES else "")


def _too_large(gyro: NDArray[np.float64], lsb_per_dps: float | None) -> NDArray[np.bool_]:
    """Mark the rows with a rate that no gyroscope has."""
    return np.asarray((np.abs(gyro) > LARGEST_DPS * (lsb_per_dps or 1.0)).any(axis=1))


def _numeric(path: Path, name: str, array: NDArray[Any]) -> NDArray[np.float64]:
    try:
        values = np.asarray(array, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise UsageError(f"{path}: {name} does not hold numbers.") from error
    finite = np.isfinite(np.atleast_1d(values))
    if not finite.all():
        row = np.unravel_index(int(np.argmin(finite)), finite.shape)[0]
        raise UsageError(f"{path}: {name} is not finite in row {row}.")
    return values


def _positive(path: Path, name: str, array: NDArray[Any]) -> float:
    values = _numeric(path, name, array)
    if values.size != 1 or values.item() <= 0:
        raise UsageError(f"{path}: {name} has to be one positive number.")
    return float(values.item())
