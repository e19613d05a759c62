"""Reads a JSON document that consists of named lists, or of a list of objects, each of which is a row."""

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from fltea.recording.column_names import states_units, tells_sensors
from fltea.recording.files import listed
from fltea.recording.readers.arrays import MOST_WIDE, NoNumbers, of_arrays
from fltea.recording.sheet import Sheet
from fltea.recording.text_labels import flat
from fltea.recording.text_times import points_of_time
from fltea.recording.units import is_unit
from fltea.recording.wanted import is_missing
from fltea.records.errors import UsageError

PHONE_GYROSCOPES = "Gyroscope", "GyroscopeUncalibrated"
"""Names of gyroscopes in files of the app Sensor Logger, which writes angular rates in rad/s."""

ROWS = {"data", "samples", "rows", "records", "readings", "measurements", "values", "frames", "items"}
NAMES = "name", "id", "sensor", "label"
BESIDE = {"meta", "metadata", "info", "header", "head", "attrs", "attributes", "config", "settings"}
"""Names of objects whose content is read as if it stood in the object around them."""

NS = 10**6, 10**3, 1
"""Number of nanoseconds in one unit of time: in a millisecond, in a microsecond and in a nanosecond."""

FIRST_NS, LAST_NS = 10**17, 4 * 10**18
"""Unix times from 1973 to 2096 are in this range [ns]. A whole number without a unit may count ms, µs or ns.
At most one of these units gives a time in this range, so the range shows the unit.
"""


def read(path: Path, _: str) -> Sheet:
    """Read all lists of numbers or words in the document.

    In files of the app Sensor Logger, read only the gyroscope's rows.
    """
    return of_document(_decoded(path.read_bytes()))


def of_document(document: Any) -> Sheet:
    """Return a table of all lists of numbers or words in a decoded document, by the names they have there.

    Raises:
        UsageError: the document holds no column of numbers, or two different columns with the same name.
    """
    found: dict[str, Any] = {}
    for name, value in _values("", document):
        is_word = isinstance(value, str) and not is_unit(value)
        if name in found and not is_word and found[name] != value:
            raise UsageError(
                f"holds two different {listed([name])}, and nothing says which of them is right. Correct the "
                "file."
            )
        found.setdefault(name, value)
    return of_arrays({name: _array(name, value) for name, value in found.items()})


def _decoded(data: bytes) -> Any:
    try:
        return msgspec.json.decode(data)
    except msgspec.DecodeError:
        if b"NaN" not in data and b"Infinity" not in data:
            raise
        return json.loads(data)  # this decoder accepts NaN and Infinity, which Python programs write


def _values(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Yield the lists, texts and numbers in a document, by their names."""
    if isinstance(value, list) and any(
        isinstance(row, dict) and any(map(_is_part, row.values())) for row in value
    ):
        value = {_called(row, place): row for place, row in enumerate(value, 1)}
    if isinstance(value, dict):
        value = _of_pandas(value)
    if isinstance(value, dict):
        is_one = sum(key.lower() in ROWS for key in value) == 1
        for key, inner in value.items():
            is_row = key.lower() in ROWS and is_one and isinstance(inner, dict | list)
            is_hidden = is_row or (key.lower() in BESIDE and isinstance(inner, dict))
            yield from _values(name if is_hidden else f"{name}.{key}" if name else key, inner)
    elif isinstance(value, list) and any(isinstance(row, dict) for row in value):
        columns = _columns_of([flat(row) for row in value if isinstance(row, dict)])
        yield from ((f"{name}.{key}" if name else key, column) for key, column in columns.items())
    elif isinstance(value, list) and not name:  # columns without names get their positions as names
        is_table = len({len(row) if isinstance(row, list) else 0 for row in value}) == 1
        lists = [*map(list, zip(*value, strict=True))] if is_table and isinstance(value[0], list) else [value]
        yield from ((str(place), column) for place, column in enumerate(lists, 1))
    elif isinstance(value, list | str):
        yield name, value
    elif isinstance(value, int | float):
        yield name, float(value)


def _is_part(value: Any) -> bool:
    """Return whether a value in a JSON object is a long list, or a list of objects.

    Such a value belongs to a whole sensor, not to a single row.
    """
    return isinstance(value, list) and (len(value) > MOST_WIDE or any(isinstance(one, dict) for one in value))


def _called(row: Any, place: int) -> str:
    """Return the name of the sensor that an item in a list of sensors describes.

    If the item states no name, return the item's position in the list.
    """
    names = [row[key] for key in NAMES if isinstance(row.get(key), str)] if isinstance(row, dict) else []
    return names[0] if names else str(place)


def _columns_of(rows: list[dict[str, Any]]) -> dict[str, list[Any]]:
    if any("sensor" in row and "seconds_elapsed" in row for row in rows):
        rows = _of_phone(rows)
    names = dict.fromkeys(name for row in rows for name in row)
    return {name: [row.get(name) for row in rows] for name in names}


def _of_pandas(found: dict[str, Any]) -> Any:
    """Convert an object from pandas' `to_json` to a mapping from names to columns, or to a list of rows.

    Objects in other forms stay unchanged.
    """
    # written by to_json(orient="table")
    if isinstance(found.get("schema"), dict) and isinstance(found.get("data"), list):
        return found["data"]
    if (split := _split(found)) is not None:
        return split
    is_by_row = all(isinstance(row, dict) and not any(map(_is_inner, row.values())) for row in found.values())
    if is_by_row and (keys := _in_order(found)) is not None:  # written by to_json(orient="index")
        index = _index(keys)
        return [{**found[key], **{name: at[k] for name, at in index.items()}} for k, key in enumerate(keys)]
    columns: dict[str, Any] = {}
    known: dict[str, Any] = {}
    for name, value in found.items():  # written by to_json(orient="columns")
        if isinstance(value, dict) and not any(map(_is_inner, value.values())):
            keys = list(known) if value.keys() == known.keys() else _in_order(value)
            if keys is not None:
                columns |= {} if known else _index(keys)
                known = known or dict.fromkeys(keys)
                value = [value[key] for key in keys]
        columns[name] = value
    return columns


def _split(found: dict[str, Any]) -> dict[str, Any] | None:
    """Convert an object with a list of rows and a list of column names to a mapping from names to columns.

    Return None for an object in another form.
    """
    tables = [key for key, rows in found.items() if isinstance(rows, list) and rows and _is_table(rows)]
    width = len(found[tables[0]][0]) if len(tables) == 1 else 0
    texts = [
        key
        for key, words in found.items()
        if isinstance(words, list) and len(words) == width and all(isinstance(word, str) for word in words)
    ]
    named = [key for key in texts if not key.lower().startswith("unit")]
    if not width or len(named) != 1 or len({*found[named[0]]}) < width:
        return None
    names, rows = found[named[0]], found[tables[0]]
    rest = {key: value for key, value in found.items() if key not in (*tables, *texts, "index")}
    for key in {*texts} - {*named}:
        rest |= {f"{name}_units": unit for name, unit in zip(names, found[key], strict=True)}
    index = found.get("index")
    rest |= _index([str(one) for one in index]) if isinstance(index, list) and len(index) == len(rows) else {}
    return {**rest, **dict(zip(names, map(list, zip(*rows, strict=True)), strict=True))}


def _is_table(rows: list[Any]) -> bool:
    return all(isinstance(row, list) for row in rows) and len({len(row) for row in rows}) == 1


def _is_inner(value: Any) -> bool:
    return isinstance(value, dict | list)


def _in_order(rows: Mapping[str, Any]) -> list[str] | None:
    """Return the keys under which an object holds its rows, in rising order.

    Return None if not all keys are numbers or times.
    """
    keys = list(rows)
    if len(keys) < 2 or not keys[0].removeprefix("-")[:1].isdigit():
        return None
    try:
        return sorted(keys, key=float)
    except ValueError:
        points = points_of_time(keys)
        return None if points is None else [keys[k] for k in np.argsort(points, kind="stable").tolist()]


def _index(keys: Sequence[str]) -> dict[str, Any]:
    """Return the keys under which an object holds its rows, as a column `index`.

    If the keys are 0, 1, 2 and so on, they are only numbers of the rows, and no column is returned.

    Keys that are Unix times become dates.
    """
    if not all(key.removeprefix("-").isdecimal() for key in keys):
        return {"index": list(keys)}
    numbers = [int(key) for key in keys]
    if numbers == list(range(len(numbers))):
        return {}
    scale = next((one for one in NS if min(numbers) * one >= FIRST_NS and max(numbers) * one < LAST_NS), 0)
    points = [number * scale for number in numbers]
    return {"index": list(np.array(points, "M8[ns]")) if scale else numbers}


def _array(name: str, value: Any) -> Any:
    """Return a list as an array of numbers, dates or words.

    The JSON value null stands for a missing number. Texts that hold numbers are converted to numbers.
    """
    if not isinstance(value, list):
        return value if isinstance(value, str) else np.array(value)
    if value and isinstance(value[0], np.datetime64):
        return np.array(value)
    try:
        return np.array(value, np.float64)
    except (TypeError, ValueError, OverflowError):
        bad = next((one for one in value if not isinstance(one, int | float | None)), "lists")
    if all(isinstance(one, str | int | float | None) for one in value):
        if (tells_sensors(name) or states_units(name)) and all(isinstance(one, str) for one in value):
            return np.array(value, object)
        texts = [None if one is None else str(one) for one in value]
        if (points := points_of_time(texts)) is not None:
            return points
        try:
            return np.array([np.nan if one is None or is_missing(one) else float(one) for one in texts])
        except ValueError:
            pass
    return NoNumbers(f"holds {str(bad)[:20]!r}, not one number in each row", len(value))


def _of_phone(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    sensors = {str(row.get("sensor")) for row in rows}
    sensor = next((name for name in PHONE_GYROSCOPES if name in sensors), None)
    if sensor is None:
        has = listed(sorted(sensors))
        raise UsageError(f"is a file of the app Sensor Logger, but has no gyroscope; it has {has}.")
    keys = {"seconds_elapsed": "time_s", **{axis: f"gyro_{axis}_rad_s" for axis in "xyz"}}
    return [{name: row.get(key) for key, name in keys.items()} for row in rows if row.get("sensor") == sensor]
