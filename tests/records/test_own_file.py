"""Tests of files that the program keeps for itself.

If something else has the name of such a file, the program neither empties it nor waits for it.
"""

import os
from collections.abc import Callable
from pathlib import Path

import pytest
from fltea.cluster.listing import JOURNAL
from fltea.recording.bag_ros2 import unpacked_file
from fltea.records.errors import FlteaError, UsageError
from fltea.records.own_file import open_own
from fltea.service.state import StateFile
from fltea.settings.limits import Limits
from fltea.settings.outputs import StateConfig

from tests.rig.cluster_support import open_table

TEXT = "what somebody else wrote\n"


def _link(path: Path) -> None:
    other = path.parent / "other"
    other.write_text(TEXT)
    path.symlink_to(other)


def _hanging_link(path: Path) -> None:
    path.symlink_to(path.parent / "none")


def _hard_link(path: Path) -> None:
    other = path.parent / "other"
    other.write_text(TEXT)
    path.hardlink_to(other)


def _pipe(path: Path) -> None:
    os.mkfifo(path)


strange = pytest.mark.parametrize("put", [_link, _hanging_link, _hard_link, _pipe, Path.mkdir])


@strange
def test_what_is_no_file_is_refused_and_left_as_it_is(put: Callable[[Path], None], tmp_path: Path) -> None:
    path = tmp_path / "own"
    put(path)
    with pytest.raises(OSError, match=r"has to be a file|directory"):
        os.close(open_own(path, 0o644))
    if path.is_file():
        assert path.read_text() == TEXT
    assert not (tmp_path / "none").exists()


@pytest.mark.parametrize("append", [False, True])
def test_it_is_made_and_written_again(append: bool, tmp_path: Path) -> None:
    for text in (b"one\n", b"two\n"):
        held = open_own(tmp_path / "own", 0o640, append=append)
        os.write(held, text)
        os.close(held)
    assert (tmp_path / "own").read_bytes() == (b"one\ntwo\n" if append else b"two\n")
    assert (tmp_path / "own").stat().st_mode & 0o777 & ~0o640 == 0


@strange
def test_lock_and_journal_are_such_files(put: Callable[[Path], None], tmp_path: Path) -> None:
    """The program refuses a lock or a journal that is a link, a pipe or a folder. It neither empties the file
    behind the link nor waits for the pipe.
    """
    put(tmp_path / ".state.lock")
    with pytest.raises(UsageError, match=r"\.state\.lock"):
        StateFile(StateConfig(str(tmp_path / "state")), lambda kind, text: None)
    table = tmp_path / "v.parquet"
    table.mkdir()
    put(table / JOURNAL)
    with pytest.raises(FlteaError, match=r"cannot be written|does not belong"), open_table(table):
        pass
    assert all((folder / "other").read_text() == TEXT for folder in (tmp_path, table) if put is _link)


def test_a_packed_bag_that_is_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.db3.zstd")
    with pytest.raises(OSError, match="is a pipe"), unpacked_file(tmp_path / "a.db3.zstd", Limits()):
        pass
