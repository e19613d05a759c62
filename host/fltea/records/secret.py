"""Passwords in addresses: refused where an address comes in, and hidden in every line of ours.

Everybody on a machine can read the command lines of all its programs, and records, recordings and messages
repeat an address. So no address may hold a password, and each kind of server has a better way.
"""

import re
from collections.abc import Iterable
from typing import NamedTuple

from fltea.records.errors import UsageError


class Kind(NamedTuple):
    """How a secret shows in what stands behind `://`, and where it belongs."""

    shows: str
    better: str


SERVER = r"@"
FILE = r"^[^/]*@|^[^/@]*:(?!\d*(?:/|$))[^@]*@"
"""An @ may be in a path; a port is a number."""

PASSWORD = r"(?:^|[\s?&])(?:ssl)?password\s*="

KINDS = {
    "mqtt": Kind(
        SERVER,
        "User and password come from FLTEA_MQTT_USER and FLTEA_MQTT_PASSWORD, or from a file "
        "(mqtt.password_file).",
    ),
    "nats": Kind(SERVER, "User and password come from FLTEA_NATS_USER and FLTEA_NATS_PASSWORD."),
    "dask": Kind(SERVER, "A cluster knows its users by certificates, which Dask's own settings name."),
    "postgresql": Kind(rf"^[^@]*:[^@]*@|{PASSWORD}", "The password comes from PGPASSWORD or ~/.pgpass."),
    "hwgrep": Kind(r"(?!)", ""),
}
"""By scheme; a server's user is told apart from its password by PostgreSQL alone."""

SAME = {"mqtts": "mqtt", "postgres": "postgresql", **dict.fromkeys(("tcp", "tls", "ws", "wss"), "dask")}
OTHERS = Kind(FILE, "Credentials come from the environment, of workers too (host/docs/guide/cluster.md).")

_SCHEME = re.compile(r"([A-Za-z][A-Za-z0-9+.-]*)://")
_USER = re.compile(r"://\S*@")
_VALUE = re.compile(
    r"([?&\s](?:\w*password|\w*token|sig|signature|x-amz-[a-z-]+)\s*=\s*)[^&\s]+", re.IGNORECASE
)


def refuse_secret(name: str, text: str, kind: str = "") -> None:
    """Refuse an address with a password in it.

    name: of the option, for the message, which holds nothing of the address. kind: of `KINDS`, where an
    address may have no scheme.

    Raises:
        UsageError: then.
    """
    places = [(found[1].lower(), text[found.end() :]) for found in _SCHEME.finditer(text)]
    for scheme, place in places or [(kind, text)] * bool(kind):
        known = KINDS.get(SAME.get(scheme, scheme), OTHERS)
        if re.search(known.shows, place):
            raise UsageError(
                f"{name}: an address must not hold a user or a password, since others can read command "
                f"lines, files and records. {known.better}"
            )


def refuse_secrets(words: Iterable[str]) -> None:
    """Refuse a command line of which a word is an address with a password in it; see `refuse_secret`."""
    option = "command line"
    for word in words:
        option = word.partition("=")[0] if word.startswith("-") else option
        refuse_secret(option, word)


def hidden(text: str) -> str:
    """Return a line of ours in which no address shows a user, a password or a signature."""
    return _VALUE.sub(r"\1…", _USER.sub("://…@", text)) if "://" in text or "=" in text else text
