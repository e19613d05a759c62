"""Arrays in .npy files and tables in Parquet files give the same columns, times and gaps as text."""

import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from fltea.recording.files import Stored
from fltea.recording.npy_file import open_npy
from fltea.recording.reader_process import open_in_process
from fltea.records.errors import UsageError
from fltea.settings.how import How
from fltea.settings.limits import DEFAULT_LIMITS, Limits
from fltea.sources.replay import ReplaySource
from pyarrow import parquet

from tests.rig.blocks import samples_of

N = 300
TIMES_S = np.arange(N) / 100
GYRO = np.random.default_rng(1).normal(size=(N, 3))
ACCEL = GYRO + 9.81


def npy(folder: Path, array: np.ndarray, **how: object) -> Stored:
    np.save(folder / "rest.npy", array)
    return open_npy(folder / "rest.npy", How(**how))  # type: ignore[arg-type]


def table(folder: Path, columns: dict[str, object], **how: object) -> Stored:
    parquet.write_table(pa.table(columns), folder / "rest.parquet", row_group_size=128)
    return open_parquet(folder / "rest.parquet", How(**how))  # type: ignore[arg-type]


def open_parquet(path: Path, how: How, limits: Limits = DEFAULT_LIMITS) -> Stored:
    return open_in_process("parquet", path, how, limits)


def refusal(read, *arguments: object, **how: object) -> str:
    with pytest.raises(UsageError) as caught:
        read(*arguments, **how)
    return str(caught.value)


@pytest.mark.parametrize(
    ("array", "how", "axes"),
    [
        (GYRO, {"rate_hz": 100.0}, [0, 1, 2]),
        (GYRO[:, 0], {"rate_hz": 100.0}, [0]),
        (np.asfortranarray(GYRO[:, :2]), {"rate_hz": 100.0}, [0, 1]),
        (np.c_[TIMES_S, GYRO], {"time_column": "1"}, [0, 1, 2]),
        (np.c_[ACCEL, GYRO], {"rate_hz": 100.0, "columns": ["4", "5", "6"]}, [0, 1, 2]),
        (
            np.c_[TIMES_S * 1e3, ACCEL, GYRO],
            {"time_column": "1", "time_unit": "ms", "columns": ["7", "5"]},
            [2, 0],
        ),
    ],
    ids=["three axes", "one axis", "columns first", "times", "of six", "times and six"],
)
def test_npy(array: np.ndarray, how: dict[str, object], axes: list[int], tmp_path: Path) -> None:
    found = npy(tmp_path, array, units="dps", **how)
    assert found.rate_hz == pytest.approx(100.0)
    assert found.whole().gyro.tolist() == GYRO[:, axes].tolist()
    assert found.whole().device_s == pytest.approx(TIMES_S)


def test_npy_with_fields_is_read_by_their_names(tmp_path: Path) -> None:
    array = np.zeros(N, dtype=[("time_us", "<u8"), ("gz", "<f4"), ("gx", "<f4"), ("state", "<U3")])
    array["time_us"] = np.arange(N) * 10_000
    array["gx"] = GYRO[:, 0]
    found = npy(tmp_path, array, units="rad/s")
    assert found.rate_hz == pytest.approx(100.0)
    assert found.whole().gyro[:, 0] == pytest.approx(np.degrees(GYRO[:, 0]), rel=1e-6)
    assert "nothing says the unit of 1, 2, 3." in refusal(npy, tmp_path, GYRO, rate_hz=1.0)
    assert "state: holds other things, not one number in each row" in refusal(
        npy, tmp_path, array, columns=["state"], units="dps"
    )


@pytest.mark.parametrize("lacking", [1, 24, 24 * 100 + 3])
def test_the_whole_rows_of_a_cut_npy_are_read(lacking: int, tmp_path: Path) -> None:
    path = tmp_path / "a.npy"
    np.save(path, GYRO)
    path.write_bytes(path.read_bytes()[:-lacking])
    found = open_npy(path, How(units="dps", rate_hz=100.0))
    rows = N - -(-lacking // 24)
    assert found.whole().gyro.tolist() == GYRO[:rows].tolist()
    assert [note.text for note in found.notes] == [
        f"{path}: is cut off: {rows} of {N} rows are whole, and are read."
    ]


@pytest.mark.parametrize(("order", "left"), [("F", 2000), ("C", 10)])
def test_a_cut_npy_without_a_whole_row_says_that_it_is_cut(order: str, left: int, tmp_path: Path) -> None:
    path = tmp_path / "a.npy"
    np.save(path, np.asarray(GYRO, order=order))  # type: ignore[call-overload]
    path.write_bytes(path.read_bytes()[: 128 + left])
    with pytest.raises(
        UsageError, match=r"a\.npy: cannot be read as \.npy \(it is cut off, and .* copy it again"
    ):
        open_npy(path, How(units="dps", rate_hz=100.0))


ALONE = 0.02 * GYRO + [0.1, -0.2, 9.81]

BAD_NPY = {
    "accelerations": (ALONE, {"rate_hz": 1.0}, "1, 2, 3 have the length 9.8"),
    "six columns": (
        np.c_[GYRO, ACCEL],
        {"rate_hz": 1.0},
        "nothing says which columns are the gyroscope's axes",
    ),
    "no rate": (GYRO, {}, "nothing says the rate, as there is no column of times"),
    "transposed": (GYRO.T, {"rate_hz": 1.0}, "save its transpose"),
    "three dimensions": (GYRO[None], {"rate_hz": 1.0}, "has the shape (1, 300, 3)"),
    "nothing": (GYRO[:0], {"rate_hz": 1.0}, "has the shape (0, 3)"),
    "text": (np.array(["a", "b"]), {"rate_hz": 1.0}, "not a type of numbers"),
    "objects": (np.array([None, 1]), {"rate_hz": 1.0}, "cannot be read as .npy"),
    "complex": (GYRO * 1j, {"rate_hz": 1.0}, "not a type of numbers"),
    "infinity": (
        GYRO * [1, np.inf, 1],
        {"rate_hz": 1.0},
        "row 0: column 2 is empty",
    ),
    "too large": (GYRO + 1e9, {"rate_hz": 1.0}, "row 0: more than 1e+06 deg/s"),
    "times in ms": (np.c_[TIMES_S * 1e3, GYRO], {"time_column": "1"}, "--time-unit ms: 100 Hz"),
    "no such column": (GYRO, {"columns": ["4"], "rate_hz": 1.0}, "no column 4"),
}


@pytest.mark.parametrize("name", BAD_NPY)
def test_bad_npy(name: str, tmp_path: Path) -> None:
    array, how, reason = BAD_NPY[name]
    assert reason in refusal(npy, tmp_path, array, units="dps", **how)


ROS = pa.StructArray.from_arrays([pa.array(column) for column in GYRO.T], ["x", "y", "z"])


@pytest.mark.parametrize(
    ("columns", "how"),
    [
        ({"time_s": TIMES_S, **{f"gyro_{a}_dps": GYRO[:, i] for i, a in enumerate("xyz")}}, {}),
        (
            {"t": np.arange(N) * 10, "note": ["a"] * N, "w": GYRO[:, 0], "wx [dps]": GYRO[:, 0]},
            {"time_unit": "ms"},
        ),
        ({"angular_velocity": ROS}, {"rate_hz": 100.0, "units": "dps"}),
        (
            {
                "index": pa.array(1_700_000_000_000_000_000 + np.arange(N) * 10_000_000, pa.timestamp("ns")),
                "gx": pa.array(GYRO[:, 0].astype(np.float32)),
            },
            {"units": "dps"},
        ),
    ],
    ids=["ours", "ms", "structures", "time stamps"],
)
def test_parquet(columns: dict[str, object], how: dict[str, object], tmp_path: Path) -> None:
    found = table(tmp_path, columns, **how)
    assert found.rate_hz == pytest.approx(100.0)
    gyro = found.whole().gyro
    assert gyro == pytest.approx(GYRO[:, : gyro.shape[1]], rel=1e-6)
    assert found.whole().device_s == pytest.approx(TIMES_S)


def test_what_is_null_or_nan_is_missing(tmp_path: Path) -> None:
    values = [1.0, None, float("nan"), 2.0]
    for found in (
        table(tmp_path, {"gyro_x_dps": values}, rate_hz=10.0),
        npy(tmp_path, np.array(values, dtype=float), rate_hz=10.0, units="dps"),
    ):
        whole = found.whole()
        assert (whole.seq.tolist(), whole.gyro.tolist()) == ([0, 3], [[1.0], [2.0]])
        assert "row 1: the first of 2 rows (of 4)" in found.notes[0].text


@pytest.mark.slow
def test_bad_parquet(tmp_path: Path) -> None:
    gx = {"gyro_x_dps": GYRO[:, 0]}
    assert "nothing says which columns are the gyroscope's axes" in refusal(
        table, tmp_path, {"a": TIMES_S}, rate_hz=1.0
    )
    assert "gx: holds string, no numbers" in refusal(table, tmp_path, {"gx": ["a"]}, rate_hz=1.0, units="dps")
    assert "time_s: holds string, no numbers" in refusal(table, tmp_path, {"time_s": ["a"] * N, **gx})
    stored = table(tmp_path, {"time_s": [*TIMES_S[:-1], 1.0], **gx})
    assert "column 'time_s' runs backwards 1 times; a new run begins at each" in stored.notes[0].text
    table(tmp_path, gx, rate_hz=100.0)
    path = tmp_path / "rest.parquet"
    assert "replay.max_mb=1" in refusal(open_parquet, path, How(rate_hz=1.0), Limits(max_mb=0.001))
    data = path.read_bytes()
    for damaged in (data[:-9], data[:100], b"", b"PAR1", data[:-8] + b"\xff\xff\xff\x7fPAR1"):
        path.write_bytes(damaged)
        assert "cannot be read as Parquet (" in refusal(open_parquet, path, How(rate_hz=1.0))


@pytest.mark.slow
def test_tables_are_replayed(tmp_path: Path) -> None:
    table(tmp_path, {"gyro_x_dps": GYRO[:, 0]}, rate_hz=100.0)
    npy(tmp_path, GYRO, rate_hz=100.0, units="dps")
    how = How(rate_hz=100.0, units="dps")
    for name in ("rest.parquet", "rest.npy"):
        source = ReplaySource(tmp_path / name, how=how, shuffle=1)
        mixed = [sample.gyro[0] for sample in samples_of(source.events())]
        bare = (tmp_path / name).rename(tmp_path / "bare")
        straight = [sample.gyro[0] for sample in samples_of(ReplaySource(bare, how=how).events())]
        assert straight == GYRO[:, 0].tolist() == sorted(mixed, key=straight.index) != mixed


@pytest.mark.slow
def test_parquet_without_its_library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    table(tmp_path, {"gyro_x_dps": GYRO[:, 0]}, rate_hz=100.0)
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(UsageError, match=r"Parquet files need the package pyarrow.*\[tables\]"):
        ReplaySource(tmp_path / "rest.parquet", how=How(rate_hz=100.0))
