"""Copies of files whose size nobody knows, or is a lie: bounded by the worker's disk, and removed again."""

import re
import shutil
import threading
from collections.abc import Iterator
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from types import SimpleNamespace

import pytest
from cluster_support import ASK, open_table, rows_in
from fltea.cluster import listing
from fltea.cluster.listing import files_of
from fltea.cluster.run import run
from fltea.cluster.whole import identify_file
from fltea.identification.workers import Here

CHUNK = bytes(1 << 20)
MOST_CHUNKS = 64
"""Of a server that would send for ever: a test that fails ends, too."""
ROOM_BYTES = 8_000_000


class Endless(BaseHTTPRequestHandler):
    """Sends zeros until nobody listens, in no ranges. declared: the size it tells, if it tells one."""

    def __init__(self, declared: int | None, sent: list[int], *arguments: object) -> None:
        self._declared, self._sent = declared, sent
        super().__init__(*arguments)  # type: ignore[arg-type]

    def log_message(self, format: str, *args: object) -> None:
        pass

    def do_HEAD(self) -> None:
        self.send_response(200)
        self.send_header("Accept-Ranges", "none")
        if self._declared is not None:
            self.send_header("Content-Length", str(self._declared))
        self.end_headers()

    def do_GET(self) -> None:
        self.send_response(200)
        self.send_header("Accept-Ranges", "none")
        self.end_headers()
        try:
            for _ in range(MOST_CHUNKS):
                self.wfile.write(CHUNK)
                self._sent[0] += len(CHUNK)
        except OSError:
            pass


class Silent(Endless):
    """Sends one byte of a file, and no more."""

    def do_GET(self) -> None:
        self.send_response(200)
        self.send_header("Content-Length", str(self._declared))
        self.send_header("Accept-Ranges", "none")
        self.end_headers()
        self.wfile.write(b"1")
        self.rfile.read()  # until the other side has gone


@pytest.fixture
def sent() -> list[int]:
    return [0]


@pytest.fixture
def declared(request: pytest.FixtureRequest) -> int | None:
    return getattr(request, "param", None)


@pytest.fixture
def handler() -> type[Endless]:
    return Endless


@pytest.fixture
def url(handler: type[Endless], declared: int | None, sent: list[int]) -> Iterator[str]:
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(handler, declared, sent)) as one:
        one.daemon_threads = True
        thread = threading.Thread(target=one.serve_forever, args=(0.02,))
        thread.start()
        yield f"http://127.0.0.1:{one.server_port}/a.csv"
        one.shutdown()
        thread.join()


@pytest.fixture
def disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A small one for temporary files."""
    folder = tmp_path / "tmp"
    folder.mkdir()

    def usage(path: Path) -> SimpleNamespace:
        used = sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())
        return SimpleNamespace(free=ROOM_BYTES - used)

    monkeypatch.setattr("tempfile.tempdir", str(folder))
    monkeypatch.setattr("fltea.cluster.fetch.LEAST_FREE", 1_000_000)
    monkeypatch.setattr(shutil, "disk_usage", usage)
    return folder


def test_a_size_nobody_knows(url: str, sent: list[int], disk: Path, tmp_path: Path) -> None:
    """It ends when the disk is nearly full, as that file's row, and is tried again by the next run."""
    files = list(files_of([url]))
    assert files[0].size == -1
    with open_table(tmp_path / "v.parquet") as table:
        assert run(files, ASK, Here(), table).failed == 1
    (row,) = rows_in(tmp_path / "v.parquet")
    assert re.match(rf"{url}: of unknown size, and after [0-9]+ MB, .* TMPDIR", row["error"])
    assert row["again"]
    assert list(disk.iterdir()) == []
    assert sent[0] < MOST_CHUNKS * len(CHUNK)


@pytest.mark.parametrize("declared", [1000], indirect=True)
def test_more_than_was_told(url: str, sent: list[int], disk: Path) -> None:
    (file,) = files_of([url])
    assert file.size == 1000
    (row,) = identify_file(file, ASK)
    assert row.error == f"{url}: has more than 1000 bytes now, and had 1000 when listed."
    assert row.again
    assert list(disk.iterdir()) == []
    assert sent[0] < MOST_CHUNKS * len(CHUNK)


@pytest.mark.parametrize("declared", [10**15], indirect=True)
def test_more_than_fits(url: str, sent: list[int], disk: Path) -> None:
    """Nothing is copied; another worker, or another TMPDIR, may have the room."""
    (file,) = files_of([url])
    (row,) = identify_file(file, ASK)
    assert "TMPDIR" in (row.error or "")
    assert row.again
    assert sent == [0]


@pytest.mark.parametrize("declared", [1000], indirect=True)
@pytest.mark.parametrize("handler", [Silent])
def test_a_server_that_says_no_more(url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is not waited for; one that goes on sending is, however long it takes."""
    monkeypatch.setattr(listing, "SILENT_S", 0.3)
    files = list(files_of([url]))
    with open_table(tmp_path / "v.parquet") as table:
        assert run(files, ASK, Here(), table).failed == 1
    (row,) = rows_in(tmp_path / "v.parquet")
    assert "Timeout" in row["error"]
    assert row["again"]
    assert listing.file_system("http").client_kwargs["timeout"].total is None
