"""Tests that temporary files are removed however their process ends.

If the disk of temporary files is full, the message does not blame the recording.
"""

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from fltea.records import temporary
from fltea.records.errors import UsageError
from fltea.records.temporary import TemporaryFailed, nameless_file, work_folder
from fltea.records.whole_file import prepare_folder

from tests.rig.bag_support import even, write_bag

HELD = """
import os, sys
from fltea.records.temporary import named_file, nameless_file, work_folder
with work_folder() as outer, work_folder() as folder, named_file(folder / "recording.csv") as file:
    nameless_file().write(b"5678")
    file.write(b"1234")
    file.flush()
    print(folder, flush=True)
    os.kill(os.getpid(), int(sys.argv[1]))
"""


@pytest.fixture
def temporary_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setenv("TMPDIR", str(folder))
    monkeypatch.setattr("tempfile.tempdir", str(folder))
    return folder


def end_by(number: int) -> str:
    found = subprocess.run([sys.executable, "-c", HELD, str(int(number))], capture_output=True, text=True)
    assert found.returncode == -number
    return found.stdout.strip()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_signals_that_end_a_process_leave_nothing(number: signal.Signals, temporary_folder: Path) -> None:
    assert end_by(number)
    assert not [*temporary_folder.iterdir()]


def test_what_a_killed_process_left_goes_with_the_next(temporary_folder: Path) -> None:
    left = Path(end_by(signal.SIGKILL))
    assert (left / "recording.csv").read_bytes() == b"1234"
    assert len([*temporary_folder.iterdir()]) == 2
    (temporary_folder / "another-x").mkdir()
    young = temporary_folder / f"{temporary.NEW_PREFIX}x"
    young.mkdir()
    old = temporary_folder / f"{temporary.NEW_PREFIX}y"
    old.mkdir()
    os.utime(old, (1, 1))
    with work_folder() as one:
        (temporary_folder / f"{temporary.PREFIX}link").symlink_to(one)
        assert {*temporary_folder.glob("fltea-*")} == {
            one,
            young,
            temporary_folder / f"{temporary.PREFIX}link",
        }
        with work_folder() as other:
            assert one.exists()
            assert other != one
    assert sorted(path.name for path in temporary_folder.iterdir()) == [
        "another-x",
        young.name,
        f"{temporary.PREFIX}link",
    ]


FORKED = """
import os, signal
from fltea.records.temporary import process_folder, work_folder
folder, used = process_folder(), work_folder()
used.__enter__()
for end in (lambda: os.kill(os.getpid(), signal.SIGTERM), exit):
    if not os.fork():
        end()
    os.wait()
    print(folder.exists())
"""


def test_a_forked_process_leaves_the_folder_of_its_parent(temporary_folder: Path) -> None:
    found = subprocess.run([sys.executable, "-c", FORKED], capture_output=True, text=True)
    assert found.stdout.splitlines() == ["True", "True"], found
    assert not [*temporary_folder.iterdir()]


def test_a_file_without_a_name_also_cleans_up(temporary_folder: Path) -> None:
    end_by(signal.SIGKILL)
    temporary._remove_left_once.cache_clear()
    with nameless_file() as file:
        assert not [*temporary_folder.iterdir()]
        file.write(b"1234")
        file.seek(1)
        assert file.read() == b"234"


FULL = """
import resource, sys
from pathlib import Path
from fltea.records.errors import FlteaError
from fltea.records.temporary import named_file, work_folder
from fltea.sources.replay import ReplaySource
resource.setrlimit(resource.RLIMIT_FSIZE, (8192, 8192))
def packed(path):
    with work_folder() as folder, named_file(folder / "a") as file:
        file.write(bytes(9000))
for read, path in ((ReplaySource, "a.bag"), (ReplaySource, "a.npz"), (packed, "")):
    try:
        read(Path(path))
    except FlteaError as error:
        print(type(error).__name__, error)
"""
"""A program that reads a recording while no file may grow over 8 kB, which acts like a full disk."""


def test_a_recording_that_finds_no_room_is_not_to_blame(tmp_path: Path, temporary_folder: Path) -> None:
    gyro = np.random.default_rng(1).integers(-99, 99, (3000, 3)).astype(np.int16)
    write_bag(tmp_path / "a.bag", {"/imu": even(2000)})
    np.savez(tmp_path / "a.npz", gyro_raw=gyro, fs_hz=100.0, lsb_per_dps=131.0)
    found = subprocess.run([sys.executable, "-c", FULL], cwd=tmp_path, capture_output=True, text=True)
    said = rf"TemporaryFailed {temporary_folder}\S*: the folder for temporary files is full .*TMPDIR\."
    lines = found.stdout.splitlines()
    assert len(lines) == 3, found
    assert all(re.fullmatch(said, line) for line in lines), lines
    assert not [*temporary_folder.iterdir()]


def test_a_folder_that_is_not_there(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "gone"))
    with pytest.raises(TemporaryFailed, match="gone: the folder for temporary files cannot be used"):
        nameless_file()
    with pytest.raises(TemporaryFailed, match="gone: the folder"), work_folder():
        pass
    (tmp_path / "file").touch()
    with pytest.raises(UsageError, match=r"--report .*file: cannot be written to \(it is a file"):
        prepare_folder("--report", tmp_path / "file")
