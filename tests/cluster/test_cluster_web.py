"""Recordings on a web server with TLS; clouds whose package is missing."""

import os
import ssl
import subprocess
import sys
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import msgspec
import numpy as np
import pytest
from cluster_support import ASK, identified, rows_in, web_server
from fltea.cluster import listing
from fltea.cluster.listing import files_of
from fltea.identification.workers import Here
from fltea.records.errors import FlteaError, UsageError
from fltea.settings.how import How
from identify_support import white
from mosquitto_support import make_authority

HOW = msgspec.structs.replace(ASK, how=How(rate_hz=100.0, units="deg/s"))


class Quiet(SimpleHTTPRequestHandler):
    """As most servers it says when a file was changed; unlike most it sends no ranges of bytes."""

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


def test_https_with_a_certificate_of_ones_own(
    server: ThreadingHTTPServer, files: Path, tmp_path: Path
) -> None:
    """Trusted by SSL_CERT_FILE; without that nothing is read, and the reason is told."""
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
    """One is the user's mistake, the other may be another time."""
    with pytest.raises(UsageError, match=r"none.npy: no recording is there"):
        list(files_of([f"http://127.0.0.1:{server.server_port}/none.npy"]))
    with pytest.raises(FlteaError, match=r"a.npy: cannot be read \(ClientConnectorError") as caught:
        list(files_of(["http://127.0.0.1:1/a.npy"]))
    assert not isinstance(caught.value, UsageError)


@pytest.mark.parametrize(("protocol", "package"), [("gs", "gcsfs"), ("abfs", "adlfs"), ("az", "adlfs")])
def test_a_cloud_whose_package_is_missing(
    protocol: str, package: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a machine that has it, too: a module that is None in sys.modules cannot be imported."""
    from fsspec.registry import _registry

    monkeypatch.setitem(sys.modules, package, None)
    monkeypatch.delitem(_registry, protocol, raising=False)
    text = rf"^{protocol}:// needs {package}, which is not installed .* -m pip install {package}, here and"
    with pytest.raises(UsageError, match=text):
        list(files_of([f"{protocol}://lab/a.npy"]))
    assert listing.PACKAGES[protocol] == package
