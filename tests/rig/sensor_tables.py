"""Tables with rows of several sensors, in the forms in which a table can be written."""

import itertools
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow as pa
import pytest
from fltea.recording.csv_file import open_csv
from fltea.recording.files import Stored
from fltea.recording.reading import NotStated
from fltea.records.errors import UsageError
from fltea.settings.how import How
from pyarrow import feather, parquet

from tests.rig.table_support import open_here

FILES = itertools.count()
N = 200
GYRO = np.round(np.random.default_rng(11).normal(size=(N, 3, 3)), 4)
"""Angular rates [deg/s] of three sensors, of shape (samples, sensors, axes)."""
AXES = [f"gyro_{axis}_dps" for axis in "xyz"]
NUMBERS, WORDS, DEVICES = ["0", "1", "2"], ["left", "right", "the third"], ["3932170", "3932171", "3932172"]


def table(
    ids: Sequence[str], which: Sequence[int], column: str = "sensor_id", later_s: float = 0.0
) -> dict[str, list[Any]]:
    """Return rows at 100 Hz, each with its sensor's number.

    The second sensor's times are later by `later_s`.
    """
    count = [0] * len(ids)
    rows = []
    for one in which:
        k, count[one] = count[one], count[one] + 1
        value: Any = int(ids[one]) if ids[one].isdecimal() else ids[one]
        rows.append([round(k / 100 + later_s * one, 6), value, *GYRO[k, one].tolist()])
    return dict(zip(["t_s", column, *AXES], map(list, zip(*rows, strict=True)), strict=True))


def text(folder: Path, columns: dict[str, list[Any]], separator: str, quote: str = "", **how: Any) -> Stored:
    def cell(value: Any) -> str:
        return f"{quote}{value}{quote}" if isinstance(value, str) else str(value)

    lines = [
        separator.join(columns),
        *(separator.join(map(cell, row)) for row in zip(*columns.values(), strict=True)),
    ]
    path = folder / "rest.csv"
    path.write_text("\n".join(lines) + "\n")
    return open_csv(path, How(**how))


def csv(folder: Path, columns: dict[str, list[Any]], **how: Any) -> Stored:
    return text(folder, columns, ",", **how)


def quoted(folder: Path, columns: dict[str, list[Any]], **how: Any) -> Stored:
    return text(folder, columns, ";", '"', **how)


def json_lines(folder: Path, columns: dict[str, list[Any]], **how: Any) -> Stored:
    path = folder / "rest.jsonl"
    rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    path.write_text("".join(json.dumps(row) + "\n" for row in rows))
    return open_csv(path, How(**how))


def json_columns(folder: Path, columns: dict[str, list[Any]], **how: Any) -> Stored:
    path = folder / "rest.json"
    path.write_text(json.dumps(columns))
    return open_here("json", path, **how)


def of_parquet(folder: Path, columns: dict[str, list[Any]], **how: Any) -> Stored:
    path = folder / "rest.parquet"
    parquet.write_table(pa.table(columns), path, row_group_size=64)
    return open_here("parquet", path, **how)


def of_categories(folder: Path, columns: dict[str, list[Any]], **how: Any) -> Stored:
    path = folder / "rest.feather"
    made = {
        name: pa.array(values).dictionary_encode() if isinstance(values[0], str) else values
        for name, values in columns.items()
    }
    feather.write_feather(pa.table(made), path, chunksize=64)
    return open_here("feather", path, **how)


def hdf5(folder: Path, columns: dict[str, list[Any]], **how: Any) -> Stored:
    path = folder / f"{next(FILES)}.h5"  # a new name, since h5py may still hold the earlier file open
    with h5py.File(path, "w") as file:
        for name, values in columns.items():
            file[f"imu/{name}"] = values
    return open_here("hdf5", path, **how)


def npz(folder: Path, columns: dict[str, list[Any]], **how: Any) -> Stored:
    arrays: dict[str, Any] = {name: np.array(values) for name, values in columns.items()}
    np.savez(folder / "rest.npz", **arrays)
    return open_here("arrays", folder / "rest.npz", **how)


FORMS = [csv, quoted, json_lines, json_columns, of_parquet, of_categories, hdf5, npz]
each_form = pytest.mark.parametrize("form", FORMS, ids=lambda form: form.__name__)


def refusal(read: Callable[..., Any], *arguments: Any, kind: type[UsageError] = NotStated, **how: Any) -> str:
    with pytest.raises(kind) as caught:
        read(*arguments, **how)
    return str(caught.value)


def assert_is(stored: Stored, sensor: int, count: int = N) -> None:
    """Check that all samples of one sensor are there, and no other."""
    whole = stored.whole()
    assert whole.gyro.tolist() == GYRO[:count, sensor].tolist()
    assert stored.rate_hz == pytest.approx(100)
    assert whole.seq is None or whole.seq.tolist() == [*range(count)]
