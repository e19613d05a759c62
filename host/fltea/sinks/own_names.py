"""Names under which this machine may be asked over HTTP, so that no other site's name can come to mean it.

A page of somebody else's site could let its own name resolve to this machine (DNS rebinding) and then read
what we serve as its own; its requests still name that site as their `Host`. Bare addresses are no names, so
they pass.
"""

import ipaddress
import socket
from collections.abc import Collection
from urllib.parse import urlsplit


def own_names(host: str, others: Collection[str]) -> set[str]:
    """Names under which what listens at `host` may be asked for, in lower case."""
    machine = socket.gethostname()
    names = {"localhost", host, machine, machine.partition(".")[0] + ".local", *others}
    return {name.lower() for name in names}


def is_own(host: str, names: Collection[str]) -> bool:
    """Whether a request's `Host`, with or without a port, is one of `names` or a bare address."""
    try:
        name = (urlsplit(f"//{host.lower()}").hostname or "").rstrip(".")
    except ValueError:  # no URL at all
        return False
    return name in names or _is_address(name)


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True
