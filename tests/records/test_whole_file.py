"""Tests that files appear complete or not at all, and that writing never follows another user's link."""

import os
import signal
import stat
import subprocess
import sys
from pathlib import Path

import pytest
from fltea.records.errors import FlteaError, UsageError
from fltea.records.whole_file import text_of, whole_file


def test_it_appears_whole_and_alone(tmp_path: Path) -> None:
    out = tmp_path / "out.csv"
    with whole_file(out) as file:
        with text_of(file) as text:
            text.write("α\r\n")
        file.write(b"more")
        assert not out.exists()
    assert out.read_bytes() == "α\r\nmore".encode()
    assert [path.name for path in tmp_path.iterdir()] == ["out.csv"]


def test_after_a_failure_all_is_as_it_was(tmp_path: Path) -> None:
    out = tmp_path / "out.csv"
    out.write_text("of yesterday")
    with pytest.raises(ZeroDivisionError), whole_file(out) as file:
        file.write(b"half" * (1 // file.tell()))
    assert out.read_text() == "of yesterday"
    assert [path.name for path in tmp_path.iterdir()] == ["out.csv"]


STOPPED = """
import os, sys
from pathlib import Path
from fltea.records.temporary import work_folder
from fltea.records.whole_file import whole_file
with whole_file(Path(sys.argv[1])) as file, work_folder():
    file.write(b"half")
    file.flush()
    print(len(os.listdir(Path(sys.argv[1]).parent)), flush=True)
    os.kill(os.getpid(), int(sys.argv[2]))
"""
"""A program that is ended by a signal while it writes a file."""


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
def test_a_signal_that_ends_the_program_leaves_no_part(number: signal.Signals, tmp_path: Path) -> None:
    out = tmp_path / "out.csv"
    out.write_text("of yesterday")
    command = [sys.executable, "-c", STOPPED, str(out), str(int(number))]
    done = subprocess.run(command, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (-number, "2\n"), done.stderr
    assert out.read_text() == "of yesterday"
    assert [path.name for path in tmp_path.iterdir()] == ["out.csv"]


def test_links_of_strangers_are_not_followed(tmp_path: Path) -> None:
    """Somebody has put links at the file's name and at names that its temporary file might have. The file
    behind the links stays unchanged.
    """
    target = tmp_path / "precious"
    target.write_text("mine")
    shared = tmp_path / "shared"
    shared.mkdir()
    for name in (".out.csv.part", "out.csv.part", "out.csv"):
        (shared / name).symlink_to(target)
    with whole_file(shared / "out.csv") as file:
        file.write(b"new")
    assert target.read_text() == "mine"
    assert (shared / "out.csv").read_text() == "new"
    assert not (shared / "out.csv").is_symlink()


def test_the_name_of_the_part_cannot_be_guessed_nor_taken(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = set()
    for _ in range(20):
        with whole_file(tmp_path / "out"):
            names |= {path.name for path in tmp_path.iterdir() if path.name.endswith(".part")}
    assert len(names) == 20
    monkeypatch.setattr("secrets.token_hex", lambda n: "guessed")
    (tmp_path / ".new.guessed.part").symlink_to(tmp_path / "precious")
    with (
        pytest.raises(FlteaError, match=r"new: cannot be written \(File exists\)"),
        whole_file(tmp_path / "new"),
    ):
        pass
    assert not (tmp_path / "precious").exists()
    assert (tmp_path / ".new.guessed.part").is_symlink()  # the other user's link stays as it is


def test_it_is_on_the_disk_before_it_has_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []
    fsync, replace = os.fsync, os.replace
    monkeypatch.setattr(os, "fsync", lambda fd: calls.append(("fsync", os.fstat(fd).st_size)) or fsync(fd))
    monkeypatch.setattr(os, "replace", lambda a, b: calls.append(("replace", 0)) or replace(a, b))
    with whole_file(tmp_path / "out") as file:
        file.write(b"1234")
    assert calls == [("fsync", 4), ("replace", 0)]


def test_names_as_long_as_can_be_and_rights_as_usual(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        for name in ("n" * 255, "α" * 127):
            with whole_file(tmp_path / name) as file:
                file.write(b"x")
            assert stat.S_IMODE((tmp_path / name).stat().st_mode) == 0o640
    finally:
        os.umask(before)


def test_what_is_no_file_is_not_replaced(tmp_path: Path) -> None:
    """If the name belongs to a pipe, a folder or a device, it is not replaced. Otherwise root could replace a
    device such as /dev/null by a file.
    """
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    for name in ("pipe", "folder"):
        kind = stat.S_IFMT((tmp_path / name).stat().st_mode)
        with pytest.raises(UsageError, match="cannot be written"), whole_file(tmp_path / name):
            pytest.fail("it was begun")
        assert stat.S_IFMT((tmp_path / name).stat().st_mode) == kind
    assert len(list(tmp_path.iterdir())) == 2


@pytest.mark.parametrize("name", ["no/such/folder", "a\0b", "", "/proc/out"])
def test_places_that_cannot_be(name: str, tmp_path: Path) -> None:
    with pytest.raises(FlteaError, match="cannot be written"), whole_file(tmp_path / name) as file:
        file.write(b"x")
