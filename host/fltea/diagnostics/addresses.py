"""Checks of network addresses: whether a server answers there, or may listen there."""

import errno
import socket
from typing import TYPE_CHECKING

from fltea.diagnostics.finding import Finding, ok, problem
from fltea.settings.outputs import listen_address

if TYPE_CHECKING:
    from fltea.diagnostics.host_system import System

CONNECT_S = 3.0


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


def may_listen(check: str, address: str, system: "System") -> Finding:
    """Return whether a server of this program may listen at `address`. `check`: name of the check."""
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
