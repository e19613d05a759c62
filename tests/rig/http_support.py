"""Requests to servers of this machine."""

import http.client
from typing import NamedTuple
from urllib.parse import urlsplit

from host_support import PATIENCE_S


class Answer(NamedTuple):
    status: int
    text: str
    headers: dict[str, str]


def port_of(url: str) -> int:
    port = urlsplit(url).port
    assert port is not None
    return port


def ask(port: int, path: str = "/", method: str = "GET", skip_host: bool = False, **headers: str) -> Answer:
    """Send a request without a body; underscores in the names of headers stand for hyphens."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=PATIENCE_S)
    try:
        connection.putrequest(method, path, skip_host=skip_host or "Host" in headers)
        for name, value in headers.items():
            connection.putheader(name.replace("_", "-"), value)
        connection.endheaders()
        answer = connection.getresponse()
        return Answer(answer.status, answer.read().decode(), dict(answer.getheaders()))
    finally:
        connection.close()
