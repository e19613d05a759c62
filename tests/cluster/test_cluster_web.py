"""Recordings on web servers that state no size or a false one, and cloud storage without its package."""

import contextlib
import os
import re
import shutil
import ssl
import subprocess
import sys
from collections.abc import Iterator
from functools import partial
from http.server import BaseHTTPRequestHandler, SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import numpy as np
import pytest
from fltea.cluster import listing
from fltea.cluster.listing import files_of
from fltea.cluster.run import run
from fltea.cluster.whole import identify_file
from fltea.identification.workers import Here
from fltea.records.errors import FlteaError, UsageError
from fltea.settings.how import How
from fltea.settings.limits import Limits

from tests.rig.cluster_support import ASK, identified, open_table, rows_in, web_server
from tests.rig.identify_support import white
from tests.rig.mosquitto_support import make_authority

CHUNK = bytes(1 << 20)
MOST_CHUNKS = 64
"""Largest number of chunks of an endless answer, so that even a failing test ends."""
ROOM_BYTES = 8_000_000


class Endless(BaseHTTPRequestHandler):
    """A server that sends zeros until the client leaves, and does not support requests for ranges of bytes.

    `declared`: the size that the server states; None: it states none. `silent`: whether it stops after one
    byte.
    """

    def __init__(self, declared: int | None, silent: bool, sent: list[int], *arguments: object) -> None:
        self._declared, self._silent, self._sent = declared, silent, sent
        super().__init__(*arguments)  # type: ignore[arg-type]

    def log_message(self, format: str, *args: object) -> None:
        pass

    def do_HEAD(self) -> None:
        self._head(self._declared)

    def do_GET(self) -> None:
        self._head(self._declared if self._silent else None)
        if self._silent:
            self.wfile.write(b"1")
            self.rfile.read()  # this waits until the client closes the connection
            return
        with contextlib.suppress(OSError):
            for _ in range(MOST_CHUNKS):
                self.wfile.write(CHUNK)
                self._sent[0] += len(CHUNK)

    def _head(self, declared: int | None) -> None:
        self.send_response(200)
        self.send_header("Accept-Ranges", "none")
        if declared is not None:
            self.send_header("Content-Length", str(declared))
        self.end_headers()


@contextlib.contextmanager
def endless(declared: int | None = None, *, silent: bool = False) -> Iterator[tuple[str, list[int]]]:
    """Return the address of an endless file, and how many bytes of it were sent."""
    sent = [0]
    with web_server(partial(Endless, declared, silent, sent)) as server:
        yield f"http://127.0.0.1:{server.server_port}/a.csv", sent


def failure_of(url: str, out: Path) -> dict[str, Any]:
    """Identify a file that fails, check that the next run would try it again, and return its row."""
    with open_table(out) as table:
        assert run(list(files_of([url])), ASK, Here(), table).failed == 1
    (row,) = rows_in(out)
    assert row["again"]
    return row


@pytest.fixture
def disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Make the program see a small disk for temporary files."""
    folder = tmp_path / "tmp"
    folder.mkdir()

    def usage(path: Path) -> SimpleNamespace:
        used = sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())
        return SimpleNamespace(free=ROOM_BYTES - used)

    monkeypatch.setattr("tempfile.tempdir", str(folder))
    monkeypatch.setattr("fltea.cluster.fetch.LEAST_FREE", 1_000_000)
    monkeypatch.setattr(shutil, "disk_usage", usage)
    return folder


def test_a_size_nobody_knows(disk: Path, tmp_path: Path) -> None:
    """The download ends when the disk is nearly full."""
    with endless() as (url, sent):
        assert next(files_of([url])).size == -1
        row = failure_of(url, tmp_path / "v.parquet")
    assert re.match(rf"{url}: of unknown size, and after [0-9]+ MB, .* TMPDIR", row["error"])
    assert list(disk.iterdir()) == []
    assert sent[0] < MOST_CHUNKS * len(CHUNK)


def test_a_size_nobody_knows_has_a_limit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A file of unknown size is copied up to a limit, which does not depend on the size of the disk. The
    incomplete copy is deleted.
    """
    folder = tmp_path / "tmp"
    folder.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(folder))
    limited = msgspec.structs.replace(ASK, limits=Limits(max_mb=10.0))
    with endless() as (url, sent):
        (row,) = identify_file(next(files_of([url])), limited)
    text = rf"{url}: states no size, and does not end after 10 MB, .* --set replay.max_mb=\d+"
    assert re.fullmatch(text, row.error or "")
    assert list(folder.iterdir()) == []
    assert sent[0] < MOST_CHUNKS * len(CHUNK)


def test_more_than_was_stated(disk: Path, tmp_path: Path) -> None:
    with endless(1000) as (url, sent):
        row = failure_of(url, tmp_path / "v.parquet")
    assert row["error"] == f"{url}: has more than 1000 bytes now, and had 1000 when listed."
    assert list(disk.iterdir()) == []
    assert sent[0] < MOST_CHUNKS * len(CHUNK)


@pytest.mark.usefixtures("disk")
def test_more_than_fits() -> None:
    """If a file is larger than the free disk space, nothing of it is copied.

    A later run tries it again, since another worker or another TMPDIR may have enough room.
    """
    with endless(10**15) as (url, sent):
        (row,) = identify_file(next(files_of([url])), ASK)
    assert "TMPDIR" in (row.error or "")
    assert row.again
    assert sent == [0]


def test_a_server_that_says_no_more(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A server that stops sending is given up. One that keeps sending is not, even if it takes long."""
    monkeypatch.setattr(listing, "SILENT_S", 0.3)
    with endless(1000, silent=True) as (url, _):
        assert "Timeout" in failure_of(url, tmp_path / "v.parquet")["error"]
    assert listing.file_system("http").client_kwargs["timeout"].total is None


HOW = msgspec.structs.replace(ASK, how=How(rate_hz=100.0, units="deg/s"))


class Quiet(SimpleHTTPRequestHandler):
    """A server that states when a file was changed, as most do, but sends no ranges of bytes."""

    def log_message(self, format: str, *args: object) -> None:
        pass


@pytest.fixture
def files(tmp_path: Path) -> Path:
    folder = tmp_path / "web"
    (folder / "below").mkdir(parents=True)
    noise = 0.05 * white(4000, 1, 3)[0]
    np.save(folder / "a.npy", noise)
    np.save(folder / "below" / "b.npy", noise[:2000])
    return folder


@pytest.fixture
def server(files: Path) -> Iterator[ThreadingHTTPServer]:
    with web_server(partial(Quiet, directory=str(files))) as one:
        yield one


@pytest.mark.slow
def test_https_with_a_certificate_of_ones_own(
    server: ThreadingHTTPServer, files: Path, tmp_path: Path
) -> None:
    """The server's certificate is trusted if SSL_CERT_FILE names its authority.

    Otherwise nothing is read, and the reason is given.
    """
    ca = make_authority(tmp_path / "ca")
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(tmp_path / "ca/server.pem", tmp_path / "ca/server.key")
    server.socket = context.wrap_socket(server.socket, server_side=True)
    url = f"https://localhost:{server.server_port}"
    with pytest.raises(FlteaError, match=r"/a.npy: cannot be read \(.*CERTIFICATE_VERIFY_FAILED"):
        list(files_of([f"{url}/a.npy"]))
    out = tmp_path / "v.parquet"
    command = [sys.executable, "-m", "fltea", "identify", f"{url}/**/*.npy", "--out", str(out), "--jobs", "1"]
    command += ["--rate", "100", "--units", "deg/s", "--shuffles", "0"]
    done = subprocess.run(
        command, env={**os.environ, "SSL_CERT_FILE": str(ca)}, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    found = rows_in(out)
    assert [row["file"] for row in found] == [f"{url}/a.npy", f"{url}/below/b.npy"]
    assert [(row["error"], row["samples"]) for row in found] == [(None, 4000), (None, 2000)]
    assert all(row["stamp"].endswith("GMT") for row in found)


def test_a_large_file_of_a_server_without_ranges_is_read_whole(
    server: ThreadingHTTPServer, tmp_path: Path
) -> None:
    how = msgspec.structs.replace(HOW, block_bytes=10_000)
    identified(f"http://127.0.0.1:{server.server_port}/a.npy", how, tmp_path / "v.parquet", Here())
    (row,) = rows_in(tmp_path / "v.parquet")
    assert (row["error"], row["parts"], row["samples"]) == (None, 1, 4000)


def test_what_is_not_there_and_who_is_not(server: ThreadingHTTPServer) -> None:
    """A missing file is the user's mistake (a UsageError). A missing server is not, since it may be back
    later.
    """
    with pytest.raises(UsageError, match=r"none.npy: no recording is there"):
        list(files_of([f"http://127.0.0.1:{server.server_port}/none.npy"]))
    with pytest.raises(FlteaError, match=r"a.npy: cannot be read \(ClientConnectorError") as caught:
        list(files_of(["http://127.0.0.1:1/a.npy"]))
    assert not isinstance(caught.value, UsageError)


@pytest.mark.parametrize(("protocol", "package"), [("gs", "gcsfs"), ("abfs", "adlfs"), ("az", "adlfs")])
def test_a_cloud_whose_package_is_missing(
    protocol: str, package: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The package may be installed, so the test makes its import fail.

    A module that is None in sys.modules cannot be imported.
    """
    from fsspec.registry import _registry

    monkeypatch.setitem(sys.modules, package, None)
    monkeypatch.delitem(_registry, protocol, raising=False)
    text = rf"^{protocol}:// needs {package}, which is not installed .* -m pip install {package}, here and"
    with pytest.raises(UsageError, match=text):
        list(files_of([f"{protocol}://lab/a.npy"]))
    assert listing.PACKAGES[protocol] == package
