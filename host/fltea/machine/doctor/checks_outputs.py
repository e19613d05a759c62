"""Checks of the outputs: disk space, the broker, and the network ports of the page and of the metrics.

Files and network ports that the settings name are tried by the functions by which `fltea run` opens them.
"""

from collections.abc import Iterator, Sequence
from http.server import BaseHTTPRequestHandler
from pathlib import Path

from fltea.diagnostics.asked import AskedOutput
from fltea.diagnostics.finding import Finding, problem
from fltea.diagnostics.folders import check_writable
from fltea.diagnostics.host_system import System
from fltea.records.errors import FlteaError
from fltea.service.state import check_file
from fltea.settings.config import Config
from fltea.settings.login_file import read_login
from fltea.settings.outputs import OUTPUTS

CONNECT_S = 3.0
DAYS_LEFT = 7.0
TYPICAL_BYTES_PER_S = 32_000.0
"""Rate at which a recording of one device at 100 Hz with all channels grows [bytes/s], as measured."""

SERVICE_USER = "fltea"


def check_outputs(configs: Sequence[Config], system: System) -> Iterator[Finding]:
    """Yield findings on every output that the configuration switches on, and on the file of snapshots.

    An output whose library is not installed is left out here: `check_packages` reports it.
    """
    config = configs[0]  # the configuration of outputs is the same for all devices
    checked: set[str] = set()
    for output in OUTPUTS:
        # two rows may have one name, for single devices and for shared sources; their check is the same
        if not output.is_on(config) or output.name in checked:
            continue
        checked.add(output.name)
        if not output.library or system.has_module(output.library):
            yield from output_module(output).check_output(AskedOutput(configs, system))
    if config.state.file is not None:
        yield from _snapshot(Path(config.state.file))


def _snapshot(file: Path) -> Iterator[Finding]:
    folder = file.parent
    if file.is_dir():
        yield problem("state", f"{file} is a folder.", "give the name of a file.")
    elif not folder.exists():
        yield problem("state", f"there is no folder {folder}.", f"mkdir -p {folder}")
    elif found := list(_writable("state", folder)):
        yield from found
    else:
        yield from refused("state", lambda: check_file(file))


def _broker(configs: Sequence[Config], system: System) -> Iterator[Finding]:
    host, port, *_ = configs[0].mqtt.address()
    if system.has_module("paho"):
        from fltea.mqtt.broker import Broker

        yield from refused("mqtt", lambda: Broker(configs[0].mqtt))
    yield answers("mqtt", "broker", host, port)


def answers(check: str, server: str, host: str, port: int) -> Finding:
    """Return whether something answers at an address. `server`: what should answer there, for the text."""
    try:
        socket.create_connection((host, port), CONNECT_S).close()
    except OSError as error:
        return problem(
            check,
            f"the {server} at {host}, port {port}, cannot be reached ({error.strerror or error}).",
            "is it running, does it listen on that address and port, is a firewall between? fltea goes on "
            "without it and tries again.",
        )
    return ok(
        check, f"something answers at {host}, port {port}; 'fltea run' shows whether it accepts the login"
    )


def _page(configs: Sequence[Config], system: System) -> Iterator[Finding]:
    settings = configs[0].dashboard
    file = settings.password_file
    if file is not None:
        yield from refused("dashboard", lambda: read_login("dashboard.password_file", file))
    if system.has_module("tornado"):
        yield _listener("dashboard", settings.listen(), _listen_for_pages, system)


def _metrics(configs: Sequence[Config], system: System) -> Iterator[Finding]:
    address, page = configs[0].metrics.listen(), configs[0].dashboard
    if page.address is not None and address[1] and address == page.listen():
        yield problem("metrics", f"the live page has the port {address[1]}, too.", "give another port.")
    if system.has_module("prometheus_client"):
        yield _listener("metrics", address, _listen_for_metrics, system)


def _listen_for_pages(host: str, port: int) -> None:
    from fltea.sinks.web.door import bind  # needs the library tornado

    for one in bind("--dashboard", host, port):
        one.close()


def _listen_for_metrics(host: str, port: int) -> None:
    from fltea.sinks.metrics.sink import listen  # needs the library prometheus_client

    listen(host, port, BaseHTTPRequestHandler).server_close()


def refused(check: str, use: Callable[[], object]) -> Iterator[Finding]:
    """Yield a problem if `use`, which does what `fltea run` would do, refuses a setting."""
    try:
        use()
    except FlteaError as error:
        yield problem(check, str(error))


def _listener(
    check: str, address: tuple[str, int], listen: Callable[[str, int], None], system: System
) -> Finding:
    host, port = address
    try:
        listen(host, port)
    except FlteaError as error:
        if getattr(error.__cause__, "errno", None) != errno.EADDRINUSE:
            return problem(check, str(error))
        return _taken(check, f"{host}:{port}", port, system)
    return ok(check, f"{host}:{port} is free")


def _taken(check: str, where: str, port: int, system: System) -> Finding:
    """Return a finding on a network port that another program has taken; fltea itself may be that program."""
    holders = system.listeners(port)
    names = ", ".join(map(str, holders))
    if holders and all("fltea" in holder.program for holder in holders):
        return ok(check, f"{where} is taken by {names}, which is running")
    if not holders and system.is_running("fltea"):
        return ok(check, f"{where} is taken, probably by the fltea that is running")
    if holders:
        return problem(check, f"{where} is taken by {names}.", "end that program, or give another port.")
    remedy = f"ss -ltnp 'sport = :{port}' names that program."
    return problem(check, f"{where} is taken by another program.", remedy)


CHECKS: dict[str, Callable[[Sequence[Config], System], Iterator[Finding]]] = {
    "record": _recordings,
    "mqtt": _broker,
    "metrics": _metrics,
    "dashboard": _page,
}
"""Function that checks an output, by the output's name in `OUTPUTS`. Standard output needs no check."""
