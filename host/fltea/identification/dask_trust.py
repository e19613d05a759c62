"""Whom a Dask cluster makes one trust."""

import ipaddress
from urllib.parse import urlsplit

ENCRYPTED = ("tls", "wss")


def trust_warning(address: str) -> str | None:
    """Return what to say before a cluster at `address` is used.

    None if nobody else can be on the way to it.
    """
    try:
        url = urlsplit(address if "://" in address else f"tcp://{address}")
        if url.scheme in ENCRYPTED or _is_loopback(url.hostname or ""):
            return None
    except ValueError:  # no address: Dask says so
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
