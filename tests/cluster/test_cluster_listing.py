"""On any file system, a pattern selects exactly the files that match it, in a fixed order."""

import itertools
import os
from pathlib import Path

import pytest
from fltea.cluster.listing import JOURNAL, MOST_LEVELS, File, Unlisted, files_of
from fltea.records.errors import FlteaError, UsageError

NAMES = (
    "a.mcap",
    "x/a.npz",
    "x/b.txt",
    "x/c.png",
    "x/y/d.mcap",
    "x/y/e",
    "z/[f].csv",
    "z/f.csv",
    "w/f?.csv",
    "t.parquet/g.parquet",
)


@pytest.fixture
def lab(tmp_path: Path) -> Path:
    for name in NAMES:
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"1234")
    (tmp_path / "t.parquet" / JOURNAL).write_bytes(b"")
    return tmp_path


@pytest.mark.parametrize(
    ("pattern", "found"),
    [
        ("", ["a.mcap", "w/f?.csv", "x/a.npz", "x/b.txt", "x/y/d.mcap", "z/[f].csv", "z/f.csv"]),
        ("x", ["x/a.npz", "x/b.txt", "x/y/d.mcap"]),
        ("**/*.mcap", ["a.mcap", "x/y/d.mcap"]),
        ("*/*.[nt]*", ["x/a.npz", "x/b.txt"]),
        ("x/?", []),
        ("x/*", ["x/a.npz", "x/b.txt", "x/c.png"]),
        ("x/*/e", ["x/y/e"]),
        ("x/c.png", ["x/c.png"]),
        ("z/[f].csv", ["z/[f].csv"]),
        ("z/[fg].csv", ["z/f.csv"]),
    ],
)
def test_patterns(lab: Path, pattern: str, found: list[str]) -> None:
    """The name of a folder stands for the recordings in the folder, and a pattern for the files that match
    it. Tables of verdicts are left out.
    """
    path = f"{lab}/{pattern}".rstrip("/")
    if not found:
        with pytest.raises(UsageError, match="no recording is there"):
            list(files_of([path]))
        return
    files = list(files_of([path]))
    assert [file.url.removeprefix(f"{lab}/") for file in files] == found
    assert {file.size for file in files} == {4}
    assert all(file.stamp for file in files)


@pytest.mark.parametrize("name", ["a.mcap", "x/link.csv"])
def test_a_file_that_changes_has_another_stamp(lab: Path, name: str) -> None:
    """If a file changes, its stamp changes, by which later runs notice the change.

    The stamp of a link to the file changes, too.
    """
    (lab / "x" / "link.csv").symlink_to(lab / "a.mcap")
    before = {file.url: file for file in files_of([str(lab)])}[f"{lab}/{name}"]
    os.utime(lab / "a.mcap", (1, 1))
    after = {file.url: file for file in files_of([str(lab)])}[f"{lab}/{name}"]
    assert before._replace(stamp="") == after._replace(stamp="")
    assert (before.size, before.stamp != after.stamp) == (4, True)


@pytest.mark.parametrize("pattern", ["q", "q/*", "q/**"])
def test_what_is_no_file_is_none(lab: Path, pattern: str) -> None:
    """Only files are listed. A pipe is not, since opening it would never return. A link to a folder is not,
    since such links may lead in circles.
    """
    (lab / "q").mkdir()
    (lab / "q" / "a.csv").write_bytes(b"1234")
    os.mkfifo(lab / "q" / "pipe.csv")
    (lab / "q" / "folder.csv").symlink_to(lab / "x")
    (lab / "q" / "circle").symlink_to(lab / "q")
    assert [file.url for file in files_of([f"{lab}/{pattern}"])] == [f"{lab}/q/a.csv"]


def test_a_folder_has_one_name(lab: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder has the same name by every path to it, including a path through a link whose target has
    another parent folder.
    """
    (lab / "link").symlink_to(lab / "x" / "y")
    monkeypatch.chdir(lab / "z")
    for pattern in ("../x/y/d.mcap", f"{lab}/z/../x/y/*.mcap", "../link/../y"):
        assert [file.url for file in files_of([pattern])] == [f"{lab}/x/y/d.mcap"]


def test_a_folder_that_may_not_be_read_or_is_gone(lab: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """If a folder may not be read, the folders after it are still listed. If the user named the unreadable
    folder itself, that is an error.
    """
    from fsspec.implementations.local import LocalFileSystem

    ls = LocalFileSystem.ls

    def some(system: LocalFileSystem, path: str, **options: object) -> object:
        if path.endswith("/x"):
            raise PermissionError(13, "Permission denied", path)
        if path.endswith("/t.parquet"):
            raise FileNotFoundError(2, "No such file or directory", path)
        return ls(system, path, **options)

    monkeypatch.setattr(LocalFileSystem, "ls", some)
    found = list(files_of([str(lab)]))
    assert [one.url for one in found if isinstance(one, File)] == [
        f"{lab}/{name}" for name in ("a.mcap", "w/f?.csv", "z/[f].csv", "z/f.csv")
    ]
    (closed,) = (one for one in found if isinstance(one, Unlisted))
    assert closed.folder.url == f"{lab}/x"
    assert closed.reason.startswith("cannot be listed (PermissionError: ")
    with pytest.raises(FlteaError, match=r"x: cannot be listed \(PermissionError"):
        list(files_of([f"{lab}/x"]))


def test_memory_holds_no_more_than_a_folder(lab: Path) -> None:
    """Files are listed as they are needed: the second folder is not listed before all files of the first one
    were used.
    """
    files = files_of([f"{lab}/**/*.*"])
    next(files)
    (lab / "z" / "new.csv").write_bytes(b"1")
    assert any(file.url.endswith("z/new.csv") for file in files)


@pytest.mark.parametrize(
    ("pattern", "text"),
    [
        ("zip::s3://lab/a.zip", "chains"),
        ("ssh://host/file.csv", "not supported"),
        ("s3://key:secret@lab/a.csv", r"^FILE: an address must not hold a user or a password"),
        ("nowhere/*.csv", "no recording is there"),
    ],
)
def test_what_is_refused(pattern: str, text: str) -> None:
    with pytest.raises(UsageError, match=text):
        list(files_of([pattern]))


class Cloud:
    """A file system that returns given file names, or raises given errors."""

    def __init__(self, error: Exception | None = None) -> None:
        self._error = error

    def _strip_protocol(self, path: str) -> str:
        return path

    def info(self, path: str) -> dict[str, object]:
        if self._error is not None:
            raise self._error
        return {"name": path, "type": "file", "size": 7, "ETag": "x"}


def test_signatures_do_not_stand_in_the_table(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fltea.cluster.listing.file_system", lambda protocol: Cloud())
    one, other = files_of(["https://host/a.csv?sign=secret", "https://host/a.csv?sign=other"])
    assert (one.path, one.suffix) == ("https://host/a.csv?sign=secret", ".csv")
    assert one.url.startswith("https://host/a.csv?…")
    assert "secret" not in one.url
    assert one.url != other.url


def test_what_a_file_system_says_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    locked = Cloud(PermissionError("no credentials"))
    monkeypatch.setattr("fltea.cluster.listing.file_system", lambda protocol: locked)
    with pytest.raises(FlteaError, match=r"s3://lab/a.csv: cannot be listed \(PermissionError: no cred"):
        list(files_of(["s3://lab/a.csv"]))


class Maze(Cloud):
    """A server that invents folders: each folder holds a recording and another folder."""

    def isfile(self, path: str) -> bool:
        return False

    def info(self, path: str) -> dict[str, object]:
        return {"name": path, "type": "directory", "size": 0}

    def ls(self, path: str, detail: bool) -> list[dict[str, object]]:
        return [self.info(f"{path}/d"), Cloud.info(self, f"{path}/a.csv")]


def test_folders_without_an_end_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """If each folder contains another one without an end, the listing ends 64 folders deep. The files found
    until then are read, and a row of the table says where the listing ended.
    """
    monkeypatch.setattr("fltea.cluster.listing.file_system", lambda protocol: Maze())
    *files, last = itertools.islice(files_of(["s3://lab"]), 1000)
    assert len(files) == MOST_LEVELS + 1
    assert isinstance(last, Unlisted)
    assert last.folder.url == "s3://lab" + "/d" * (MOST_LEVELS + 1)
    assert "64 folders deep" in last.reason


@pytest.mark.parametrize(
    ("protocol", "path", "suffix"),
    [
        ("s3", "lab/a.MCAP", ".mcap"),
        ("https", "https://x/a.csv?key=1.2", ".csv"),
        ("s3", "lab/at rest?.csv", ".csv"),
        ("s3", "a", ""),
        ("s3", "a.b/../x", ""),
        ("file", "/a.$(x)", ""),
    ],
)
def test_endings_are_letters_and_digits(protocol: str, path: str, suffix: str) -> None:
    """The ending of an address becomes part of a file name on the worker's disk, so only letters and digits
    count as an ending.

    In an address on the web, and only there, a question mark ends the name of the file.
    """
    assert File(path, protocol, path, 1, "").suffix == suffix
