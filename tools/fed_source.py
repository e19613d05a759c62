"""A source of samples for tests and tools.

The caller itself supplies the transport events, such as received bytes.
"""

from collections.abc import Iterator

from fltea.records.events import Event
from fltea.records.stats import LinkStats
from fltea.sources.wire_events import WireEvents


class FedSource:
    """Stands for the source of a serial port in a pipeline (the processing of one device's samples).

    `prompt`: see `fltea.records.ports.Source`.
    """

    live = True

    def __init__(self, url: str, *, prompt: bool = True) -> None:
        self.wire, self.prompt = WireEvents(url), prompt

    @property
    def unix_offset_ns(self) -> int:
        return self.wire.unix_offset_ns

    def events(self) -> Iterator[Event]:
        """Return no events, because the caller feeds `wire` directly."""
        return iter(())

    def link_stats(self) -> LinkStats:
        """Return the counts of bytes and frames that arrived."""
        return self.wire.link_stats()

    def close(self) -> None:
        """Do nothing, since there is no port to close."""
