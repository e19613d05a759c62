"""Choose the receiver for a broker by the broker's URL, and load the library that the receiver needs."""

import re
from collections.abc import Callable
from functools import partial
from urllib.parse import urlsplit

import msgspec

from fltea.records.errors import UsageError
from fltea.records.ports import Report
from fltea.service.ingest.inbox import Inbox
from fltea.service.ingest.receiver import Receiver
from fltea.settings.config import Config
from fltea.settings.extras import load


def receiver_of(config: Config) -> Callable[[Inbox, Report], Receiver]:
    """Return a function that makes the receiver. Its arguments are an inbox and a function for reports.

    Raises:
        UsageError: the URL is not the address of a broker, or a library is not installed.
    """
    source = config.source or ""
    if source.startswith("nats:"):
        # the message leaves the URL out, which may contain a password
        if not all(map(_is_address, source.split(","))):
            raise UsageError(
                "--source nats: give nats://HOST[:PORT], PORT 1 to 65535, or several of these, separated by "
                "commas. User and password come from FLTEA_NATS_USER and FLTEA_NATS_PASSWORD."
            )
        module = load("fltea.service.ingest.nats", "nats", "nats", "a source of NATS needs")
        return partial(module.NatsFrames, config)
    if "://" not in source:
        raise UsageError(
            "--source mqtt: give the broker's address: mqtt://HOST[:PORT] or mqtts://HOST[:PORT]."
        )
    try:
        settings = msgspec.structs.replace(config.mqtt, broker=source)
    except ValueError as error:  # the text of this error leaves the address out, which may contain a password
        raise UsageError(f"--source: {str(error).replace('broker', 'an mqtt source', 1)}.") from error
    module = load("fltea.service.ingest.mqtt", "paho", "mqtt", "a source behind a broker needs")
    return partial(module.MqttFrames, settings)


def _is_address(url: str) -> bool:
    """Return whether the URL is nats://HOST[:PORT]; HOST may be an IPv6 address in brackets."""
    if not re.fullmatch(r"nats://[^@/?#,\s]+", url):
        return False
    try:
        parts = urlsplit(url)
        return bool(parts.hostname) and not parts.netloc.endswith(":") and parts.port != 0
    # ValueError is raised if the port is no number or too large, or a bracket is not closed
    except ValueError:
        return False
