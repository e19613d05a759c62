"""An HTTP endpoint that Prometheus scrapes: the newest records of every device (host/README.md, Metrics)."""

import errno
import socket
import socketserver
import threading
from collections.abc import Callable, Sequence
from http.server import ThreadingHTTPServer

from prometheus_client import CollectorRegistry, MetricsHandler, ProcessCollector

from fltea.records.block import Block
from fltea.records.clock import host_ns
from fltea.records.errors import FlteaError, UsageError
from fltea.records.ports import Item, OutputView, Report, Sink
from fltea.records.records import DeviceEstimates, Epoch, Error, Estimate, Hello, Stats
from fltea.settings.listen_address import listen_address
from fltea.settings.outputs import MetricsConfig
from fltea.sinks.metrics.families import Families, Newest

POLL_S = 0.1


class MetricsSink(Sink):
    """Keeps the newest record of each kind and device; they become metrics when somebody asks.

    outlets: all outputs, each with the device that it belongs to, or None.

    Raises:
        UsageError: there is no such address on this machine.
        FlteaError: the port is taken.
    """

    name = "metrics"

    def __init__(
        self,
        settings: MetricsConfig,
        outlets: Callable[[], Sequence[tuple[str | None, OutputView]]],
        report: Report,
    ) -> None:
        self._newest: dict[str, Newest] = {}
        self._errors: dict[tuple[str, str], int] = {}
        registry = CollectorRegistry()
        registry.register(Families(self._newest, self._errors, outlets))
        ProcessCollector(registry=registry)
        host, port = listen_address(str(settings.address))
        self._server = _listen(host, port, MetricsHandler.factory(registry))
        self.url = f"http://{f'[{host}]' if ':' in host else host}:{self._server.server_port}/metrics"
        self._thread = threading.Thread(
            target=self._server.serve_forever, args=(POLL_S,), name="metrics server", daemon=True
        )
        self._thread.start()

    def write(self, item: Item) -> None:
        """Remember a record in place of the one before it."""
        if isinstance(item, Block):
            self._of(item.device).take(item)
        elif isinstance(item, Estimate):
            newest = self._of(item.device)
            newest.estimate, newest.estimate_ns = item, host_ns()
        elif isinstance(item, DeviceEstimates):
            newest = self._of(item.device)
            newest.device_estimate, newest.device_estimate_ns = item, host_ns()
        elif isinstance(item, Stats):
            self._of(item.device).stats = item
        elif isinstance(item, Hello):
            self._of(item.device).hello = item
        elif isinstance(item, Epoch):
            newest = self._of(item.device)
            newest.estimate = newest.device_estimate = None  # what the epoch before it gave is no longer so
        elif isinstance(item, Error):
            key = item.device or "", item.kind
            self._errors[key] = self._errors.get(key, 0) + 1

    def close(self) -> None:
        """Answer no more."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()

    def _of(self, device: str | None) -> Newest:
        return self._newest.setdefault(device or "", Newest())


class _Server(ThreadingHTTPServer):
    daemon_threads = True

    def server_bind(self) -> None:
        """As the base class, but for its search for the machine's name, which may wait for a name server."""
        socketserver.TCPServer.server_bind(self)
        self.server_name, self.server_port = "", self.server_address[1]

    def handle_error(self, request: object, client_address: object) -> None:
        """Somebody hung up, and that is his affair."""


class _Server6(_Server):
    address_family = socket.AF_INET6


def _listen(host: str, port: int, handler: type[MetricsHandler]) -> _Server:
    handler.timeout = 10.0  # of a client that says nothing
    where = f"[metrics] address {host}, port {port}"
    try:
        return (_Server6 if ":" in host else _Server)((host, port), handler)
    except PermissionError as error:
        raise UsageError(f"{where}: ports below 1024 belong to the administrator; take another.") from error
    except socket.gaierror as error:
        raise UsageError(f"{where}: there is no such host ({error.strerror}).") from error
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            hint = "another program has the port, perhaps another fltea: take another, or end that program."
            raise FlteaError(f"{where}: {hint}") from error
        raise UsageError(f"{where}: not an address of this machine ({error.strerror}).") from error
