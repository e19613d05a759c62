"""Choose the receiver for a broker by the broker's URL, and load the library that the receiver needs."""

from collections.abc import Callable
from functools import partial

from fltea.records.ports import Report
from fltea.service.ingest.inbox import Inbox
from fltea.service.ingest.receiver import Receiver
from fltea.settings.config import Config
from fltea.settings.extras import load
from fltea.settings.ingest import broker_at, is_partitioned, nats_servers
from fltea.settings.sources import kind_of


def receiver_of(config: Config) -> Callable[[Inbox, Report], Receiver]:
    """Return a function that makes the receiver. Its arguments are an inbox and a function for reports.

    Raises:
        UsageError: the URL is not the address of a broker, or a library is not installed.
    """
    source, kind = config.source or "", kind_of(config.source)
    assert kind is not None
    if is_partitioned(source):
        nats_servers(source)
        module = load("fltea.service.ingest.nats", kind.library, kind.extra, "a source of NATS needs")
        return partial(module.NatsFrames, config)
    settings = broker_at(source, config.mqtt)
    who_needs = "a source behind a broker needs"
    module = load("fltea.service.ingest.mqtt", kind.library, kind.extra, who_needs)
    return partial(module.MqttFrames, settings)
