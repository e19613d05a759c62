"""Tests that files written by `identify` can be read by pyarrow, polars and pandas, as tables or as
documents.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import polars as pl
import pyarrow.csv
import pyarrow.json
import pyarrow.parquet
import pytest
from fltea.api.recording import open as open_recording

from tests.rig.host_support import fltea_here

AXES = ("gyro_x", "gyro_y")
MODELS = ("--export-model", "--gauss-markov")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write a recording of white noise and a relaxation, and all files that are made from it."""
    where = tmp_path_factory.mktemp("others")
    rng = np.random.default_rng(1)
    y = rng.normal(0.3, 0.1, (12_000, 2))
    y[:, 1] += np.convolve(rng.normal(0, 0.03, 12_999), 0.95 ** np.arange(1000), "valid")
    np.savez(where / "rest.npz", gyro_dps=y, fs_hz=100.0)
    written = [word for flag in MODELS for word in (flag, where / f"{flag[2:]}.json")]
    done = fltea_here(
        "identify", where / "rest.npz", "--json", "--forecast", "--shuffles", "0", "--jobs", "1", *written
    )
    assert (done.returncode, done.stderr) == (0, "")
    (where / "identify.json").write_text(done.stdout)
    for what in ("samples", "corrected"):
        export = "export", where / "rest.npz", "--to", where / f"{what}.csv", "--what", what
        assert fltea_here(*export).returncode == 0
    open_recording(where / "rest.npz").to_parquet(where / "rest.parquet")
    return where


@pytest.mark.parametrize("name", ["identify.json", *(f"{flag[2:]}.json" for flag in MODELS)])
def test_a_document(name: str, folder: Path) -> None:
    """The JSON file can be read as one object, even if its axes have different fields."""
    text = (folder / name).read_text()
    expected: dict[str, Any] = json.loads(text)
    parse = pyarrow.json.ParseOptions(newlines_in_values=True)
    arrow = pyarrow.json.read_json(folder / name, parse_options=parse)
    assert arrow.num_rows == 1
    assert set(arrow.column_names) == set(expected)
    frame = pl.read_json(folder / name)
    assert (frame.height, set(frame.columns)) == (1, set(expected))
    assert set(pd.json_normalize(expected, max_level=0).columns) == set(expected)
    axes = (
        arrow.column("files")[0].as_py()[0]["axes"]
        if "files" in expected
        else arrow.column("axes")[0].as_py()
    )
    assert set(axes) == set(AXES)


def test_the_filters_of_the_axes_are_a_table(folder: Path) -> None:
    """The filters of all axes have one shape: no number is null, and each has the same keys."""
    axes = json.loads((folder / "gauss-markov.json").read_text())["axes"]
    table = pd.DataFrame({name: axis["filter"] for name, axis in axes.items()}).T
    assert list(table.index) == list(AXES)
    numbers = table[["N", "K", "bias", "bias_std"]].astype(float)
    assert np.isfinite(numbers.to_numpy()).all()
    # a filter has a state for each relaxation of the noise (none, and one), and perhaps another for the
    # offset
    for states, least in zip(table.gauss_markov, (0, 1), strict=True):
        assert len(states) >= least
    assert pl.DataFrame([axis["filter"] for axis in axes.values()]).height == 2


@pytest.mark.parametrize("what", ["samples", "corrected"])
def test_a_table_of_text(what: str, folder: Path) -> None:
    path = folder / f"{what}.csv"
    table = pd.read_csv(path)
    frame = pl.read_csv(path, infer_schema_length=None)
    arrow = pyarrow.csv.read_csv(path)
    assert len(table) == frame.height == arrow.num_rows == 12_000
    assert list(table.columns) == frame.columns == arrow.column_names


def test_a_table_of_parquet(folder: Path) -> None:
    path = folder / "rest.parquet"
    table, frame, arrow = pd.read_parquet(path), pl.read_parquet(path), pyarrow.parquet.read_table(path)
    assert len(table) == frame.height == arrow.num_rows == 12_000
    with np.load(folder / "rest.npz") as rest:
        name = next(one for one in frame.columns if "gyro_y" in one)
        np.testing.assert_array_equal(frame[name].to_numpy(), rest["gyro_dps"][:, 1])
