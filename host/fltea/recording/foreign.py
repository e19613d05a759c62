"""Formats of other programs, each by the library that is kept for it: run as a program by `apart`.

stdout: pieces, each behind its length in four bytes. The first is a `Head` as JSON. Then come lines of text,
or after a line of JSON on stdin, the places of the columns that are wanted, rows of their numbers. The length
0 ends them; FAILED stands before a reason.
"""

import math
import resource
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

import msgspec
import numpy as np

from fltea.recording import pandas_hdf5
from fltea.recording.apart import FAILED, LENGTH, LIBRARIES, Head
from fltea.recording.column_names import axis_of, named_axis
from fltea.recording.files import AT_ONCE, listed
from fltea.recording.npz_arrays import KINDS
from fltea.recording.sample_times import Floats
from fltea.recording.sheet import SAMPLE_ROWS, Sheet
from fltea.records.errors import UsageError

MOST_WIDE = 64
"""Columns of one array; what is wider than long lies on its side, as MATLAB writes it."""

RATES = ("fs", "fs_hz", "rate", "rate_hz", "sample_rate", "sampling_rate", "sample_rate_hz", "imu_rate")
"""Names of a number that is a rate."""

PX4_TOPICS = "sensor_combined", "sensor_gyro"
"""Those of a log that are read if none is named, the first that is there."""

PHONE_GYROSCOPES = "Gyroscope", "GyroscopeUncalibrated"
"""As the app Sensor Logger calls them; they are in rad/s."""

LIBRARY_S = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}

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


def arrays_of_npz(path: Path, _: str) -> Sheet:
    """An archive that another program than fltea has written."""
    with np.load(path, allow_pickle=False) as archive:
        return of_arrays({name: archive[name] for name in archive.files})


def matlab(path: Path, _: str) -> Sheet:
    """Variables and the fields of structures; since version 7.3 such a file is one of HDF5."""
    from scipy.io import loadmat

    found: dict[str, Any] = {}

    def take(name: str, value: Any) -> None:
        if isinstance(value, dict):
            for key, inner in value.items():
                take(f"{name}.{key}" if name else key, inner)
        elif not name.startswith("__"):
            found[name] = np.asarray(value)

    take("", loadmat(path, simplify_cells=True))
    return of_arrays(found)


def hdf5(path: Path, _: str) -> Sheet:
    """A table of pandas, or else all data sets, by their paths; read block by block."""
    import h5py

    file = h5py.File(path, "r")
    found: dict[str, Any] = {}
    units: dict[str, str] = {}

    def take(name: str, item: Any) -> dict[str, Any] | None:
        if isinstance(item, h5py.Group) and pandas_hdf5.is_table(item):
            return pandas_hdf5.columns_of(item)
        if isinstance(item, h5py.Dataset):
            name = name.replace("/", ".")
            found[name] = item
            stated = item.attrs.get("units", item.attrs.get("unit", ""))
            units[name] = stated.decode(errors="replace") if isinstance(stated, bytes) else str(stated)
        return None

    table = file.visititems(take)
    return of_arrays(found if table is None else table, units)


def px4(path: Path, topic: str) -> Sheet:
    """The gyroscope of a log: `sensor_combined`, or the topic that is named, whose first instance is read."""
    from pyulog import ULog

    log = ULog(str(path))
    there = {data.name for data in log.data_list}
    name = topic or next((known for known in PX4_TOPICS if known in there), "")
    if name not in there:
        asked = f"no topic {topic}" if topic else f"no topic {' or '.join(PX4_TOPICS)}"
        raise UsageError(f"is a PX4 log with {asked}; name one by --topic: {listed(sorted(there))}.")
    data = log.get_dataset(name).data
    sheet = of_arrays(data)
    of_sensor = name.startswith("sensor_gyro")
    names = [f"gyro_{n}" if of_sensor and n in "xyz" else n for n in sheet.names]
    units = ["us" if n == "timestamp" else "rad/s" if axis_of(n) else "" for n in names]
    units = ["m/s^2" if n.startswith("accelerometer_m_s2") else u for n, u in zip(names, units, strict=True)]
    return sheet._replace(names=names, units=units)


def parquet(path: Path, _: str) -> Sheet:
    """Columns of a Parquet file; those in structures are called `angular_velocity.x`."""
    from pyarrow import parquet as library

    file = library.ParquetFile(path, pre_buffer=False)
    return _arrow(
        file.schema_arrow,
        file.metadata.num_rows,
        lambda names: file.iter_batches(AT_ONCE, columns=names, use_threads=False),
    )


def feather(path: Path, _: str) -> Sheet:
    """Columns of a Feather file, which is Arrow's own."""
    import pyarrow as pa

    file = pa.ipc.open_file(pa.memory_map(str(path)))
    batches = range(file.num_record_batches)
    rows = sum(file.get_batch(k).num_rows for k in batches)
    return _arrow(file.schema, rows, lambda _: (file.get_batch(k) for k in batches))


def _arrow(schema: Any, rows: int, batches: Callable[[list[str]], Iterator[Any]]) -> Sheet:
    import pyarrow as pa
    from pyarrow import compute

    flat = _flat(pa.Table.from_batches([], schema)).schema
    names = list(flat.names)
    kinds = [field.type for field in flat]
    stamps = [n for n, kind in zip(names, kinds, strict=True) if _is_stamp(kind)]

    def blocks(places: Sequence[int]) -> Iterator[Floats]:
        bad = [names[p] for p in places if not (_is_stamp(kinds[p]) or _is_number(kinds[p]))]
        if bad:
            raise UsageError(f"column {listed(bad)} does not hold numbers.")
        begin = None
        for batch in batches([names[p] for p in places]):
            table = _flat(pa.Table.from_batches([batch]))
            values = np.empty((len(table), len(places)))
            for i, place in enumerate(places):
                column, scale = table.column(names[place]), 1.0
                if _is_stamp(kinds[place]):
                    column, scale = column.cast(pa.int64()), LIBRARY_S[kinds[place].unit]
                    if begin is None:
                        begin = next((stamp.as_py() for stamp in column if stamp.is_valid), None)
                    column = compute.subtract(column, begin or 0)  # floats tell Unix times to 0.2 µs only
                values[:, i] = column.cast(pa.float64(), safe=False).to_numpy() * scale
            for first in range(0, len(values), AT_ONCE):
                yield values[first : first + AT_ONCE]

    return Sheet(names, [""] * len(names), rows, blocks, tuple(stamps))


def _flat(table: Any) -> Any:
    import pyarrow as pa

    while any(pa.types.is_struct(field.type) for field in table.schema):
        table = table.flatten()
    return table


def _is_number(kind: Any) -> bool:
    from pyarrow import types

    numbers = types.is_integer, types.is_floating, types.is_boolean, types.is_decimal
    return any(is_kind(kind) for is_kind in numbers)


def _is_stamp(kind: Any) -> bool:
    from pyarrow import types

    return bool(types.is_timestamp(kind) or types.is_duration(kind))


def json_objects(path: Path, _: str) -> Sheet | Iterator[bytes]:
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


def excel(path: Path, _: str) -> Iterator[bytes]:
    """The first sheet with more than ten rows as lines of text, whose fields are separated by tabs."""
    from openpyxl import load_workbook

    book = load_workbook(path, read_only=True, data_only=True, keep_links=False)
    sheet = next((one for one in book.worksheets if (one.max_row or 11) > 10), book.worksheets[0])
    sheet.reset_dimensions()  # some programs write wrong ones, and rows beyond them would be missing
    lines: list[str] = []
    for row in sheet.iter_rows(values_only=True):
        lines.append("\t".join("" if cell is None else _cell(cell) for cell in row).rstrip("\t"))
        if len(lines) == AT_ONCE:
            yield "".join(line + "\n" for line in lines).encode()
            lines.clear()
    yield "".join(line + "\n" for line in lines).encode()


def _cell(value: Any) -> str:
    text = value.isoformat() if hasattr(value, "isoformat") else str(value)
    return text.replace("\t", " ").replace("\n", " ")


READERS: dict[str, Callable[[Path, str], Sheet | Iterator[bytes]]] = {
    "arrays": arrays_of_npz,
    "mat": matlab,
    "hdf5": hdf5,
    "ulg": px4,
    "parquet": parquet,
    "feather": feather,
    "xlsx": excel,
    "json": json_objects,
}
"""By the kind of file."""


def main(seconds: str, memory: str, kind: str, path: str, topic: str) -> None:
    """Read a file within so much processor time and address space, and write nothing but to stdout."""
    for what, most in (
        (resource.RLIMIT_CPU, int(seconds)),
        (resource.RLIMIT_AS, int(memory)),
        (resource.RLIMIT_FSIZE, 0),
        (resource.RLIMIT_CORE, 0),
    ):
        resource.setrlimit(what, (most, most))
    try:
        found = READERS[kind](Path(path), topic)
        if isinstance(found, Sheet):
            names, units, rows, _, stamps, rate_hz, _ = found
            _send(msgspec.json.encode(Head(names, units, rows, list(stamps), rate_hz, _sample(found))))
            places = msgspec.json.decode(sys.stdin.buffer.readline() or b"[]", type=list[int])
            for values in found.blocks(places) if places else ():
                _send(np.ascontiguousarray(values).tobytes())
        else:
            _send(msgspec.json.encode(Head(text=True)))
            for data in found:
                _send(data)
        _send(b"")
    except BrokenPipeError:
        pass
    except UsageError as error:
        _fail(str(error))
    except MemoryError:
        _fail(f"more than the {int(memory) / 1e9:.1f} GB would be needed that a file of its size may take.")
    except Exception as error:  # whatever a library raises on damaged bytes
        reason = str(error).partition("\n")[0] or type(error).__name__
        _fail(f"cannot be read as {LIBRARIES[kind].name} ({reason}).")


def _sample(sheet: Sheet) -> list[list[float | None]]:
    """The first rows, with null where there are no numbers."""
    columns: list[list[float | None]] = []
    count = min(SAMPLE_ROWS, sheet.rows)
    for place in range(min(len(sheet.names), MOST_WIDE)):
        try:
            values = next(iter(sheet.blocks([place])))[:count, 0]
            columns.append([float(value) if np.isfinite(value) else None for value in values])
        except (UsageError, ValueError, StopIteration):
            columns.append([None] * count)
    return [list(row) for row in zip(*columns, strict=True)]


def _send(data: bytes) -> None:
    sys.stdout.buffer.write(LENGTH.pack(len(data)) + data)
    sys.stdout.buffer.flush()


def _fail(reason: str) -> None:
    sys.stdout.buffer.write(LENGTH.pack(FAILED) + reason.encode(errors="replace"))
    sys.stdout.buffer.flush()


if __name__ == "__main__":
    main(*sys.argv[1:])
