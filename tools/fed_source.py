"""A source for tests and tools that has no port.

Whoever uses it hands over the bytes that a port would have received.
"""

from collections.abc import Iterator

from fltea.records.events import Event
from fltea.records.stats import LinkStats
from fltea.sources.wire_events import WireEvents


class FedSource:
    """A source that takes the place of a serial port in a pipeline (the processing of one device's samples).

    `prompt`: whether the samples arrive in real time.
    """

    live = has_clock = True

    def __init__(self, url: str, *, prompt: bool = True) -> None:
        self.wire, self.prompt = WireEvents(url), prompt

    @property
    def unix_offset_ns(self) -> int:
        return self.wire.unix_offset_ns

    def events(self) -> Iterator[Event]:
        """Return no events: the caller gets them from `wire.feed`, to which it hands the bytes."""
        return iter(())

    def link_stats(self) -> LinkStats:
        """Return the counts of bytes and frames that arrived."""
        return self.wire.link_stats()

    def close(self) -> None:
        """Do nothing, since there is no port to close."""
