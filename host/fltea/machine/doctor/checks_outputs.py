"""Checks of the outputs: disk space, the broker, and the network ports of the page and of the metrics."""

import errno
import itertools
import os
import socket
import statistics
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from fltea.machine.doctor.finding import Finding, ok, problem, warning
from fltea.machine.host_system import System, first_existing
from fltea.settings.config import Config
from fltea.settings.outputs import OUTPUTS, listen_address

CONNECT_S = 3.0
DAYS_LEFT = 7.0
TYPICAL_BYTES_PER_S = 32_000.0
"""Rate at which a recording of one device at 100 Hz with all channels grows [bytes/s], as measured."""

SERVICE_USER = "fltea"


def check_outputs(configs: Sequence[Config], system: System) -> Iterator[Finding]:
    """Yield findings on every output that the configuration switches on, and on the file of snapshots."""
    config = configs[0]  # the configuration of outputs is the same for all devices
    for name in dict.fromkeys(output.name for output in OUTPUTS if output.is_on(config)):
        if name in CHECKS:
            yield from CHECKS[name](configs, system)
    if config.state.file is not None:
        yield from _snapshot(Path(config.state.file))


def _recordings(configs: Sequence[Config], system: System) -> Iterator[Finding]:
    devices, folder = len(configs), Path(configs[0].record.folder or "")
    yield from _writable("recordings", folder)
    free_bytes, known = system.free_bytes(folder), _recording_rate(folder)
    bytes_per_s = known or TYPICAL_BYTES_PER_S * devices
    days = free_bytes / bytes_per_s / 86400
    source = "as the last recordings grew" if known else f"a guess for {devices} at 100 Hz"
    rate = f"{bytes_per_s * 86400 / 1e9:.2g} GB a day, {source}"
    text = f"{free_bytes / 1e9:.1f} GB free for {folder}: {days:.0f} days ({rate})"
    if days < DAYS_LEFT:
        remedy = "move old recordings away, or record to another disk; recording stops while it is full."
        yield warning("disk", f"only {text}.", remedy)
    else:
        yield ok("disk", text)


def _recording_rate(folder: Path) -> float | None:
    """Return the rate at which the last recordings grew [bytes/s]; None if there are too few recordings."""
    try:
        files = [path.stat() for path in folder.rglob("*.mcap")]
    except OSError:
        return None
    files = sorted(files, key=lambda status: status.st_mtime)[-20:]
    rates = [
        status.st_size / (status.st_mtime - before.st_mtime)
        for before, status in itertools.pairwise(files)
        if status.st_mtime - before.st_mtime > 1.0
    ]
    return statistics.median(rates) if rates else None


def _writable(check: str, folder: Path) -> Iterator[Finding]:
    existing = first_existing(folder)
    if not existing.is_dir():
        yield problem(check, f"{existing} is no folder.", "give another one.")
    elif not os.access(existing, os.W_OK | os.X_OK):
        owner = existing.owner()
        if owner == SERVICE_USER:
            yield ok(check, f"{folder} is the service's, which writes as the user '{owner}'")
        else:
            remedy = f"choose another folder, or: sudo install -d -o $USER {folder}"
            yield problem(check, f"{folder} cannot be written ({existing} belongs to {owner}).", remedy)


def _snapshot(file: Path) -> Iterator[Finding]:
    folder = file.parent
    if file.is_dir():
        yield problem("state", f"{file} is a folder.", "give the name of a file.")
    elif folder.exists():
        yield from _writable("state", folder)
    else:
        yield problem("state", f"there is no folder {folder}.", f"mkdir -p {folder}")


def _broker(configs: Sequence[Config], system: System) -> Iterator[Finding]:
    host, port, *_ = configs[0].mqtt.address()
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
    yield _listener("dashboard", str(configs[0].dashboard.address), system)


def _metrics(configs: Sequence[Config], system: System) -> Iterator[Finding]:
    yield _listener("metrics", str(configs[0].metrics.address), system)


def _listener(check: str, address: str, system: System) -> Finding:
    try:
        host, port = listen_address(address)
    except ValueError as error:
        return problem(check, f"{error}.")
    try:
        family, kind, protocol, _, where = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind, protocol) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(where)
    except OSError as error:
        if error.errno == errno.EADDRINUSE and system.is_running("fltea"):
            return ok(check, f"{host}:{port} is taken, probably by the fltea that is running")
        if error.errno == errno.EADDRINUSE:
            return problem(
                check,
                f"{host}:{port} is taken by another program.",
                f"ss -ltnp 'sport = :{port}' names that program.",
            )
        return problem(
            check, f"{host}:{port} cannot be used ({error.strerror or error}).", "give PORT or HOST:PORT."
        )
    return ok(check, f"{host}:{port} is free")


CHECKS: dict[str, Callable[[Sequence[Config], System], Iterator[Finding]]] = {
    "record": _recordings,
    "mqtt": _broker,
    "metrics": _metrics,
    "dashboard": _page,
}
"""Function that checks an output, by the output's name in `OUTPUTS`. Standard output needs no check."""
