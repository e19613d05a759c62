"""Tests of the address of a Dask scheduler. An impossible address is refused and plain TCP gets a warning,
both at once.

Dask's messages are pickles, which run code that their sender chooses.
"""

import re
from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest
from fltea import __version__
from fltea.cli import identify as command
from fltea.identification import dask_workers
from fltea.identification.dask_address import check_address, trust_warning
from fltea.identification.workers import Here, UnfitWorker
from fltea.records.errors import UsageError

from tests.rig.cluster_support import ASK, identified, open_table
from tests.rig.host_support import fltea_here
from tests.rig.identify_files import counts, npz


@pytest.mark.parametrize(
    "address",
    [
        "tcp://10.0.0.5:8786",
        "tls://scheduler.lab.example:8786",
        "tcp://[::1]:8786",
        "wss://lab.example:443",
        "localhost:8786",
        "[::1]:8786",
        "tls://_under_score-1:8786",
    ],
)
def test_addresses_of_schedulers_are_not_refused(address: str) -> None:
    check_address(address)


@pytest.mark.parametrize(
    ("address", "reason"),
    [
        ("nonsense", "no port"),
        ("", "no host"),
        (":8786", "no host"),
        ("tcp://:8786", "no host"),
        ("tcp://10.0.0.5", "no port"),
        ("tcp://10.0.0.5:", "no port"),
        ("tcp://10.0.0.5:0", "no port"),
        ("tcp://10.0.0.5:dashboard", "no port"),
        ("tcp://10.0.0.5:99999", "no port"),
        ("tcp://[::1:8786", "IPv6"),
        ("tcp://::1:8786", "IPv6"),
        ("http://10.0.0.5:8787", "http:// is not spoken by schedulers"),
        ("inproc://10.0.0.5/1/1", "inproc:// is not spoken"),
        ("tcp://10.0.0.5:8786/status", "more than a host and a port"),
        ("tcp://10.0.0.5 :8786", "more than a host and a port"),
    ],
)
def test_what_is_none(address: str, reason: str) -> None:
    with pytest.raises(UsageError, match=reason) as told:
        check_address(address)
    assert str(told.value).startswith(f"--dask {address}: ")
    assert "tcp://HOST:8786" in str(told.value)
    assert "tls://HOST:8786" in str(told.value)


def test_an_address_with_a_user_is_refused_and_not_repeated() -> None:
    with pytest.raises(UsageError, match="must not hold a user or a password") as told:
        check_address("tcp://me@10.0.0.5:8786")
    assert "me@" not in str(told.value)


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (["--dask", "nonsense"], "error: --dask nonsense: has no port"),
        (["--dask", "tcp://10.0.0.5:8786", "--jobs", "2"], "give one of them"),
    ],
)
def test_nothing_is_made_before(tmp_path: Path, options: list[str], text: str) -> None:
    out = tmp_path / "v.parquet"
    done = fltea_here("identify", "a.npz", "--out", out, *options)
    said = done.stderr
    assert (done.returncode, text in said, "warning" in said) == (2, True, False), said
    assert not out.exists()


def test_nobody_listens(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
    """If no scheduler listens at the address, the error says what to do, and Dask's own threads print no
    traceback.
    """
    import gc

    from fltea.identification import dask_workers

    monkeypatch.setattr(dask_workers, "CONNECT_S", 0.3)
    with pytest.raises(UsageError, match=r"127\.0\.0\.1:1: no scheduler answers there .* is it running"):
        dask_workers.DaskWorkers("tcp://127.0.0.1:1")
    gc.collect()
    assert "Traceback" not in capfd.readouterr().err


@pytest.mark.parametrize(
    ("address", "warned"),
    [
        ("tls://10.0.0.5:8786", False),
        ("wss://lab.example:8786", False),
        ("tcp://127.0.0.1:8786", False),
        ("[::1]:8786", False),
        ("localhost:8786", False),
        ("tcp://10.0.0.5:8786", True),
        ("10.0.0.5:8786", True),
        ("tcp://localhost.evil.example:8786", True),
        ("ws://lab.example", True),
        ("ucx://10.0.0.5:1", True),
    ],
)
def test_where_others_may_be_on_the_way_a_warning_says_so(address: str, warned: bool) -> None:
    text = trust_warning(address)
    assert (text is not None) == warned
    assert text is None or (f"--dask {address}" in text and "tls://" in text)


def test_the_warning_comes_before_anything_is_connected(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse(*arguments: object) -> None:
        assert "warning: --dask tcp://192.0.2.1:8786: not encrypted" in capsys.readouterr().err
        raise UsageError("no scheduler")

    monkeypatch.setattr(command, "load", refuse)
    with pytest.raises(UsageError, match="no scheduler"):
        command._workers(None, "tcp://192.0.2.1:8786")


@pytest.mark.parametrize(
    ("answer", "text"),
    [
        (TimeoutError(), "the scheduler has no workers"),
        (ModuleNotFoundError("fltea"), "the workers cannot run fltea (fltea)"),
        ({"a": __version__, "b": "0.0"}, f"worker b has fltea 0.0, and this is {__version__}"),
    ],
)
def test_workers_that_are_none_of_ours_are_left_at_once(
    monkeypatch: pytest.MonkeyPatch, answer: Exception | dict[str, str], text: str
) -> None:
    client = Mock()
    client.run.side_effect = [answer]
    monkeypatch.setattr(dask_workers, "_connected", lambda address: client)
    with pytest.raises(UsageError, match=re.escape(text)):
        dask_workers.DaskWorkers("tcp://x:1")
    client.close.assert_called_once_with()


def test_a_worker_of_another_version_that_joins_later_ends_the_work(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """If a worker of another version joins after the check of versions, its answers are rejected.

    The rejection is not reported as a fault of a file.
    """

    def joined(task: Callable[..., Any], *arguments: Any) -> "Future[Any]":
        with monkeypatch.context() as patch:
            patch.setattr(dask_workers, "__version__", "0.0")
            return Here().submit(task, *arguments)

    client = Mock()
    client.run.return_value = {"a": __version__}
    client.sync.return_value = {"a": 1}
    client.status = "running"
    client.get_executor.return_value.submit = joined
    monkeypatch.setattr(dask_workers, "_connected", lambda address: client)
    path = npz(tmp_path / "a.npz", counts(1000, 1))
    workers = dask_workers.DaskWorkers("tcp://x:1")
    with pytest.raises(UnfitWorker, match=f"has fltea 0.0, and this is {re.escape(__version__)}"):
        identified(str(path), ASK, tmp_path / "v.parquet", workers)
    with open_table(tmp_path / "v.parquet") as table:
        assert len(table) == 0
