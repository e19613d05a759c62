"""Let an existing Dask cluster do the tasks (as `workers.Workers`).

If a worker dies, Dask runs its task again. Each task is sent with its samples, so that a worker needs neither
the files nor another worker. Even if a task was run twice, its result arrives once.
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
"""Time without any worker after which the run fails [s]."""
SILENT_S = 60.0
"""Time without an answer after which the scheduler counts as gone [s].

A stopped process keeps its port open, so the connection alone proves nothing.
"""
RETRIES = 3
"""Number of retries of a task that raises an error.

This number does not include retries because a worker died. The scheduler counts those.
"""
SETTINGS = "DASK_DISTRIBUTED__COMM__TLS__CA_FILE, …__CLIENT__CERT and …__CLIENT__KEY"


class DaskWorkers(Workers):
    """Workers of the cluster whose scheduler listens at `address`, such as tcp://10.0.0.5:8786.

    Raises:
        UsageError: there is no scheduler or no worker, certificates are missing or wrong, or the workers have
            no fltea or another version of it.
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
        """Number of tasks to hand over at once: two for each thread, so that no thread waits."""
        return max(2, 2 * self._threads())

    def submit(self, task: Callable[..., T], *arguments: Any) -> "Future[T]":
        """Hand a task to the scheduler."""
        with warnings.catch_warnings():
            # Dask advises to place large data on a worker first (`scatter`). But these data are lost if that
            # worker dies.
            warnings.filterwarnings("ignore", "Sending large graph", UserWarning)
            try:
                future: Future[T] = self._executor.submit(_of_version, __version__, task, *arguments)
            except Exception as error:
                self._check_scheduler(error)
                raise
        return future

    def check(self) -> None:
        """Check that the scheduler answers and that there was a worker within the last minute.

        Raises:
            FlteaError: the scheduler is gone, or there has been no worker for a minute.
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
        """Disconnect from the scheduler, which then drops the tasks of this client."""
        self._client.close()


def _connected(address: str) -> Any:
    """Return a client of the scheduler at `address`.

    If the construction of Dask's client fails, it may take 20 s and print a traceback. So everything that can
    be checked in advance is checked here.

    Raises:
        UsageError: no scheduler answers at `address`, or certificates are missing or wrong.
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
    except (OSError, ValueError) as error:  # OSError includes SSLError
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
    """Do a task on a worker after a check of the worker's version of fltea.

    A worker may join after the versions of all workers were checked.

    Raises:
        UnfitWorker: this worker's version is not `version`; its results must not be mixed with others.
    """
    if version != __version__:
        raise UnfitWorker(
            f"--dask: a worker on {platform.node()} that joined the cluster has fltea {__version__}, and "
            f"this is {version}. Install the same there, or end that worker, and give the same command "
            "again; what is in the table of --out is not done again."
        )
    return task(*arguments)
