"""Where records go: each sink takes them one by one, in a thread of its own (`fltea.outlet`)."""

from collections.abc import Callable
from typing import ClassVar

from fltea.model import AnyRecord
from fltea.transport import TransportEvent

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
