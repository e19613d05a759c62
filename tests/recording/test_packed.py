"""Packed text, archives with several files, libraries that are not there, and topics of PX4."""

import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from blocks import samples_of
from corpus_files import HERE, N, text
from fltea.recording.apart import LIBRARIES
from fltea.records.errors import UsageError
from fltea.records.events import Trouble
from fltea.settings.how import How
from fltea.sources.replay import ReplaySource


def archive(path: Path, **files: bytes) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as out:
        for name, data in files.items():
            out.writestr(f"{name}.csv", data)
    return path


@pytest.mark.parametrize("name", ["plain.csv.gz", "plain.csv.xz"])
def test_what_is_cut_off_is_read_as_far_as_it_goes(name: str, tmp_path: Path) -> None:
    data = (HERE / name).read_bytes()
    (tmp_path / name).write_bytes(data[: len(data) * 3 // 4])
    events = list(ReplaySource(tmp_path / name).events())
    assert 20 < len(samples_of(events)) < N
    assert "is cut off; what can be unpacked is read" in next(
        e.message for e in events if isinstance(e, Trouble)
    )
    (tmp_path / name).write_bytes(data[:40] + bytes(len(data) - 40))
    with pytest.raises(UsageError, match=r"cannot be (unpacked|read)"):
        ReplaySource(tmp_path / name)


def test_of_an_archive_the_file_of_the_gyroscope_is_read(tmp_path: Path) -> None:
    plain = text("plain.csv")
    path = archive(tmp_path / "a.zip", Accelerometer=b"time,x\n0,1\n", MyGyro=plain, Metadata=b"a\n")
    assert len(samples_of(ReplaySource(path).events())) == N
    path = archive(tmp_path / "b.zip", one=plain, two=text("iso_dates.csv"))
    with pytest.raises(
        UsageError, match=r"holds 2 files, .*\(one\.csv, two\.csv\).*: python3 -m zipfile -e (.*)"
    ) as caught:
        ReplaySource(path)
    command = str(caught.value).rpartition(": python3 ")[2].split()
    subprocess.run([sys.executable, *command], cwd=tmp_path, check=True)
    assert len(samples_of(ReplaySource(tmp_path / "one.csv").events())) == N


@pytest.mark.parametrize("kind", sorted(LIBRARIES.keys() - {"arrays", "json"}))
def test_a_library_that_is_missing_is_named_with_what_installs_it(
    kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    module, extra, name = LIBRARIES[kind]
    files = {"parquet": "pandas.parquet", "feather": "pandas.feather", "hdf5": "h5py.h5", "mat": "matlab.mat"}
    files |= {"ulg": "px4.ulg", "xlsx": "phyphox.xlsx"}
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(UsageError, match=rf"{name} files need the package {module}.*\[{extra}\]"):
        ReplaySource(HERE / files[kind])


def test_a_topic_of_px4_that_is_not_there() -> None:
    assert len(samples_of(ReplaySource(HERE / "px4.ulg", how=How(topic="sensor_combined")).events())) == N
    with pytest.raises(
        UsageError, match=r"is a PX4 log with no topic sensor_gps; name one by --topic: sensor_combined\."
    ):
        ReplaySource(HERE / "px4.ulg", how=How(topic="sensor_gps"))
