"""One document of JSON."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from fltea.recording.column_names import tells_sensors
from fltea.recording.files import listed
from fltea.recording.readers.arrays import NoNumbers, of_arrays
from fltea.recording.sheet import Sheet
from fltea.records.errors import UsageError

PHONE_GYROSCOPES = "Gyroscope", "GyroscopeUncalibrated"
"""As the app Sensor Logger calls them; they are in rad/s."""


def read(path: Path, _: str) -> Sheet | Iterator[bytes]:
    """Read one array of objects, or lists by their names; of the app Sensor Logger those of its gyroscope."""
    found = msgspec.json.decode(path.read_bytes())
    if isinstance(found, dict):
        found = _by_name(found)
        tables = [value for value in found.values() if _is_table(value)]
        if not tables:
            return of_arrays(dict(_arrays("", found)))
        found = max(tables, key=len)
    if isinstance(found, list) and found and not any(isinstance(row, dict) for row in found):
        table = _array(found)  # without names, so by their positions
        columns = table.T if isinstance(table, np.ndarray) and table.ndim == 2 else [table]
        return of_arrays({str(place): column for place, column in enumerate(columns, 1)})
    rows = [row for row in found if isinstance(row, dict)] if isinstance(found, list) else []
    if any("sensor" in row and "seconds_elapsed" in row for row in rows):
        rows = _of_phone(rows)
    return (msgspec.json.encode({key: _number(value) for key, value in row.items()}) + b"\n" for row in rows)


def _by_name(found: dict[str, Any]) -> dict[str, Any]:
    """Columns as pandas' `to_json` writes them, each as a list; what is not so stays as it is."""
    if isinstance(found.get("columns"), list) and isinstance(found.get("data"), list):  # "split"
        return dict(zip(map(str, found["columns"]), map(list, zip(*found["data"], strict=True)), strict=True))
    if found and all(isinstance(value, dict) and _is_column(value) for value in found.values()):
        columns = {name: list(value.values()) for name, value in found.items()}
        if not any(isinstance(row, dict) for value in columns.values() for row in value[:1]):
            return columns
    rows = list(found.values())
    if rows and all(isinstance(row, dict) for row in rows) and _is_column(found):  # "index"
        return {"": rows}
    return found


def _is_column(value: dict[str, Any]) -> bool:
    """Whether the keys are those of rows: numbers or dates."""
    return len(value) > 1 and all(key.removeprefix("-")[:1].isdigit() for key in value)


def _is_table(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and isinstance(value[0], dict)


def _arrays(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _arrays(f"{name}.{key}" if name else key, inner)
    elif isinstance(value, list) and value:
        is_words = tells_sensors(name) and all(isinstance(one, str) for one in value)
        yield name, np.array(value, object) if is_words else _array(value)
    elif isinstance(value, str):
        yield name, value
    elif isinstance(value, int | float):
        yield name, np.array(float(value))


def _array(values: list[Any]) -> Any:
    """Numbers, of which null is a missing one, and text that holds one is a number too."""
    try:
        return np.array(values, np.float64)
    except (TypeError, ValueError, OverflowError):
        bad = next((value for value in values if not isinstance(value, int | float | None)), "lists")
        return NoNumbers(f"holds {str(bad)[:20]!r}, not one number in each row", len(values))


def _of_phone(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    sensors = {str(row.get("sensor")) for row in rows}
    sensor = next((name for name in PHONE_GYROSCOPES if name in sensors), None)
    if sensor is None:
        has = listed(sorted(sensors))
        raise UsageError(f"is of the app Sensor Logger, without a gyroscope; it has {has}.")
    keys = {"seconds_elapsed": "time_s", **{axis: f"gyro_{axis}_rad_s" for axis in "xyz"}}
    return [{name: row.get(key) for key, name in keys.items()} for row in rows if row.get("sensor") == sensor]


def _number(value: Any) -> Any:
    """A number that stands there as text, as a number."""
    try:
        return float(value) if isinstance(value, str) else value
    except ValueError:
        return value
