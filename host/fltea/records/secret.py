"""Refuse passwords in addresses, in settings and command lines, and hide them in the program's messages.

Everybody on a machine can read the command lines of all its programs. Records, recordings and messages show
addresses, too. A password in an address would be public, so such an address is refused, and the error names a
safer place for the password of this kind of server.
"""

import re
from collections.abc import Iterable
from typing import NamedTuple

from fltea.records.errors import UsageError


class Kind(NamedTuple):
    """How the addresses of one kind of server may hold a secret, and where the secret belongs.

    `shows`: regular expression that finds a secret in the text after `://`. `better`: advice for the error.
    """

    shows: str
    better: str


SERVER = r"@"
FILE = r"^[^/]*@|^[^/@]*:(?!\d*(?:/|$))[^@]*@"
"""Regular expression that finds a secret in an address whose scheme is not in `KINDS`. An @ in the path is no
secret, and neither is a number after a colon, which is a port.
"""

PASSWORD = r"(?:^|[\s?&])(?:ssl)?password\s*="

KINDS = {
    "mqtt": Kind(
        SERVER,
        "User and password come from FLTEA_MQTT_USER and FLTEA_MQTT_PASSWORD, or from a file "
        "(mqtt.password_file).",
    ),
    "nats": Kind(SERVER, "User and password come from FLTEA_NATS_USER and FLTEA_NATS_PASSWORD."),
    "dask": Kind(
        SERVER, "A cluster recognizes its users by certificates; Dask's own settings name the certificates."
    ),
    "postgresql": Kind(rf"^[^@]*:[^@]*@|{PASSWORD}", "The password comes from PGPASSWORD or ~/.pgpass."),
    "hwgrep": Kind(r"(?!)", ""),
}
"""Kinds of addresses by their scheme. Only a PostgreSQL address may contain a user, and it must not contain a
password.
"""

SAME = {"mqtts": "mqtt", "postgres": "postgresql", **dict.fromkeys(("tcp", "tls", "ws", "wss"), "dask")}
OTHERS = Kind(FILE, "Credentials come from the environment, of workers too (host/docs/guide/cluster.md).")

_SCHEME = re.compile(r"([A-Za-z][A-Za-z0-9+.-]*)://")
_USER = re.compile(r"://\S*@")
_VALUE = re.compile(
    r"([?&\s](?:\w*password|\w*token|sig|signature|x-amz-[a-z-]+)\s*=\s*)[^&\s]+", re.IGNORECASE
)


def refuse_secret(name: str, text: str, kind: str = "") -> None:
    """Refuse an address with a password in it.

    `name`: name of the option, for the message, which quotes nothing from the address.
    `kind`: the key of `KINDS` that applies where the address has no scheme.

    Raises:
        UsageError: the address holds a user or a password.
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
    """Refuse a command line if any of its words is an address with a password (see `refuse_secret`)."""
    option = "command line"
    for word in words:
        option = word.partition("=")[0] if word.startswith("-") else option
        refuse_secret(option, word)


def hidden(text: str) -> str:
    """Return a message in which the user, password and signature of every address are replaced by "…"."""
    return _VALUE.sub(r"\1…", _USER.sub("://…@", text)) if "://" in text or "=" in text else text
