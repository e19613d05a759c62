"""Turns the frames of one device that publishes to an MQTT broker into events.

Another object receives the device's messages from the broker, and passes them on to the class here.
"""

from collections.abc import Callable, Iterator

from fltea.records.clock import host_ns
from fltea.records.events import Chunk, Event, Opened, Reads, TransportEvent
from fltea.records.stats import LinkStats
from fltea.sources.wire_events import Hints, WireEvents

HINTS = Hints(
    "Is the device running, and does it still reach the broker?",
    "A message has to hold whole COBS frames as they come from the device, and nothing else.",
)


class FramesSource:
    """Turns the frames of one device into events.

    The object that receives the device's messages passes them to `take`.

    `url`: name of the source in messages. `overflow_bytes`: function that returns how many bytes of the
    device the receiver has dropped. `tap`: function that is called with every message before it is decoded.
    """

    live = prompt = has_clock = True

    def __init__(self, url: str, overflow_bytes: Callable[[], int]) -> None:
        self.url = url
        self._overflow_bytes = overflow_bytes
        self._wire = WireEvents(url, HINTS)
        self.tap: Callable[[TransportEvent | Reads], None] | None = None

    @property
    def unix_offset_ns(self) -> int:
        """Offset from the monotonic clock to Unix time when the last message came [ns]."""
        return self._wire.unix_offset_ns

    def events(self) -> Iterator[Event]:
        """Yield nothing, since the object that receives the messages of all devices calls `take` instead."""
        return iter(())

    def open(self, now_ns: int, unix_offset_ns: int) -> Iterator[Event]:
        """Yield the events that precede the device's first message: those of a new connection."""
        return self.take(Opened(now_ns, unix_offset_ns))

    def take(self, item: Opened | Chunk | Reads | None) -> Iterator[Event]:
        """Yield the events of one or more messages.

        An `item` of None says that no message came for a while.
        """
        if item is not None and self.tap is not None:
            self.tap(item)
        if item is None:
            now_ns = host_ns()
        else:
            now_ns = int(item.host_ns[0]) if isinstance(item, Reads) else item.host_ns
        # The time since the last call is a pause of the device, since the receiver passes messages on at
        # once. If the program was stalled, the receiver calls `forgive`.
        self._wire.resume(now_ns)
        yield from self._wire.feed(item, now_ns)

    def forgive(self, now_ns: int) -> None:
        """Restart all timeouts, since the program could not receive messages until now."""
        self._wire.forgive(now_ns)

    def link_stats(self) -> LinkStats:
        """Return the counts of bytes and frames that arrived, and that were lost on the way."""
        return self._wire.link_stats(self._overflow_bytes())

    def close(self) -> None:
        """Do nothing, since this source holds no open port or file."""
