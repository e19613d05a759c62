"""The two ends of the walk: what a source gives, and what a sink takes."""

import bisect
from collections.abc import Callable, Iterator, Sequence
from typing import ClassVar, NamedTuple, Protocol

from fltea.records.block import Block
from fltea.records.events import Event, Reads, TransportEvent
from fltea.records.records import AnyRecord, Hello
from fltea.records.stats import LinkStats, OutputStats


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
        """Return the nanoseconds from the source's monotonic clock to Unix time, as of now."""

    def events(self) -> Iterator[Event]:
        """Yield events until the source ends or is closed."""

    def link_stats(self) -> LinkStats:
        """Count what arrived and what was lost on the way."""

    def close(self) -> None:
        """Release everything; may be called from a signal handler's thread and twice."""


LATENCY_BOUNDS_MS = (0.25, 0.5, 1.0, 2.0, 3.0, 5.0, 10.0, 20.0, 50.0, 100.0, 250.0, 1000.0)


class Latency:
    """Histogram of the time from a sample's arrival to its way out, in ms."""

    def __init__(self) -> None:
        self.counts = [0] * (len(LATENCY_BOUNDS_MS) + 1)
        self.sum_ms = 0.0

    def add(self, ms: float, weight: int) -> None:
        """Count `weight` records that took `ms` milliseconds."""
        self.counts[bisect.bisect_left(LATENCY_BOUNDS_MS, ms)] += weight
        self.sum_ms += ms * weight


class OutputView(Protocol):
    """What a running output shows of itself."""

    latency: Latency

    @property
    def name(self) -> str:
        """The key of its counts in `stats.outputs`."""

    def stats(self) -> OutputStats:
        """Count what was written and what was lost."""


class Departed(NamedTuple):
    """Nothing more comes from a device here; if `moved`, another program goes on with it."""

    device: str
    moved: bool


class Wanted(NamedTuple):
    """Which records of a block are printed. nulls: else what is null is left out."""

    samples: bool = False
    estimates: bool = False
    corrected: bool = False
    nulls: bool = True


class Printed(NamedTuple):
    """Records of samples as lines, for sinks whose `prints` says what is in them.

    records: the number that they stand for, as of `Block.weight`. parts: of each device when its newest
    arrived [ns, monotonic] and how many are its, for the latency.
    """

    data: bytes
    records: int
    parts: Sequence[tuple[int, int]] = ()


Item = AnyRecord | Block | Printed | TransportEvent | Reads
"""What a sink may be given; what came over the wire, uninterpreted, only where `takes_wire`."""

Report = Callable[[str, str], None]
"""Reports a trouble to all outputs by kind and text. It returns at once, from any thread."""


class SinkClosed(Exception):
    """The reader of the output is gone, or it can never work again; nothing more is written to it."""


class Sink:
    """What an output has to do; all but `write` may be left out.

    Every method is called from one thread. A record that `write` cannot place is the sink's own loss: it
    counts in `lost`, tells it through the `Report` that it was made with, once per trouble, and goes on.

    name: key of the output's counts in `stats.outputs`.
    lossless: a recording that is replayed faster than it was made waits for this sink.
    takes_wire: it is also given `Opened`, `Chunk`, `Reads` and `Failed`, before anything interprets them.
    together: one thread writes to all of its name, and not one each; so none may wait for long.
    prints: which records of samples it takes as `Printed`, in place of blocks; None: it takes blocks alone.
    capacity: items that may wait in the queue before newer ones are dropped. rest_s: between two batches, so
    that records of many devices go out together, not with a change of threads each.
    """

    name: str = "output"
    lossless: ClassVar[bool] = False
    takes_wire: ClassVar[bool] = False
    together: ClassVar[bool] = False
    capacity: ClassVar[int] = 10_000
    rest_s: ClassVar[float] = 0.002
    prints: Wanted | None = None
    lost: int = 0

    def write(self, item: Item) -> None:
        """Take one item.

        Raises:
            SinkClosed: nobody reads any more.
        """
        raise NotImplementedError

    def flush(self) -> None:
        """Hand on what `write` has gathered; called whenever the queue is empty, and twice a second."""

    def depart(self, departed: Departed) -> None:
        """Forget what is kept of a device; of many that come and go it would grow for ever."""

    def on_overflow(self, count: int) -> None:
        """Take note that `count` items were dropped before the next one, since this sink was too slow."""

    def close(self) -> None:
        """Write what is pending and release everything, within half a second."""


class RecordingView(NamedTuple):
    """The state of the recording of one device.

    fixed: it runs as long as the program. file: the newest; size_bytes: of all of the session's, for seconds
    of time. lost: items that no file took. trouble: why nothing is recorded though it is on.
    free_bytes: room in the folder, None if nobody knows. why_not: why there can be none, or "".
    """

    on: bool
    fixed: bool
    folder: str
    file: str | None = None
    size_bytes: int = 0
    seconds: float = 0.0
    lost: int = 0
    trouble: str | None = None
    free_bytes: int | None = None
    why_not: str = ""


class Recorder(Protocol):
    """Records devices while the program runs. All but `view` may take seconds."""

    def view(self, device: str) -> RecordingView:
        """Return how the recording of a device is."""

    def start(self, device: str, hello: Hello | None) -> None:
        """Begin to record, if nobody did. hello: what the device said of itself.

        Raises:
            FlteaError: it cannot be recorded; says why and what to do.
        """

    def stop(self, device: str) -> None:
        """End a recording that `start` began, and finish its file.

        Raises:
            FlteaError: it runs as long as the program, or its file cannot be finished in time.
        """
