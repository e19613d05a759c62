"""What a device is called in its topics, and what the topic of its status says."""

import re
from typing import Literal

import msgspec

from fltea.records.records import Hello

LONGEST_NAME = 64
"""Characters of a device's level in its topics; a recording may say an identifier of any length."""


class Status(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What `<prefix>/<device_id>/status` says, retained.

    since_ns: Unix time since which it is so; null where the broker says it for us. reason, when offline:
    `ended`, `connection_lost` (the broker lost sight of the program), or `replaced` (by another board on the
    same port).
    """

    status: Literal["online", "stalled", "offline"]
    since_ns: int | None
    source: str
    device_id: str | None
    device: str
    reason: Literal["ended", "connection_lost", "replaced"] | None = None


def device_level(hello: Hello, device: str) -> str:
    """The board's own identifier, else the device's name, as one level of a topic."""
    name = (hello.device_id or device)[:LONGEST_NAME]
    return re.sub(r"[+#/\x00-\x1f\x7f-\x9f]", "_", name) or "_"
