"""An existing Dask cluster as `workers.Workers`.

Dask itself does again what a worker was doing when it died. Each task takes its samples along, so that no
worker needs the files or another worker; its result is counted when it arrives, which it does once.
"""

import platform
import time
import warnings
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, TypeVar

from dask import config
from distributed import Client
from distributed.security import Security

from fltea.identification.dask_address import ENCRYPTED
from fltea.identification.workers import UnfitWorker, Workers
from fltea.records.errors import FlteaError, UsageError
from fltea.records.version import __version__

T = TypeVar("T")

CONNECT_S = 10.0
LONELY_S = 60.0
"""How long a cluster may be without any worker."""
SILENT_S = 60.0
"""How long a scheduler may leave a question without an answer: one that stands still keeps its line open."""
RETRIES = 3
"""Tries of a task that has failed; those of a task whose worker died are counted by the scheduler."""
SETTINGS = "DASK_DISTRIBUTED__COMM__TLS__CA_FILE, …__CLIENT__CERT and …__CLIENT__KEY"


class DaskWorkers(Workers):
    """Connected to the scheduler at `address`, such as tcp://10.0.0.5:8786.

    Raises:
        UsageError: there is no scheduler or no worker, certificates are missing or wrong, or the workers have
            another version of fltea, or none.
    """

    def __init__(self, address: str) -> None:
        self._address = address
        self._client = _connected(address)
        try:
            self._check_workers()
        except UsageError:
            self.close()
            raise
        self._executor = self._client.get_executor(pure=False, retries=RETRIES)
        self._lonely_since: float | None = None

    def _check_workers(self) -> None:
        where = f"--dask {self._address}"
        try:
            self._client.wait_for_workers(1, timeout=CONNECT_S)
            versions = self._client.run(_version)
        except TimeoutError as error:
            raise UsageError(
                f"{where}: the scheduler has no workers; start some: dask worker {self._address}"
            ) from error
        except Exception as error:
            raise UsageError(
                f"{where}: the workers cannot run fltea ({error}); install {__version__} there."
            ) from error
        for worker, version in versions.items():
            if version != __version__:
                raise UsageError(
                    f"{where}: worker {worker} has fltea {version}, and this is {__version__}; install the "
                    "same everywhere."
                )

    @property
    def slots(self) -> int:
        """Two tasks a thread are worth handing over, so that the next one is there when one is done."""
        return max(2, 2 * self._threads())

    def submit(self, task: Callable[..., T], *arguments: Any) -> "Future[T]":
        """Hand a task to the scheduler."""
        with warnings.catch_warnings():
            # It would rather have large data scattered, but what is scattered is lost with its worker.
            warnings.filterwarnings("ignore", "Sending large graph", UserWarning)
            try:
                future: Future[T] = self._executor.submit(_of_version, __version__, task, *arguments)
            except Exception as error:
                self._check_scheduler(error)
                raise
        return future

    def check(self) -> None:
        """Complain when there has been no worker for a minute, or the scheduler is gone.

        Raises:
            FlteaError: then.
        """
        if self._threads():
            self._lonely_since = None
            return
        now = time.monotonic()
        self._lonely_since = self._lonely_since or now
        if now - self._lonely_since > LONELY_S:
            raise FlteaError(f"--dask {self._address}: there has been no worker for {LONELY_S:.0f} s.")

    def _threads(self) -> int:
        """Return the number of threads of all workers.

        Raises:
            FlteaError: the scheduler is gone, or does not answer.
        """
        self._check_scheduler()
        try:
            ask = self._client.scheduler.ncores
            return sum(self._client.sync(ask, callback_timeout=SILENT_S).values())
        except Exception as error:
            self._check_scheduler(error)
            raise

    def _check_scheduler(self, cause: Exception | None = None) -> None:
        if self._client.status == "running" and not isinstance(cause, OSError):
            return
        raise FlteaError(
            f"--dask {self._address}: the scheduler is gone, or does not answer, and what it was doing is "
            "lost. Start it and its workers, and give the same command again; what is in the table of --out "
            "is not done again."
        ) from cause

    def close(self) -> None:
        """Leave; the scheduler forgets what was asked for."""
        self._client.close()


def _connected(address: str) -> Any:
    """Return a client of the scheduler there.

    Dask's client may take 20 s to go away if it fails as it is made, with a traceback: so all that can be
    checked before that is.

    Raises:
        UsageError: nobody answers there, or certificates are missing or wrong.
    """
    encrypted = address.startswith(tuple(f"{scheme}://" for scheme in ENCRYPTED))
    if encrypted:
        _check_certificate(address)
    elif config.get("distributed.comm.require-encryption", None):
        raise UsageError(
            f"--dask {address}: not encrypted, and DASK_DISTRIBUTED__COMM__REQUIRE_ENCRYPTION is set. "
            f"Connect to tls://{address.rpartition('://')[2]}, or unset it."
        )
    connect: Any = Client
    try:
        return connect(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        cause = error or type(error).__name__
        if encrypted:
            raise UsageError(
                f"--dask {address}: no scheduler answers there that takes our certificate ({cause}). Is it "
                "running, with --protocol tls, and did one authority sign its certificate and that of "
                "…__CLIENT__CERT (host/docs/guide/verdict.md, A Dask cluster)?"
            ) from error
        raise UsageError(
            f"--dask {address}: no scheduler answers there ({cause}); is it running, and is the address that "
            "of its log (tcp://HOST:8786, with certificates tls://HOST:8786)?"
        ) from error


def _check_certificate(address: str) -> None:
    security: Any = Security
    try:
        found = security().get_connection_args("client")["ssl_context"]
    except (OSError, ValueError) as error:  # an SSLError is an OSError
        raise UsageError(
            f"--dask {address}: the certificates cannot be used ({error}). Do {SETTINGS} name files that are "
            "there, and is the key that of the certificate (host/docs/guide/verdict.md, A Dask cluster)?"
        ) from error
    if not found:
        raise UsageError(
            f"--dask {address}: no certificate to show there. Set {SETTINGS} (host/docs/guide/verdict.md, "
            "A Dask cluster)."
        )


def _version() -> str:
    return __version__


def _of_version(version: str, task: Callable[..., T], *arguments: Any) -> T:
    """Do a task on a worker, which may have come long after the others were looked at.

    Raises:
        UnfitWorker: it has another version than who asks: its answer would stand beside those of that one.
    """
    if version != __version__:
        raise UnfitWorker(
            f"--dask: a worker on {platform.node()} that joined the cluster has fltea {__version__}, and "
            f"this is {version}. Install the same there, or end that worker, and give the same command "
            "again; what is in the table of --out is not done again."
        )
    return task(*arguments)
