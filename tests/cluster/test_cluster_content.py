"""Files that change while they are read, and answers of web servers without an end."""

import contextlib
import os
import re
from collections.abc import Iterator
from functools import partial
from http.server import BaseHTTPRequestHandler
from pathlib import Path

import msgspec
import numpy as np
import pytest
from fltea.cluster import bounded
from fltea.cluster.listing import File, files_of
from fltea.cluster.pieces import cuts_of
from fltea.cluster.summed import PieceSums, sum_piece
from fltea.identification.workers import Here
from fltea.records.errors import FlteaError
from fltea.settings.how import How

from tests.rig.cluster_support import ASK, identified, rows_in, web_server
from tests.rig.identify_support import white

N = 4000
BLOCK_BYTES = 10_000
IN_PIECES = msgspec.structs.replace(ASK, how=How(rate_hz=100.0, units="deg/s"), block_bytes=BLOCK_BYTES)
WHOLE = msgspec.structs.replace(IN_PIECES, block_bytes=1_000_000)
MOST_CHUNKS = 64
"""Largest number of chunks of an endless answer, so that even a failing test ends."""


class Content:
    """A file on a server, in two versions.

    `says`: which header of an answer describes the version of the file. `minds`: whether the server honours
    conditional requests.
    `after`: number of answers that use the first version. `longer`: number of bytes by which the second
    version is longer.
    """

    def __init__(self, folder: Path, says: str | None, *, minds: bool = True, after: int = 0) -> None:
        noise = white(N, 1, 3)[0]
        self.versions = []
        for version, scale in enumerate((0.05, 0.5)):
            np.save(folder / f"{version}.npy", scale * noise)
            self.versions.append((folder / f"{version}.npy").read_bytes())
        self.says, self.minds, self.after = says, minds, after
        self.answers = 0
        self.longer = 0
        self.is_changed = False

    def stamp(self, version: int) -> str:
        day = f"Sun, 0{version + 1} Aug 2027 12:00:00 GMT"
        return {"ETag": f'"v{version}"', "weak": f'W/"v{version}"', "Last-Modified": day}[self.says or ""]

    def now(self) -> tuple[int, bytes]:
        version = int(self.is_changed or self.answers > self.after)
        return version, self.versions[version] + bytes(self.longer * version)


class Server(BaseHTTPRequestHandler):
    def __init__(self, content: Content, *arguments: object) -> None:
        self._content = content
        super().__init__(*arguments)  # type: ignore[arg-type]

    def log_message(self, format: str, *args: object) -> None:
        pass

    def do_HEAD(self) -> None:
        self._answer(is_head=True)

    def do_GET(self) -> None:
        self._content.answers += 1
        self._answer(is_head=False)

    def _answer(self, *, is_head: bool) -> None:
        version, data = self._content.now()
        stamp = self._content.stamp(version) if self._content.says else ""
        wanted = self.headers["If-Match"] or self.headers["If-Unmodified-Since"]
        if wanted and self._content.minds and wanted != stamp:
            self.send_response(412)
            self.send_header("Content-Length", "0")
            self.end_headers()
            return
        asked = re.fullmatch(r"bytes=(\d+)-(\d+)", self.headers["Range"] or "")
        body = data[int(asked[1]) : int(asked[2]) + 1] if asked else data
        self.send_response(206 if asked else 200)
        if asked:
            last = int(asked[1]) + len(body) - 1
            self.send_header("Content-Range", f"bytes {asked[1]}-{last}/{len(data)}")
        if stamp:
            self.send_header("ETag" if '"' in stamp else "Last-Modified", stamp)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        if not is_head:
            self.wfile.write(body)


@contextlib.contextmanager
def served(content: Content) -> Iterator[str]:
    with web_server(partial(Server, content)) as server:
        yield f"http://127.0.0.1:{server.server_port}/a.npy"


@pytest.mark.parametrize(
    ("says", "minds"), [("ETag", True), ("ETag", False), ("Last-Modified", True), ("weak", False)]
)
def test_a_web_file_that_changes_between_its_pieces_makes_no_row_of_both(
    says: str, minds: bool, tmp_path: Path
) -> None:
    """The file changes while it is read, which is an error. The next run reads its new content."""
    content = Content(tmp_path, says, minds=minds, after=5)
    with served(content) as url:
        out = tmp_path / "v.parquet"
        assert identified(url, IN_PIECES, out, Here()).failed == 1
        (row,) = rows_in(out)
        assert f"{url}: has changed since it was listed, so nothing of it is used." in row["error"]
        assert (row["again"], row["samples"], content.answers > 5) == (True, None, True)
        content.is_changed = True
        assert identified(url, IN_PIECES, out, Here()).failed == 0
        (row,) = rows_in(out)
    assert row["parts"] > 2
    assert row["std"] == pytest.approx(0.5, rel=0.05)


@pytest.mark.parametrize(("says", "minds"), [("ETag", True), ("Last-Modified", False)])
def test_a_web_file_that_changes_after_it_was_listed(says: str, minds: bool, tmp_path: Path) -> None:
    with served(Content(tmp_path, says, minds=minds)) as url:
        assert identified(url, WHOLE, tmp_path / "v.parquet", Here()).failed == 1
    (row,) = rows_in(tmp_path / "v.parquet")
    assert (row["again"], "has changed since it was listed" in row["error"]) == (True, True)


def test_a_web_file_of_another_length_has_changed_whatever_its_server_says(tmp_path: Path) -> None:
    content = Content(tmp_path, "ETag", minds=False, after=5)
    content.longer = 80
    content.stamp = lambda version: '"always"'  # type: ignore[method-assign]
    with served(content) as url:
        assert identified(url, IN_PIECES, tmp_path / "v.parquet", Here()).failed == 1
    (row,) = rows_in(tmp_path / "v.parquet")
    assert "has changed since it was listed" in row["error"]


def test_a_web_file_of_which_nothing_tells_a_change_is_read_in_one_answer(tmp_path: Path) -> None:
    content = Content(tmp_path, None, after=1)
    with served(content) as url:
        assert identified(url, IN_PIECES, tmp_path / "v.parquet", Here()).failed == 0
    (row,) = rows_in(tmp_path / "v.parquet")
    assert (row["parts"], row["samples"], content.answers) == (1, N, 1)
    assert row["std"] == pytest.approx(0.05, rel=0.05)


def test_a_file_of_this_machine_that_is_written_anew_has_changed(tmp_path: Path) -> None:
    """A local file that is written anew counts as changed.

    A local file to which more was appended does not, because its earlier content is still there.
    """
    path = tmp_path / "a.npy"
    np.save(path, white(N, 1, 3)[0])
    (file,) = files_of([str(path)])
    assert isinstance(file, File)
    cuts = cuts_of(file, IN_PIECES)
    with path.open("ab") as out:
        out.write(bytes(80))
    assert isinstance(sum_piece(file, cuts[0], IN_PIECES), PieceSums)
    np.save(path, white(N, 1, 4)[0])
    os.utime(path, ns=(0, 10**18))
    with pytest.raises(FlteaError, match=r"a\.npy: has changed since it was listed"):
        sum_piece(file, cuts[0], IN_PIECES)


class Endless(BaseHTTPRequestHandler):
    """A server that states a size, but sends ranges and lists of links without an end."""

    def __init__(self, sent: list[int], *arguments: object) -> None:
        self._sent = sent
        super().__init__(*arguments)  # type: ignore[arg-type]

    def log_message(self, format: str, *args: object) -> None:
        pass

    def do_HEAD(self) -> None:
        self.send_response(200)
        self.send_header("Content-Length", "1000000")
        self.send_header("ETag", '"a"')
        self.end_headers()

    def do_GET(self) -> None:
        self.send_response(206 if self.headers["Range"] else 200)
        self.send_header("Content-Type", "text/html")
        self.end_headers()
        with contextlib.suppress(OSError):
            for _ in range(MOST_CHUNKS):
                self.wfile.write(bytes(1 << 20))
                self._sent[0] += 1


@pytest.mark.parametrize("path", ["a.npy", "folder/*.npy"])
def test_ranges_and_lists_of_links_have_an_end(path: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bounded, "MOST_PAGE_BYTES", 100_000)
    sent = [0]
    with web_server(partial(Endless, sent)) as server:
        url = f"http://127.0.0.1:{server.server_port}/{path}"
        with pytest.raises(FlteaError, match=r"sends an answer of more than .* bytes, which is the limit"):
            cuts_of(next(files_of([url])), IN_PIECES)  # type: ignore[arg-type]
    assert sent[0] < MOST_CHUNKS
