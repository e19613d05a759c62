"""Tests Parquet and Feather files: lists, structures, times of all kinds, and metadata."""

import itertools
import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from fltea.recording.files import Stored
from fltea.records.errors import UsageError
from pyarrow import feather, parquet

from tests.rig.table_support import open_here

N, RATE_HZ = 300, 100.0
TIMES_S = np.arange(N) / RATE_HZ
US = np.arange(N) * 10_000
DPS = np.random.default_rng(1).normal((0.6, -0.25, 0.15), 1.0, (N, 3))
NAMED = {f"g{axis}_dps": DPS[:, k] for k, axis in enumerate("xyz")}
COUNT = itertools.count()


def table(folder: Path, content: Any, **how: Any) -> Stored:
    """Write columns, in several batches, to a Parquet file and to a Feather file. Check that both are read
    with equal rates and times, and return the recording that was read.
    """
    made = content if isinstance(content, pa.Table) else pa.table(content)
    path = folder / f"{next(COUNT)}.parquet"
    parquet.write_table(made, path, row_group_size=128)
    feather.write_feather(made, path.with_suffix(".feather"), chunksize=64)
    found = open_here("parquet", path, **how)
    other = open_here("feather", path.with_suffix(".feather"), **how)
    assert found.whole().gyro.tolist() == other.whole().gyro.tolist()
    assert found.whole().device_s == pytest.approx(other.whole().device_s)
    return found


def refusal(folder: Path, content: Any, **how: Any) -> str:
    with pytest.raises(UsageError) as caught:
        table(folder, content, **how)
    return str(caught.value)


def is_right(found: Stored) -> bool:
    whole = found.whole()
    return (
        whole.gyro == pytest.approx(DPS)
        and found.rate_hz == pytest.approx(RATE_HZ)
        and whole.device_s == pytest.approx(TIMES_S)
    )


LISTS = {
    "lists": pa.array(DPS.tolist()),
    "of three": pa.array(DPS.tolist(), pa.list_(pa.float64(), 3)),
    "large": pa.array(DPS.tolist(), pa.large_list(pa.float64())),
    "structures": pa.array([dict(zip("xyz", row, strict=True)) for row in DPS.tolist()]),
}


@pytest.mark.parametrize("kind", LISTS)
def test_three_numbers_in_a_column_are_axes_in_the_unit_of_its_name(kind: str, tmp_path: Path) -> None:
    columns = {"t": TIMES_S, "gyro_dps": LISTS[kind]}
    assert is_right(table(tmp_path, columns))
    assert "--units rad/s says otherwise" in refusal(tmp_path, columns, units="rad/s")
    inner = pa.StructArray.from_arrays([pa.array(TIMES_S), LISTS[kind]], ["t", "gyro_dps"])
    assert is_right(table(tmp_path, {"imu": inner}))


def test_a_list_that_is_shorter_is_a_lost_sample(tmp_path: Path) -> None:
    rows = DPS.tolist()
    rows[7], rows[150] = rows[7][:2], None
    found = table(tmp_path, {"t": TIMES_S, "gyro_dps": pa.array(rows)})
    assert found.whole().gyro == pytest.approx(np.delete(DPS, [7, 150], axis=0))


def test_four_numbers_in_a_column_are_no_axes(tmp_path: Path) -> None:
    columns = {"t": TIMES_S, "gyro": pa.array(np.c_[DPS, DPS[:, 0]].tolist())}
    assert "which columns are the gyroscope's axes" in refusal(tmp_path, columns)
    names = [f"gyro#{k}" for k in (1, 2, 3)]
    assert is_right(table(tmp_path, columns, columns=names, units="dps"))


DAY_US = 86_400_000_000
LATE = pd.Timestamp("2024-05-01T23:59:58.5") + pd.to_timedelta(TIMES_S, unit="s")
TIMES = {
    "points of time": pa.array(US, pa.timestamp("us", tz="UTC")),
    "durations": pa.array(US, pa.duration("us")),
    "times of day": pa.array(US, pa.time64("us")),
    "times of day in ms": pa.array((US // 1000).astype(np.int32), pa.time32("ms")),
    "times of day over midnight": pa.array((DAY_US - 1_500_000 + US) % DAY_US, pa.time64("us")),
    "texts": pa.array([one.isoformat() for one in LATE]),
    "large texts": pa.array([one.isoformat() + "Z" for one in LATE], pa.large_string()),
    "categories": pa.array([one.isoformat() for one in LATE]).dictionary_encode(),
    "texts of day": pa.array([one.strftime("%H:%M:%S.%f") for one in LATE]),
}


@pytest.mark.parametrize("kind", TIMES)
@pytest.mark.parametrize("name", ["time", "logged"])
def test_times_of_any_kind(kind: str, name: str, tmp_path: Path) -> None:
    assert is_right(table(tmp_path, {name: TIMES[kind], **NAMED}))


def test_texts_that_are_no_times_stay_refused(tmp_path: Path) -> None:
    columns = {"time": ["a:b"] * N, **NAMED}
    assert "time: holds string, no numbers" in refusal(tmp_path, columns)
    mixed = [one.isoformat() for one in LATE]
    mixed[200:] = ["?"] * 100
    assert table(tmp_path, {"time": mixed, **NAMED}).samples == 200


BARE = pd.DataFrame(DPS, columns=["gx", "gy", "gz"])


def attributes(folder: Path, said: dict[str, Any], **how: Any) -> Stored:
    frame = BARE.copy()
    frame.attrs = said
    frame.to_parquet(folder / "rest.parquet")
    return open_here("parquet", folder / "rest.parquet", **how)


def test_attributes_of_pandas_are_stated(tmp_path: Path) -> None:
    said = {"units": "deg/s", "fs": 100}
    assert is_right(attributes(tmp_path, said))
    with pytest.raises(UsageError, match="--units rad/s says otherwise"):
        attributes(tmp_path, said, units="rad/s")
    with pytest.raises(UsageError, match="fs says 100 Hz, and --rate says 200 Hz"):
        attributes(tmp_path, said, rate_hz=200.0)


@pytest.mark.parametrize(
    "said",
    [
        {"units": "deg/s", "sample_rate": "100 Hz"},
        {"gyro_units": "deg/s", "fs": "100"},
        {"imu": json.dumps({"gyro": {"unit": "deg/s"}, "fs": 100})},
    ],
)
def test_metadata_of_a_file_are_stated(said: dict[str, str], tmp_path: Path) -> None:
    made = pa.table({name: BARE[name] for name in BARE}).replace_schema_metadata(said)
    assert is_right(table(tmp_path, made))


def test_metadata_of_a_column_are_stated(tmp_path: Path) -> None:
    kind = pa.struct([pa.field(axis, pa.float64()) for axis in "xyz"])
    fields = [
        pa.field("t", pa.float64(), metadata={"unit": "ms"}),
        pa.field("angular_velocity", kind, metadata={"unit": "deg/s"}),
    ]
    made = pa.table([pa.array(TIMES_S * 1e3), LISTS["structures"]], schema=pa.schema(fields))
    assert is_right(table(tmp_path, made))


def test_a_scale_that_a_column_states_is_asked_for(tmp_path: Path) -> None:
    fields = [
        pa.field(axis, pa.int32(), metadata={"scale": "0.001"}) for axis in ("gx_dps", "gy_dps", "gz_dps")
    ]
    counts = [pa.array(np.rint(DPS[:, k] * 1000).astype(np.int32)) for k in range(3)]
    text = refusal(tmp_path, pa.table(counts, schema=pa.schema(fields)), rate_hz=RATE_HZ)
    assert "gx_dps@scale 0.001" in text
