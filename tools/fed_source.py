"""A source whose transport events are given to its wire by hand, in whatever time."""

from collections.abc import Iterator

from fltea.records.events import Event
from fltea.records.stats import LinkStats
from fltea.sources.wire_events import WireEvents


class FedSource:
    """What a pipeline asks of a source on a port; prompt: see `fltea.records.ports.Source`."""

    live = True

    def __init__(self, url: str, *, prompt: bool = True) -> None:
        self.wire, self.prompt = WireEvents(url), prompt

    @property
    def unix_offset_ns(self) -> int:
        """Return that of the wire."""
        return self.wire.unix_offset_ns

    def events(self) -> Iterator[Event]:
        """Return none: they come from `wire`."""
        return iter(())

    def link_stats(self) -> LinkStats:
        """Count what arrived."""
        return self.wire.link_stats()

    def close(self) -> None:
        """Release nothing."""
