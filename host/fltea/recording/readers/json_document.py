"""One document of JSON."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from fltea.recording.files import listed
from fltea.recording.readers.arrays import of_arrays
from fltea.recording.sheet import Sheet
from fltea.records.errors import UsageError

PHONE_GYROSCOPES = "Gyroscope", "GyroscopeUncalibrated"
"""As the app Sensor Logger calls them; they are in rad/s."""


def read(path: Path, _: str) -> Sheet | Iterator[bytes]:
    """One array of objects, or lists by their names; of the app Sensor Logger those of its gyroscope."""
    found = msgspec.json.decode(path.read_bytes())
    if isinstance(found, dict):
        if isinstance(found.get("columns"), list) and isinstance(found.get("data"), list):  # pandas, "split"
            found = dict(
                zip(map(str, found["columns"]), map(list, zip(*found["data"], strict=True)), strict=True)
            )
        every = {
            k: [*v.values()] if isinstance(v, dict) else v for k, v in found.items()
        }  # pandas, "columns"
        lists = {name: value for name, value in every.items() if isinstance(value, list) and value}
        if not any(isinstance(value[0], dict) for value in lists.values()):
            return of_arrays({name: np.array(value) for name, value in lists.items()})
        found = max((value for value in lists.values() if isinstance(value[0], dict)), key=len)
    rows = [row for row in found if isinstance(row, dict)]
    if any("sensor" in row and "seconds_elapsed" in row for row in rows):
        sensors = {str(row.get("sensor")) for row in rows}
        sensor = next((name for name in PHONE_GYROSCOPES if name in sensors), None)
        if sensor is None:
            has = listed(sorted(sensors))
            raise UsageError(f"is of the app Sensor Logger, without a gyroscope; it has {has}.")
        keys = {"seconds_elapsed": "time_s", **{axis: f"gyro_{axis}_rad_s" for axis in "xyz"}}
        rows = [
            {name: row.get(key) for key, name in keys.items()} for row in rows if row.get("sensor") == sensor
        ]
    return (msgspec.json.encode({key: _number(value) for key, value in row.items()}) + b"\n" for row in rows)


def _number(value: Any) -> Any:
    """A number that stands there as text, as a number."""
    try:
        return float(value) if isinstance(value, str) else value
    except ValueError:
        return value
