"""The address at which a page or an endpoint of ours is reached: PORT or HOST:PORT."""

import ipaddress

LOOPBACK = "127.0.0.1"


def listen_address(text: str) -> tuple[str, int]:
    """Host and port; without a host the loopback, so that nobody else on the network can connect.

    Raises:
        ValueError: no such address can be.
    """
    host, colon, port = text.strip().rpartition(":")
    if host.startswith("[") and host.endswith("]"):
        host = host[1:-1]
    elif ":" in host:
        raise ValueError("address: put an IPv6 host into brackets: [::1]:9100")
    if (colon and not host) or not (port.isascii() and port.isdigit()) or int(port) > 65535:
        raise ValueError("address must be PORT or HOST:PORT, for instance 9100 or 0.0.0.0:9100")
    return host or LOOPBACK, int(port)


def is_loopback(host: str) -> bool:
    """Whether only this machine reaches what listens there."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host.lower() == "localhost"
