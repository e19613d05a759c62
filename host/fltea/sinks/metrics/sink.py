"""Serve the newest records over HTTP to Prometheus (host/docs/guide/outputs.md)."""

import socket
import socketserver
import threading
from collections.abc import Callable, Collection, Iterator, Sequence
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import msgspec
from prometheus_client import CollectorRegistry, MetricsHandler, ProcessCollector

from fltea.diagnostics.addresses import may_listen
from fltea.diagnostics.asked import AskedOutput
from fltea.diagnostics.finding import Finding, problem
from fltea.records.block import Block
from fltea.records.clock import host_ns
from fltea.records.errors import UsageError
from fltea.records.identities import MOST, FewIdentities
from fltea.records.ports import Departed, Item, OutputView, Report, Sink
from fltea.records.records import (
    DeviceEstimates,
    DeviceFits,
    Epoch,
    Error,
    Estimate,
    Fit,
    Hello,
    Motion,
    Stats,
)
from fltea.settings.config import Config
from fltea.settings.outputs import MetricsConfig, listen_address
from fltea.sinks.listening import cannot_listen, is_own, own_names, url_of
from fltea.sinks.metrics.families import Families, Newest
from fltea.sinks.opening import Opening

EVERYWHERE = {"0.0.0.0", "::"}
"""Hosts that stand for all addresses of this machine."""

POLL_S = 0.1
NOT_OURS = (
    "fltea does not know the host name of this request, so it gives no metrics. Use the address, localhost "
    "or the machine's own name, or add the name to metrics.names.\n"
)


class MetricsSink(Sink):
    """Keeps the newest record of each kind from each device. On request, makes metrics of these records.

    `sink_queues`: function that returns all outputs, each with the name of its device, or with None if all
    devices share the output.

    Raises:
        UsageError: this machine does not have the address.
        FlteaError: another program uses the network port.
    """

    name = "metrics"

    def __init__(
        self,
        settings: MetricsConfig,
        sink_queues: Callable[[], Sequence[tuple[str | None, OutputView]]],
        report: Report,
    ) -> None:
        self._newest: dict[str, Newest] = {}
        self._errors: dict[tuple[str, str], int] = {}
        self._identities: dict[str, FewIdentities] = {}
        self._report = report
        registry = CollectorRegistry()
        self._families = Families(self._newest, self._errors, sink_queues)
        registry.register(self._families)
        ProcessCollector(registry=registry)
        host, port = listen_address(str(settings.address))
        names = own_names(host, settings.names)
        handler = type("_Handler", (_Handler,), {"registry": registry, "names": names})
        self._server = listen(host, port, handler)
        self.url = f"{url_of(host, self._server.server_port)}metrics"
        self._thread = threading.Thread(
            target=self._server.serve_forever, args=(POLL_S,), name="metrics server", daemon=True
        )
        self._thread.start()

    def write(self, item: Item) -> None:
        """Remember a record in place of the previous record of the same kind and device."""
        if isinstance(item, Error):
            key = item.device or "", item.kind
            self._errors[key] = self._errors.get(key, 0) + 1
            return
        newest = self._newest.setdefault(getattr(item, "device", None) or "", Newest())
        match item:
            case Block():
                newest.take(item)
            case Estimate():
                newest.estimate, newest.estimate_ns = item, host_ns()
            case DeviceEstimates():
                newest.device_estimate, newest.device_estimate_ns = item, host_ns()
            case DeviceFits():
                newest.device_fits = newest.device_fits | item.axes
            case Stats():
                newest.stats = item
            case Fit():
                newest.fit = item
            case Motion(begins=True):
                newest.motions += 1
            case Hello():
                newest.hello = self._introduced(item)
            case Epoch():  # estimates and fits of the previous epoch do not apply to the new epoch
                newest.estimate = newest.device_estimate = newest.fit = None
                newest.device_fits = {}

    def depart(self, departed: Departed) -> None:
        """Forget a device, so that there are no more metrics of it."""
        self._newest.pop(departed.device, None)
        self._identities.pop(departed.device, None)
        for key in [key for key in self._errors if key[0] == departed.device]:
            del self._errors[key]

    def close(self) -> None:
        """End the server."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()

    def _introduced(self, hello: Hello) -> Hello:
        """Return the record `hello`, without the device's identity if the board changes it too often.

        Each new identity would begin a new time series in Prometheus.
        """
        device, now_ns = hello.device or "", host_ns()
        identities = self._identities.setdefault(device, FewIdentities())
        stated = hello.source, hello.device_id, hello.sensor, hello.firmware_version, hello.sampling_mode
        if identities.admits(stated, now_ns):
            return hello
        if identities.is_to_tell(now_ns):
            text = (
                f"{hello.source} reported more than {MOST} device IDs in an hour; further IDs are left out "
                "of fltea_device_info, since each would begin a time series. Is the board faulty?"
            )
            self._report("too_many_devices", text)
        return msgspec.structs.replace(
            hello, device_id=None, sensor=None, firmware_version=None, sampling_mode="unknown"
        )


class _Handler(MetricsHandler):
    """Answers requests for the metrics if their header `Host` names this machine."""

    timeout = 10.0  # ends the connection of a client that sends nothing
    names: Collection[str] = ()

    def do_GET(self) -> None:
        """Answer a request with the metrics, or with the reason why it is refused.

        A request without `Host` is answered, since it does not come from a browser.
        """
        host = self.headers.get("Host")
        if host is None or is_own(host, self.names):
            super().do_GET()
            return
        text = NOT_OURS.encode()
        self.send_response(HTTPStatus.MISDIRECTED_REQUEST)
        self.send_header("Content-Type", "text/plain; charset=utf-8")
        self.send_header("Content-Length", str(len(text)))
        self.end_headers()
        self.wfile.write(text)


class _Server(ThreadingHTTPServer):
    daemon_threads = True

    def server_bind(self) -> None:
        """Bind as the base class does, but do not look up the machine's name, which may take long."""
        socketserver.TCPServer.server_bind(self)
        self.server_name, self.server_port = "", self.server_address[1]

    def handle_error(self, request: object, client_address: object) -> None:
        """Ignore errors of a client that has closed the connection."""


class _Server6(_Server):
    address_family = socket.AF_INET6


def listen(host: str, port: int, handler: type[BaseHTTPRequestHandler]) -> ThreadingHTTPServer:
    """Listen at an address and port, and return the server, which does not answer yet.

    Raises:
        FlteaError: another program uses the address, or this machine does not have it.
    """
    try:
        return (_Server6 if ":" in host else _Server)((host, port), handler)
    except (OSError, UnicodeError) as error:
        raise cannot_listen("--metrics", host, port, error) from error


def open_output(opening: Opening) -> MetricsSink:
    """Open the server for Prometheus.

    Raises:
        UsageError: the live page has the same port.
    """
    if why := _same_as_page(opening.program):
        raise UsageError(f"--metrics: {why} Give another port.")
    return MetricsSink(opening.program.metrics, opening.sink_queues, opening.report)


def check_output(asked: AskedOutput) -> Iterator[Finding]:
    """Yield whether the server of the metrics may listen at its address, which must not be the page's."""
    if why := _same_as_page(asked.program):
        yield problem("metrics", why, "give another port.")
    yield may_listen("metrics", asked.program.metrics.listen(), _try_to_listen, asked.system)


def _same_as_page(program: Config) -> str:
    """Return a sentence that says that the live page has the port of the metrics; empty if it has not."""
    if program.dashboard.address is None:
        return ""
    (host, port), (page_host, page_port) = program.metrics.listen(), program.dashboard.listen()
    is_same = port and port == page_port and (host == page_host or {host, page_host} & EVERYWHERE)
    return f"the live page has the port {port}, too." if is_same else ""


def _try_to_listen(host: str, port: int) -> None:
    listen(host, port, BaseHTTPRequestHandler).server_close()
