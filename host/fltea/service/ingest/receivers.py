"""Load the module that receives what comes from a broker, as the broker's URL says."""

from collections.abc import Callable
from typing import cast

from fltea.records.ports import Report
from fltea.service.ingest.inbox import Inbox
from fltea.service.ingest.receiver import Receiver, ReceiverModule
from fltea.settings.config import Config
from fltea.settings.extras import load
from fltea.settings.sources import kind_of


def receiver_of(config: Config) -> Callable[[Inbox, Report], Receiver]:
    """Return a function that makes the receiver. Its arguments are an inbox and a function for reports.

    Raises:
        UsageError: the URL is not the address of a broker, or a library is not installed.
    """
    kind = kind_of(config.source)
    assert kind is not None
    who_needs = f"a source of {kind.example} needs"
    module = cast(ReceiverModule, load(kind.module, kind.library, kind.extra, who_needs))
    return module.receiver_of(config)
