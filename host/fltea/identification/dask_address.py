"""Check the address of a Dask scheduler, and warn about machines that its user has to trust.

This module does not import Dask.
"""

import ipaddress
import re
from urllib.parse import urlsplit

from fltea.records.errors import UsageError
from fltea.records.secret import refuse_secret

SCHEMES = ("tcp", "tls", "ws", "wss")
ENCRYPTED = ("tls", "wss")
HOST_AND_PORT = re.compile(r"(?P<host>\[[0-9A-Fa-f:.%]+\]|[^\s\[\]@/?#:]*)(?::(?P<port>[^\s@/?#:]*))?")
MOST_PORT = 65_535


def check_address(address: str) -> None:
    """Refuse an address at which no scheduler can listen.

    An address without a scheme stands for tcp://, as in Dask.

    Raises:
        UsageError: the address is refused.
    """
    refuse_secret("--dask", address, "dask")
    reason = _wrong_with(address)
    if reason:
        raise UsageError(
            f"--dask {address}: {reason}. Write the address that the scheduler's log gives: tcp://HOST:8786, "
            "or with certificates tls://HOST:8786."
        )


def _wrong_with(address: str) -> str:
    scheme, separator, place = address.rpartition("://")
    if separator and scheme not in SCHEMES:
        return f"{scheme}:// is not spoken by schedulers (known: {', '.join(SCHEMES)})"
    if place.partition("]")[0].count(":") > 1 and not HOST_AND_PORT.fullmatch(place):
        return "write an IPv6 address in brackets, as in tcp://[::1]:8786"
    found = HOST_AND_PORT.fullmatch(place)
    if found is None:
        return "is more than a host and a port"
    if not found["host"]:
        return "has no host"
    port = found["port"] or ""
    if not (port.isascii() and port.isdecimal() and 0 < int(port) <= MOST_PORT):
        return f"has no port from 1 to {MOST_PORT}"
    return ""


def trust_warning(address: str) -> str | None:
    """Return the warning to print before a cluster is used, or None.

    There is nothing to warn about if the connection is encrypted, or stays on this machine.
    """
    try:
        url = urlsplit(address if "://" in address else f"tcp://{address}")
        if url.scheme in ENCRYPTED or _is_loopback(url.hostname or ""):
            return None
    except ValueError:  # the text is not an address; leave it to Dask to say so
        return None
    return (
        f"--dask {address}: not encrypted, and nothing says who answers there. What Dask sends are pickles, "
        "so whoever reaches the scheduler or a worker, or stands in for one, can run any program as you, and "
        "read the recordings. Use tls:// with certificates (host/docs/guide/verdict.md, A Dask cluster), or "
        "a tunnel to this machine's loopback."
    )


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
