"""Tests that a Dask cluster with TLS, set up as in host/docs/guide/verdict.md, accepts only clients with its
certificate.
"""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from fltea.records.errors import UsageError

from tests.rig.cluster_support import rows_in
from tests.rig.host_support import PATIENCE_S, wait_until
from tests.rig.identify_files import counts, npz
from tests.rig.mosquitto_support import openssl
from tests.rig.toolchain import missing

QUICK = ("--shuffles", "0", "--window", "100", "--startup", "100")


def make_certificate(folder: Path) -> Path:
    """Make a certificate with the command that the documentation gives."""
    folder.mkdir()
    key = ["-x509", "-newkey", "rsa:2048", "-nodes", "-keyout", folder / "key.pem"]
    openssl("req", *key, "-out", folder / "cert.pem", "-days", "365", "-subj", "/CN=dask")
    return folder


def documented(authority: Path, own: Path | None = None, key: Path | None = None) -> dict[str, str]:
    """Return the settings that the documentation gives.

    `own`: folder of the certificate that is presented. `key`: folder of its key.
    """
    own = own or authority
    found = {"REQUIRE_ENCRYPTION": "true", "TLS__CA_FILE": f"{authority}/cert.pem"}
    for who in ("SCHEDULER", "WORKER", "CLIENT"):
        found |= {f"TLS__{who}__CERT": f"{own}/cert.pem", f"TLS__{who}__KEY": f"{key or own}/key.pem"}
    return {f"DASK_DISTRIBUTED__COMM__{name}": value for name, value in found.items()}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    found = tmp_path_factory.mktemp("tls")
    for name in ("ours", "foreign"):
        make_certificate(found / name)
    return found


@pytest.fixture(scope="module")
def address(folder: Path) -> Iterator[str]:
    """Start a scheduler and a worker with Dask's own commands."""
    dask = Path(sys.executable).with_name("dask")
    if not dask.exists():
        missing("distributed is not installed: pip install -e '.[dask]'")
    told = folder / "scheduler.json"
    environment = {**os.environ, **documented(folder / "ours")}
    alike: Any = {"env": environment, "stderr": subprocess.DEVNULL, "cwd": folder}
    where = ["--scheduler-file", str(told), "--no-dashboard"]
    loopback = ["--protocol", "tls", "--host", "127.0.0.1", "--port", "0"]
    one = subprocess.Popen([dask, "scheduler", *loopback, *where], **alike)
    other = subprocess.Popen([dask, "worker", "--no-nanny", "--nthreads", "1", *where], **alike)
    try:
        wait_until(lambda: told.exists() and told.read_text().endswith("}"), "the scheduler")
        yield str(json.loads(told.read_text())["address"])
    finally:
        for process in (other, one):
            process.kill()
            process.wait(PATIENCE_S)


def connect(
    address: str, settings: dict[str, str], monkeypatch: pytest.MonkeyPatch, patience_s: float = 5.0
) -> None:
    """Connect to a scheduler from this process, with these environment variables."""
    import dask
    from fltea.identification import dask_workers

    monkeypatch.setattr(dask_workers, "CONNECT_S", patience_s)
    keys = {name.removeprefix("DASK_").lower().replace("__", "."): name for name in settings}
    with dask.config.set({key: settings[name] for key, name in keys.items()}):
        dask_workers.DaskWorkers(address).close()


@pytest.mark.slow
def test_the_documented_settings_get_in(address: str, folder: Path, tmp_path: Path) -> None:
    assert address.startswith("tls://")
    path, out = npz(tmp_path / "a.npz", counts(1000, 1)), tmp_path / "v.parquet"
    command = [sys.executable, "-m", "fltea", "identify", path, "--dask", address, "--out", out, *QUICK]
    environment = {**os.environ, **documented(folder / "ours")}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.returncode == 0, done.stderr
    assert "warning" not in done.stderr
    assert [(row["axis"], row["samples"]) for row in rows_in(out)] == [("gyro_x", 1000)]


@pytest.mark.parametrize(
    ("authority", "own"), [("foreign", "foreign"), ("ours", "foreign")], ids=["of another", "shows another"]
)
def test_a_foreign_certificate_does_not(
    address: str, folder: Path, authority: str, own: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(UsageError, match=r"takes our certificate .* did one authority sign") as told:
        connect(address, documented(folder / authority, folder / own), monkeypatch)
    assert told.value.exit_code == 2


def test_nor_without_one(address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A client without a certificate, which connects by plain TCP, is not accepted."""
    plain = address.replace("tls://", "tcp://")
    with pytest.raises(UsageError, match=r"no scheduler answers there .* with certificates tls://"):
        connect(plain, {}, monkeypatch, patience_s=1.0)


def test_settings_that_cannot_be_used(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each mistake in the settings is reported before anything is connected."""
    nowhere = "tls://192.0.2.1:8786"
    with pytest.raises(UsageError, match=r"certificates cannot be used \(.*No such file.*CA_FILE"):
        connect(nowhere, documented(folder / "nothing"), monkeypatch)
    with pytest.raises(UsageError, match=r"certificates cannot be used \(.*KEY_VALUES_MISMATCH"):
        connect(nowhere, documented(folder / "ours", key=folder / "foreign"), monkeypatch)
    with pytest.raises(UsageError, match=r"REQUIRE_ENCRYPTION .* tls://127\.0\.0\.1:8786"):
        connect("tcp://127.0.0.1:8786", documented(folder / "ours"), monkeypatch)
    with pytest.raises(UsageError, match=r"no certificate to show.*CLIENT__CERT"):
        connect("wss://192.0.2.1:8786", {}, monkeypatch)
