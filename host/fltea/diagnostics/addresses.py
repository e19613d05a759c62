"""Checks of network addresses: whether a server answers there, or may listen there.

What the settings name is tried by the functions by which `fltea run` uses it.
"""

import errno
import socket
from collections.abc import Callable
from typing import TYPE_CHECKING

from fltea.diagnostics.finding import Finding, ok, problem, warning
from fltea.records.errors import FlteaError

if TYPE_CHECKING:
    from fltea.diagnostics.host_system import System

CONNECT_S = 3.0

REMEDY = "a second fltea run is refused there: end the first one, or give another port."
"""What to do if another `fltea run` listens at an address."""


def answers(check: str, server: str, host: str, port: int) -> Finding:
    """Return whether something answers at an address. `server`: what should answer there, for the text."""
    try:
        socket.create_connection((host, port), CONNECT_S).close()
    except (OSError, UnicodeError) as error:
        why = "no machine can have this name" if isinstance(error, UnicodeError) else error.strerror or error
        return problem(
            check,
            f"the {server} at {host}, port {port}, cannot be reached ({why}).",
            "is it running, does it listen on that address and port, is a firewall between? fltea goes on "
            "without it and tries again.",
        )
    return ok(
        check, f"something answers at {host}, port {port}; 'fltea run' shows whether it accepts the login"
    )


def may_listen(
    check: str, address: tuple[str, int], listen: Callable[[str, int], None], system: "System"
) -> Finding:
    """Return whether a server of this program may listen at an address.

    `check`: name of the check. `listen`: begins to listen at a host and port, as `fltea run` does, and ends.
    """
    host, port = address
    try:
        listen(host, port)
    except FlteaError as error:
        if getattr(error.__cause__, "errno", None) != errno.EADDRINUSE:
            return problem(check, str(error))
        return _taken(check, f"{host}:{port}", port, system)
    return ok(check, f"{host}:{port} is free")


def _taken(check: str, where: str, port: int, system: "System") -> Finding:
    """Return a finding on a network port that another program has taken; fltea itself may be that program."""
    holders = system.listeners(port)
    names = ", ".join(map(str, holders))
    if holders and all("fltea" in holder.program for holder in holders):
        return warning(check, f"{where} is taken by {names}, which is running.", REMEDY)
    if not holders and system.is_running("fltea"):
        return warning(check, f"{where} is taken, probably by the fltea that is running.", REMEDY)
    if holders:
        return problem(check, f"{where} is taken by {names}.", "end that program, or give another port.")
    remedy = f"ss -ltnp 'sport = :{port}' names that program."
    return problem(check, f"{where} is taken by another program.", remedy)
