"""Identification of objects (files in cloud storage) that change while they are read, and with servers or
proxies that send something else than requested.
"""

import http.client
import os
from collections.abc import Callable, Iterator
from functools import partial
from http.server import BaseHTTPRequestHandler
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import msgspec
import numpy as np
import pytest
from fltea.cluster.listing import File, files_of
from fltea.cluster.run import Progress, run
from fltea.identification.workers import Here
from fltea.settings.how import How

from tests.rig.cluster_support import ASK, identified, open_table, rows_in, s3_server, web_server
from tests.rig.identify_support import white

N = 1 << 13
WHOLE = msgspec.structs.replace(ASK, how=How(rate_hz=100.0, units="deg/s"))
PIECES = msgspec.structs.replace(WHOLE, block_bytes=8 * N // 4 + 256)
URL = "s3://lab/a.npy"
HOP = ("transfer-encoding", "connection", "content-length")

Lie = Callable[[int, bytes], tuple[int, bytes]]


def truth(status: int, data: bytes) -> tuple[int, bytes]:
    return status, data


class Between(BaseHTTPRequestHandler):
    """A proxy in front of a server. If a client requests a part of an object, the function `lie` changes the
    answer.
    """

    lie: Lie = staticmethod(truth)

    def __init__(self, server: str, *arguments: Any) -> None:
        self._server = server
        super().__init__(*arguments)

    def log_message(self, format: str, *args: object) -> None:
        pass

    def do_GET(self) -> None:
        server = http.client.HTTPConnection(self._server)
        server.request(self.command, self.path, headers=dict(self.headers))
        answer = server.getresponse()
        status, data, length = answer.status, answer.read(), answer.headers.get("Content-Length", "0")
        server.close()
        if "Range" in self.headers:
            status, data = type(self).lie(status, data)
        self.send_response(status)
        for name, value in answer.getheaders():
            if name.lower() not in HOP:
                self.send_header(name, value)
        self.send_header("Content-Length", length if self.command == "HEAD" else str(len(data)))
        self.end_headers()
        self.wfile.write(data)

    do_HEAD = do_GET


@pytest.fixture(scope="module")
def noises(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Write two recordings of the same size, of which one has a hundred times the noise of the other."""
    folder = tmp_path_factory.mktemp("noises")
    paths = [folder / "quiet.npy", folder / "loud.npy"]
    for path, size, seed in zip(paths, (0.05, 5.0), (3, 4), strict=True):
        np.save(path, size * white(N, 1, seed)[0])
    return paths


@pytest.fixture(scope="module")
def server() -> Iterator[Any]:
    with s3_server() as system:
        yield system


@pytest.fixture
def put(server: Any, noises: list[Path]) -> Callable[[int], None]:
    """Return a function that writes the first or the second recording to the same address.

    At the start, the first recording is there.
    """

    def write(which: int) -> None:
        server.put_file(noises[which], "lab/a.npy")

    write(0)
    return write


def errors_of(files: list[File], ask: Any, out: Path, **options: Any) -> list[str | None]:
    """Identify the files, and return the errors of their rows. Check that the next run would try all failed
    files again.
    """
    with open_table(out, ask.digest()) as table:
        run(files, ask, Here(), table, **options)
    found = rows_in(out)
    assert all(row["again"] == (row["error"] is not None) for row in found)
    return [row["error"] for row in found]


def test_pieces_of_two_contents_are_not_put_together(put: Callable[[int], None], tmp_path: Path) -> None:
    """Both contents have the same size, so only the server knows that the object has changed."""

    def change(progress: Progress) -> None:
        if "piece 2" in progress.now:
            put(1)

    (error,) = errors_of(list(files_of([URL])), PIECES, tmp_path / "v.parquet", report=change)
    assert error is not None
    assert error.startswith(f"piece 3 of 4: {URL}: has changed since it was listed")
    done = identified(URL, PIECES, tmp_path / "v.parquet", Here())
    (row,) = rows_in(tmp_path / "v.parquet")
    assert (done.failed, row["parts"], row["std"] > 1) == (0, 4, True)


def test_what_was_not_listed_is_not_read_in_its_place(put: Callable[[int], None], tmp_path: Path) -> None:
    files = list(files_of([URL]))
    put(1)
    (error,) = errors_of(files, WHOLE, tmp_path / "v.parquet")
    assert error is not None
    assert error.startswith(f"{URL}: has changed since it was listed")


def half(status: int, data: bytes) -> tuple[int, bytes]:
    return status, data[: len(data) // 2]


def more(status: int, data: bytes) -> tuple[int, bytes]:
    return status, data + bytes(64)


def page(status: int, data: bytes) -> tuple[int, bytes]:
    return 200, b"<html>Please log in</html>"


@pytest.mark.parametrize(("lie", "sent"), [(half, 8), (more, 80), (page, 26)])
def test_a_range_comes_whole_or_not_at_all(
    lie: Lie,
    sent: int,
    put: Callable[[int], None],
    server: Any,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A proxy cuts the answer, extends it, or sends a page of its own, and the server sends no checksums by
    which that would be noticed.
    """
    monkeypatch.setenv("AWS_RESPONSE_CHECKSUM_VALIDATION", "when_required")
    address = urlsplit(os.environ["AWS_ENDPOINT_URL"]).netloc
    with web_server(partial(Between, address)) as between, monkeypatch.context() as patch:
        patch.setenv("AWS_ENDPOINT_URL", f"http://127.0.0.1:{between.server_port}")
        # The program caches file systems. A cached one would still use the server's own address, without the
        # proxy.
        type(server).clear_instance_cache()
        patch.setattr(Between, "lie", staticmethod(lie))
        (error,) = errors_of(list(files_of([URL])), PIECES, tmp_path / "v.parquet")
    type(server).clear_instance_cache()
    assert error is not None
    assert f"{URL}: the server sent {sent} bytes where 16 were asked for" in error
