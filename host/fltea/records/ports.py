"""Define the interfaces of sources, which yield events, and of outputs (sinks), which write records."""

import bisect
from collections.abc import Callable, Iterator, Sequence
from typing import ClassVar, NamedTuple, Protocol

from fltea.records.block import Block
from fltea.records.events import Event, Reads, TransportEvent
from fltea.records.records import AnyRecord, Hello
from fltea.records.stats import LinkStats, OutputStats


class Source(Protocol):
    """The interface that the daemon needs from a source.

    `live`: whether the source may fall silent and come back, as a device may and a recording may not.
    `prompt`: whether the samples arrive in real time, so that records must be written at once.
    `has_clock`: whether the device times come from a clock of the device. They do not if they are computed
    from the order of the samples and a rate that the user states.
    """

    live: bool
    prompt: bool

    @property
    def has_clock(self) -> bool:
        """See the text of the class."""

    @property
    def unix_offset_ns(self) -> int:
        """Return the current offset from `host_ns` of the source's events to Unix time [ns]."""

    def events(self) -> Iterator[Event]:
        """Yield events until the source ends or is closed.

        While others have to send samples and nothing comes, yield a `Tick` about twice a second. After
        `close`, also an iteration that waits in another thread ends. Samples that came before, and whose
        sampling rate is not known yet, are still yielded.
        """

    def link_stats(self) -> LinkStats:
        """Return the counts of bytes and frames that arrived or were lost in transit."""

    def close(self) -> None:
        """Release all resources; may be called twice, and from a signal handler's thread."""


LATENCY_BOUNDS_MS = (0.25, 0.5, 1.0, 2.0, 3.0, 5.0, 10.0, 20.0, 50.0, 100.0, 250.0, 1000.0)


class Latency:
    """Histogram of the times from the arrival of samples until their records are written [ms]."""

    def __init__(self) -> None:
        self.counts = [0] * (len(LATENCY_BOUNDS_MS) + 1)
        self.sum_ms = 0.0

    def add(self, ms: float, weight: int) -> None:
        """Count `weight` records, each of which was written `ms` milliseconds after its sample arrived."""
        self.counts[bisect.bisect_left(LATENCY_BOUNDS_MS, ms)] += weight
        self.sum_ms += ms * weight


class OutputView(Protocol):
    """What other parts of the program may ask of a running output: its name, its latency and its counts."""

    latency: Latency

    @property
    def name(self) -> str:
        """The key of the output's counts in `stats.outputs`."""

    def stats(self) -> OutputStats:
        """Return the counts of written and lost records."""


class Departed(NamedTuple):
    """Tells the outputs that the program gets no more samples from `device`.

    `moved`: whether another program serves the device now.
    """

    device: str
    moved: bool


class Wanted(NamedTuple):
    """Which records of a block of samples an output takes as text.

    `nulls`: whether the text also shows those fields whose value is null.
    """

    samples: bool = False
    estimates: bool = False
    corrected: bool = False
    nulls: bool = True


class Printed(NamedTuple):
    """Records of samples as lines of text, for sinks that set `prints`.

    `data`: the text. `records`: number of records in `data`.
    `parts`: for each device in `data`, two numbers: the monotonic time at which its newest sample arrived
    [ns], and its number of records. The latency of the output is computed from them.
    """

    data: bytes
    records: int
    parts: Sequence[tuple[int, int]] = ()


Item = AnyRecord | Block | Printed | TransportEvent | Reads
"""What a sink may receive. Only sinks with `takes_wire` receive the port's events (`TransportEvent`) and the
undecoded bytes (`Reads`).
"""

Report = Callable[[str, str], None]
"""Function that reports an error to all outputs. Its arguments are the kind and the text of the error. Any
thread may call it, and it returns at once.
"""


class SinkClosed(Exception):
    """The program that reads the output has ended, or the output has failed for good.

    Nothing more is written to this output.
    """


class Sink:
    """Base class of all outputs. A subclass must define `write`, and may define the other methods.

    Every method is called from one thread. When `write` cannot store a record, the sink counts the record in
    `lost`, calls its function of type `Report` once for each cause, and continues.

    `name`: key of the output's counts in `stats.outputs`.
    `lossless`: a replay that is faster than real time waits for this sink instead of dropping records.
    `takes_wire`: the sink also receives the undecoded `Opened`, `Chunk`, `Reads` and `Failed`.
    `together`: one thread serves all sinks with this name, so none of them may wait for long.
    `prints`: which records of samples the sink takes as text (`Printed`). None if it takes samples as blocks
    instead.
    `capacity`: number of records that may wait in the queue. While it is full, records that come are dropped.
    `rest_s`: pause after each writing [s]. Records of many devices that come in the pause are written
    together, so that the computer switches between threads less often.
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
        """Write one item.

        Raises:
            SinkClosed: nobody reads this output any more.
        """
        raise NotImplementedError

    def flush(self) -> None:
        """Write the data that `write` has buffered.

        This method is called whenever the sink's queue is empty, and twice a second.
        """

    def depart(self, departed: Departed) -> None:
        """Release the data kept for a device, so that they do not grow as devices come and go."""

    def on_overflow(self, count: int) -> None:
        """Note that `count` items were dropped, since this sink was too slow. Called after the loss."""

    def close(self) -> None:
        """Write pending items and release all resources, within half a second."""


class RecordingView(NamedTuple):
    """The state of one device's recording, for the live page.

    `fixed`: whether the recording runs as long as the program; the live page cannot stop such a recording.
    `file`: name of the newest file.
    `size_bytes`, `seconds`: size and duration of all files of this session.
    `lost`: number of items that were written to no file.
    `trouble`: reason why nothing is recorded although the recording is on.
    `free_bytes`: free space of the folder; None if it is not known.
    `why_not`: reason why a recording is impossible; empty if it is possible.
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
    """Records devices while the program runs. All methods except `view` may take seconds."""

    def view(self, device: str) -> RecordingView:
        """Return the state of the recording of a device."""

    def start(self, device: str, hello: Hello | None) -> None:
        """Start to record a device, unless it is being recorded.

        `hello`: the newest HELLO of the device.

        Raises:
            FlteaError: the device cannot be recorded; the text says why and what to do.
        """

    def stop(self, device: str) -> None:
        """End a recording that `start` began, and finish its file.

        Raises:
            FlteaError: the recording runs as long as the program, or its file cannot be finished in time.
        """
