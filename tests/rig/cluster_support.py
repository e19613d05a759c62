"""Helpers for the tests of verdict tables: recordings in several folders, and readers of a table's rows."""

import contextlib
import os
import threading
import warnings
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.request import Request, urlopen

import pytest
from fltea.cli import app as cli
from fltea.cluster.listing import File, files_of
from fltea.cluster.run import Progress, run
from fltea.cluster.verdict_table import VerdictTable
from fltea.cluster.whole import Ask
from fltea.identification.workers import Workers
from pyarrow import parquet

from tests.rig.identify_files import settings
from tests.rig.toolchain import missing

ASK = Ask(settings(shuffles=0))
"""Settings of `fltea identify` that save time: they omit the estimates of shuffled copies of the samples."""


def command(patch: pytest.MonkeyPatch, *arguments: object) -> int:
    """Run `fltea identify` with quick settings in this process; return the exit code."""
    quick = "--shuffles", "0", "--window", "100", "--startup", "100"
    patch.setattr("sys.argv", ["fltea", "identify", *map(str, arguments), *quick])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    return int(ended.value.code or 0)


@contextlib.contextmanager
def web_server(handler: Callable[..., BaseHTTPRequestHandler]) -> Iterator[ThreadingHTTPServer]:
    """Run a web server on the loopback interface until the `with` block ends."""
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        server.daemon_threads = True
        thread = threading.Thread(target=server.serve_forever, args=(0.02,))
        thread.start()
        try:
            yield server
        finally:
            server.shutdown()
            thread.join()


def file(number: int, *, size: int = 10, stamp: str = "1") -> File:
    return File(f"s3://lab/{number}.csv", "s3", f"lab/{number}.csv", size, stamp)


@contextlib.contextmanager
def open_table(folder: Path, digest: str = ASK.digest()) -> Iterator[VerdictTable]:
    table = VerdictTable(folder, digest)
    try:
        yield table
    finally:
        table.close()


def rows_in(folder: Path) -> list[dict[str, Any]]:
    """Return the rows of a table, sorted by file and axis.

    The rows are read with pyarrow, as other programs would read them.
    """
    return sorted(parquet.read_table(folder).to_pylist(), key=lambda row: (row["file"], row["axis"] or ""))


def values(folder: Path) -> list[dict[str, Any]]:
    """Return the rows of a table without the columns that contain computing times."""
    return [{**row, "seconds": None} for row in rows_in(folder)]


def identified(pattern: str, how: Ask, out: Path, workers: Workers, **options: Any) -> Progress:
    """Identify all files that match a pattern into a table, then close the workers."""
    try:
        with open_table(out, how.digest()) as table:
            return run(files_of([pattern]), how, workers, table, **options)
    finally:
        workers.close()


@contextlib.contextmanager
def two_workers() -> Iterator[Any]:
    """Start a Dask cluster with two worker processes; a worker that dies is not replaced."""
    try:
        from distributed import LocalCluster
    except ModuleNotFoundError:
        missing("distributed is not installed: pip install -e '.[dask]'")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Dask warns about its own ports and files
        with LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, host="127.0.0.1"
        ) as found:
            for nanny in found.workers.values():
                # With `close_gracefully`, Dask's nanny process starts no new worker when its worker dies.
                nanny.close_gracefully()
            yield found


@contextlib.contextmanager
def s3_server() -> Iterator[Any]:
    """Start an S3 server on the loopback with the bucket `lab`, and yield a file system for it.

    Environment variables make the program use this server in place of Amazon's.
    """
    import logging

    from fltea.cluster.listing import file_system
    from moto.server import ThreadedMotoServer
    from s3fs import S3FileSystem

    logging.getLogger("werkzeug").setLevel(logging.ERROR)
    server = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    server.start()
    host, port = server.get_host_and_port()
    known = {
        "AWS_ENDPOINT_URL": f"http://{host}:{port}",
        "AWS_ACCESS_KEY_ID": "key",
        "AWS_SECRET_ACCESS_KEY": "secret",
        "AWS_DEFAULT_REGION": "us-east-1",
        "AWS_EC2_METADATA_DISABLED": "true",
    }
    before = {name: os.environ.get(name) for name in known}
    os.environ.update(known)
    try:
        urlopen(Request(f"{known['AWS_ENDPOINT_URL']}/moto-api/reset", method="POST")).close()
        S3FileSystem.clear_instance_cache()  # drop cached connections to an earlier server
        system = file_system("s3")
        system.mkdir("lab")
        yield system
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name)
            else:
                os.environ[name] = value
        server.stop()
