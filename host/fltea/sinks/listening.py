"""Decide which requests the HTTP servers answer, by the header `Host` of the request.

Another web site could let its own name resolve to this machine (DNS rebinding). A page of that site could
then read this server's answers. Requests from such a page have the site's name as their `Host`, so they are
refused. If the `Host` is an IP address, the request is answered, since an IP address cannot be redirected in
this way.
"""

import errno
import ipaddress
import socket
from collections.abc import Collection
from urllib.parse import urlsplit

from fltea.records.errors import FlteaError, UsageError


def own_names(host: str, others: Collection[str]) -> set[str]:
    """Return the names that the `Host` of a request to a server at `host` may have, in lower case."""
    machine = socket.gethostname()
    names = {"localhost", host, machine, machine.partition(".")[0] + ".local", *others}
    return {name.lower() for name in names}


def is_own(host: str, names: Collection[str]) -> bool:
    """Return whether a request's `Host`, with or without a port, is one of `names` or an IP address."""
    try:
        name = (urlsplit(f"//{host.lower()}").hostname or "").rstrip(".")
    except ValueError:  # ValueError is raised if the text is no URL
        return False
    return name in names or _is_address(name)


def is_from_here(host: str, origin: str | None) -> bool:
    """Return whether a request comes from a page of this server, or from no page at all.

    `origin`: the header `Origin`, by which a browser names the page's server.
    """
    try:
        return origin is None or urlsplit(origin).netloc.lower() == host.lower()
    except ValueError:  # ValueError is raised if the text is no URL
        return False


def url_of(host: str, port: int) -> str:
    """Return the URL of a server."""
    return f"http://{f'[{host}]' if ':' in host else host}:{port}/"


def cannot_listen(option: str, host: str, port: int, error: Exception) -> FlteaError:
    """Return the error for a server that cannot listen at its address.

    `option`: name of the setting that gives the address.
    """
    if isinstance(error, PermissionError):
        return UsageError(
            f"{option}: ports below 1024 need the rights of root: give a port from 1024 on, not {port}."
        )
    number = getattr(error, "errno", None)
    if number == errno.EADDRINUSE:
        return FlteaError(
            f"{option}: port {port} of {host} is taken by another program (another fltea?): give another "
            f"port, or end that program; `ss -ltnp 'sport = :{port}'` names it."
        )
    if isinstance(error, socket.gaierror | UnicodeError) or number == errno.EADDRNOTAVAIL:
        return UsageError(
            f"{option}: {host} is not an address of this machine: leave it out for the loopback, or give "
            "0.0.0.0 to be reached from the network."
        )
    return UsageError(f"{option}: cannot listen on {host}:{port}: {error}.")


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True
