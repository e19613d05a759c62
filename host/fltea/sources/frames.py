"""One device of many behind a broker, whose frames come as messages that somebody else receives."""

from collections.abc import Callable, Iterator

from fltea.records.clock import host_ns
from fltea.records.events import Chunk, Event, Opened, Reads, TransportEvent
from fltea.records.stats import LinkStats
from fltea.sources.wire_events import Hints, WireEvents

HINTS = Hints(
    "Is the device running, and does it still reach the broker?",
    "A message has to hold COBS frames as they come from the device, whole ones, and nothing else.",
)


class FramesSource:
    """Turns the frames of one device into events. Whoever receives its messages feeds them to `take`.

    url: names it in texts. overflow_bytes: gives what was thrown away before it came here. tap: is given all
    that comes, before anything interprets it.
    """

    live = prompt = True

    def __init__(self, url: str, overflow_bytes: Callable[[], int]) -> None:
        self.url = url
        self._overflow_bytes = overflow_bytes
        self._wire = WireEvents(url, HINTS)
        self.tap: Callable[[TransportEvent | Reads], None] | None = None

    @property
    def unix_offset_ns(self) -> int:
        """The difference from the monotonic clock to Unix time in ns, as of the last message."""
        return self._wire.unix_offset_ns

    def events(self) -> Iterator[Event]:
        """Yield nothing, since messages are received for many devices together."""
        return iter(())

    def open(self, now_ns: int, unix_offset_ns: int) -> Iterator[Event]:
        """Yield the events of the first message of a device."""
        return self.take(Opened(now_ns, unix_offset_ns))

    def take(self, item: Opened | Chunk | Reads | None) -> Iterator[Event]:
        """Yield the events of a message, or of several; None says that none came for a while."""
        if item is not None and self.tap is not None:
            self.tap(item)
        if item is None:
            now_ns = host_ns()
        else:
            now_ns = int(item.host_ns[0]) if isinstance(item, Reads) else item.host_ns
        self._wire.resume(now_ns)  # a device has its turn when it has said something: never a stall of ours
        yield from self._wire.feed(item, now_ns)

    def forgive(self, now_ns: int) -> None:
        """Begin all waiting again: nobody could have been heard until now."""
        self._wire.forgive(now_ns)

    def link_stats(self) -> LinkStats:
        """Count what arrived and what was lost on the way."""
        return self._wire.link_stats(self._overflow_bytes())

    def close(self) -> None:
        """Do nothing, since nothing is open here."""
