"""The two ends of the walk: what a source gives, and what a sink takes."""

from collections.abc import Callable, Iterator
from typing import ClassVar, Protocol

from fltea.records.events import Event, TransportEvent
from fltea.records.records import AnyRecord, LinkStats


class Source(Protocol):
    """What the daemon asks of a source.

    live: it may fall silent and come back.
    prompt: its samples come at their own pace, so records must go out at once.
    unix_offset_ns: what to add to its events' host_ns to get Unix time.
    """

    live: bool
    prompt: bool

    @property
    def unix_offset_ns(self) -> int:
        """Nanoseconds from the source's monotonic clock to Unix time, as of now."""

    def events(self) -> Iterator[Event]:
        """Yield events until the source ends or is closed."""

    def link_stats(self) -> LinkStats:
        """Count what arrived and what was lost on the way."""

    def close(self) -> None:
        """Release everything; may be called from a signal handler's thread and twice."""


Item = AnyRecord | TransportEvent
"""What a sink may be given; what came over the wire, uninterpreted, only where `takes_wire`."""

Report = Callable[[str, str], None]
"""Tells everybody of a trouble: kind and text of an `error` record. Returns at once, from any thread."""


class SinkClosed(Exception):
    """The reader of the output is gone, or it can never work again; nothing more is written to it."""


class Sink:
    """What an output has to do; all but `write` may be left out.

    Every method is called from one thread. A record that `write` cannot place is the sink's own loss: it
    counts in `lost`, tells it through the `Report` that it was made with, once per trouble, and goes on.

    name: key of the output's counts in `stats.outputs`.
    lossless: a recording that is replayed faster than it was made waits for this sink.
    takes_wire: it is also given `Opened`, `Chunk` and `Failed`, before anything interprets them.
    capacity: items that may wait in the queue before newer ones are dropped.
    """

    name: str = "output"
    lossless: ClassVar[bool] = False
    takes_wire: ClassVar[bool] = False
    capacity: ClassVar[int] = 10_000
    lost: int = 0

    def write(self, item: Item) -> None:
        """Take one item.

        Raises:
            SinkClosed: nobody reads any more.
        """
        raise NotImplementedError

    def flush(self) -> None:
        """Hand on what `write` has gathered; called whenever the queue is empty, and twice a second."""

    def on_overflow(self, count: int) -> None:
        """Take note that `count` items were dropped before the next one, since this sink was too slow."""

    def close(self) -> None:
        """Write what is pending and release everything, within half a second."""
