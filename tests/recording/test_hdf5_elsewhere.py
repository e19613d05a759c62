"""HDF5 files may refer to data in other files. The other files are not read, and the message says so."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from fltea.recording.readers import hdf5
from fltea.records.errors import UsageError
from fltea.sources.replay import ReplaySource

ROWS = 300
GYRO = np.random.default_rng(1).normal(size=(ROWS, 3))


def external(file: Any, name: str, other: Path) -> None:
    file.create_dataset(name, (ROWS, 3), "f8", external=[(str(other), 0, h5py.h5f.UNLIMITED)])


def virtual(file: Any, name: str, other: Path) -> None:
    layout = h5py.VirtualLayout((ROWS, 3), "f8")
    layout[:] = h5py.VirtualSource(str(other), "gyro", (ROWS, 3))
    file.create_virtual_dataset(name, layout)


def link(file: Any, name: str, other: Path) -> None:
    file[name] = h5py.ExternalLink(str(other), "gyro")


def link_by_way(file: Any, name: str, other: Path) -> None:
    file["others/first"] = h5py.ExternalLink(str(other), "/")
    file[name] = h5py.SoftLink("/others/first/gyro")


def link_by_two_ways(file: Any, name: str, other: Path) -> None:
    """The first of two links within the file leads to the second, and that to the other file."""
    file["far/second"] = h5py.ExternalLink(str(other), "gyro")
    file["first"] = h5py.SoftLink("/far/second")
    file[name] = h5py.SoftLink("/first")


def link_by_groups(file: Any, name: str, other: Path) -> None:
    """A link leads to a path whose groups are links in turn."""
    file["others/first"] = h5py.ExternalLink(str(other), "/")
    file["near"] = h5py.SoftLink("/others")
    file[name] = h5py.SoftLink("near/first/gyro")


KINDS: dict[str, tuple[Callable[..., None], str]] = {
    "external storage": (external, r"gyro_x_dps: is stored in other files \("),
    "virtual": (
        virtual,
        r"gyro_x_dps: is composed of other data sets \(.*\), which may be missing",
    ),
    "link": (link, r"gyro_dps is a link to another file \(\S*other\.h5\)"),
    "link by way": (link_by_way, r"gyro_dps is a link to another file"),
    "link by two ways": (link_by_two_ways, r"gyro_dps is a link to another file \(\S*other\.h5\)"),
    "link by groups": (link_by_groups, r"gyro_dps is a link to another file \(\S*other\.h5\)"),
}


@pytest.fixture
def other(tmp_path: Path) -> Path:
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["gyro"] = GYRO
    return tmp_path / "other.h5"


def refusal(path: Path) -> str:
    with pytest.raises(UsageError) as caught:
        ReplaySource(path)
    return str(caught.value)


@pytest.mark.parametrize("kind", KINDS)
def test_a_gyroscope_elsewhere_is_refused(kind: str, tmp_path: Path, other: Path) -> None:
    write, said = KINDS[kind]
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["time_s"] = np.arange(ROWS) / 100
        write(file, "gyro_dps", other)
    with pytest.raises(UsageError, match=said + ".*copy it into"):
        ReplaySource(tmp_path / "a.h5")


def test_a_pipe_is_not_opened(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["time_s"] = np.arange(ROWS) / 100
        external(file, "gyro_dps", tmp_path / "pipe")
    assert "is stored in other files" in refusal(tmp_path / "a.h5")


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_no_gyroscopes_does_not_stop_the_rest(kind: str, tmp_path: Path, other: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["time_s"], file["gyro_dps"] = np.arange(ROWS) / 100, GYRO
        KINDS[kind][0](file, "picture", other)
    found = hdf5.read(tmp_path / "a.h5", "")
    assert "gyro_dps" in found.arrays
    assert any("picture is a link to another file" in note.text for note in found.notes) == ("link" in kind)


@pytest.mark.parametrize("kind", KINDS)
def test_parts_of_a_table_of_pandas(kind: str, tmp_path: Path, other: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        group = file.create_group("imu")
        group.attrs["pandas_type"] = "frame"
        group.attrs["nblocks"] = 1
        group["axis1"] = np.arange(ROWS)
        group["block0_items"] = [b"gyro_x_dps", b"gyro_y_dps", b"gyro_z_dps"]
        group["block0_values"] = GYRO
    hdf5.read(tmp_path / "a.h5", "")
    with h5py.File(tmp_path / "a.h5", "a") as file:
        del file["imu/block0_values"]
        KINDS[kind][0](file, "imu/block0_values", other)
    with pytest.raises(UsageError, match=r"imu: its part block0_values (is|stands)"):
        hdf5.read(tmp_path / "a.h5", "")


def test_links_that_lead_to_each_other_lead_nowhere(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        file["time_s"], file["gyro_dps"] = np.arange(ROWS) / 100, GYRO
        file["a"], file["b"] = h5py.SoftLink("/b/c"), h5py.SoftLink("/a/c")
    assert "gyro_dps" in hdf5.read(path, "").arrays


def test_a_group_that_only_says_it_is_a_table_of_pandas(tmp_path: Path) -> None:
    """An HDF5 group claims to be a table of pandas, but lacks the fields and the attributes that PyTables
    writes.
    """
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        file.create_group("imu").attrs["pandas_type"] = "frame_table"
        file["imu/table"] = GYRO
    assert "the table of pandas has no fields" in refusal(path)
