"""All outputs of a running program: who gets which record, what each has lost, and what they report."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from types import MappingProxyType

from fltea.records.block import Block
from fltea.records.clock import unix_ns
from fltea.records.events import Reads, TransportEvent
from fltea.records.ports import Departed, Item, Printed, Sink, Wanted
from fltea.records.records import AnyRecord, Error
from fltea.records.stats import OutputStats
from fltea.service.ending import Awaited
from fltea.service.sink_queue import SinkQueue, SinkThread

ESSENTIAL = "stdout"
"""The output without which a program that has no other need not go on; its failure is then the program's."""

ByText = Mapping[Wanted | None, Sequence[AnyRecord | Block | Printed]]
"""What outputs that print the same are given of a device, samples as lines as far as they were printed."""

NOTHING_PRINTED: ByText = MappingProxyType({})


class Hub:
    """Takes records from the pipelines' threads and queues them for every sink.

    on_stop: called, from any thread, when the last output that anybody reads is gone; with the reason if it
    failed, with None if its reader left.
    """

    def __init__(self, on_stop: Callable[[Exception | None], None]) -> None:
        self._on_stop = on_stop
        # Replaced as a whole, never changed: other threads walk through them.
        self._shared: list[SinkQueue] = []
        self._of: dict[str, list[SinkQueue]] = {}
        self.changes = 0
        """How often an output was added or taken out."""
        self._log: SinkQueue | None = None
        self._ended: list[SinkQueue] = []
        self._threads: dict[str, SinkThread] = {}

    def add(self, sink: Sink, device: str | None = None) -> SinkQueue:
        """Add an output, of one device or of all; also while the program runs."""
        thread = None
        if sink.together:
            thread = self._threads.setdefault(sink.name, SinkThread(f"sinks {sink.name}"))
        sink_queue = SinkQueue(sink, self._on_end, thread)
        sink_queue.start()
        if device is None:
            self._shared = [*self._shared, sink_queue]
        else:
            self._of = self._of | {device: [*self._of.get(device, []), sink_queue]}
        self.changes += 1
        return sink_queue

    def remove(self, sink_queue: SinkQueue, device: str) -> None:
        """Give a device's output nothing more; what is queued still goes out, and then it is closed."""
        self._of = self._of | {device: [one for one in self._of.get(device, []) if one is not sink_queue]}
        self.changes += 1
        sink_queue.close()

    def add_log(self, sink: Sink) -> None:
        """Add the log, which is no output: nothing of its own is counted."""
        self._log = SinkQueue(sink, lambda sink_queue, error: None)
        self._log.start()

    def publish(
        self,
        device: str,
        records: Sequence[AnyRecord | Block],
        arrived_ns: int | None = None,
        *,
        wait: bool = False,
        log: bool = True,
        printed: ByText = NOTHING_PRINTED,
    ) -> None:
        """Queue a device's records.

        printed: the same for outputs of these texts (`printing`). wait: hold the caller up for outputs that
        must not lose any.
        """
        for sink_queue in (*self._shared, *self._of.get(device, ())):
            own = printed.get(sink_queue.sink.prints, records)
            sink_queue.put(own, arrived_ns, wait=wait)
        if log and self._log is not None:
            errors = [record for record in records if isinstance(record, Error)]
            if errors:
                self._log.put(errors)

    def printing(self, device: str) -> dict[Wanted, list[SinkQueue]]:
        """Return a device's outputs that take its samples printed, by what they print."""
        found: dict[Wanted, list[SinkQueue]] = {}
        for sink_queue in (*self._shared, *self._of.get(device, ())):
            if sink_queue.sink.prints is not None:
                found.setdefault(sink_queue.sink.prints, []).append(sink_queue)
        return found

    def print(self, text: Wanted, printed: Printed) -> None:
        """Queue what was printed of many devices for the outputs that they share and that print it."""
        for sink_queue in self._shared:
            if sink_queue.sink.prints == text:
                sink_queue.put((printed,))

    def takes_blocks(self, device: str) -> bool:
        """Whether any output of a device takes its samples otherwise than printed."""
        return any(
            sink_queue.sink.prints is None for sink_queue in (*self._shared, *self._of.get(device, ()))
        )

    def wait_for_room(self, timeout_s: float) -> bool:
        """Wait until all outputs that devices share have room; False if one has none in time."""
        return all(sink_queue.wait_for_room(timeout_s) for sink_queue in self._shared)

    def written(self) -> Callable[[], bool]:
        """What says whether outputs that devices share have written all that they were given until now."""
        queued = [(sink_queue, sink_queue.progress()[0]) for sink_queue in self._shared]
        return lambda: all(sink_queue.progress()[1] >= count for sink_queue, count in queued)

    def full(self) -> list[str]:
        """Names of those that have none."""
        return [sink_queue.name for sink_queue in self._shared if not sink_queue.wait_for_room(0)]

    def depart(self, device: str, *, moved: bool) -> None:
        """Let all know that this device is gone. moved: to another program."""
        for sink_queue in self._shared:
            sink_queue.put((Departed(device, moved),))

    def tap(self, device: str, *, wait: bool) -> "Tap":
        """What is to be called with all that comes over the wire of a device."""
        return Tap(lambda: self._of.get(device, []), wait)

    def report(self, device: str | None = None) -> Callable[[str, str], None]:
        """Return what an output calls to report a trouble: an `error` record goes to all."""

        def report(kind: str, message: str) -> None:
            error = Error(kind, message, unix_ns(), device=device)
            sink_queues = [*self._shared, *(self._of.get(device, ()) if device else self._all_of_devices())]
            for sink_queue in sink_queues:
                sink_queue.put((error,))
            if self._log is not None:
                self._log.put((error,))

        return report

    def sink_queues(self) -> list[tuple[str | None, SinkQueue]]:
        """All outputs, with the device that each belongs to."""
        return [(None, sink_queue) for sink_queue in self._shared] + [
            (device, sink_queue) for device, sink_queues in self._of.items() for sink_queue in sink_queues
        ]

    def is_read(self, device: str) -> bool:
        """Whether there is any output that a device writes to."""
        return bool(self._shared or self._of.get(device))

    def stats(self, device: str) -> dict[str, OutputStats]:
        """Counts of the outputs that a device writes to, by name."""
        return {
            sink_queue.sink.name: sink_queue.stats()
            for sink_queue in (*self._shared, *self._of.get(device, ()))
        }

    def release(self) -> None:
        """Hold nobody up any more: what an output has no room for is dropped from now on."""
        for _, sink_queue in self.sink_queues():
            sink_queue.release()

    def close(self) -> list[Awaited]:
        """Let every output write what is queued, and close it."""
        sink_queues = self.sink_queues()
        for _, sink_queue in sink_queues:
            sink_queue.close()
        return [
            Awaited(
                f"{sink_queue.name} of {device}" if device else sink_queue.name,
                sink_queue.join,
                sink_queue.sink.takes_wire,
            )
            for device, sink_queue in sink_queues
        ]

    def close_log(self) -> list[Awaited]:
        """Close the log: after the others, which may have reported something."""
        if self._log is None:
            return []
        self._log.close()
        return [Awaited("log", self._log.join)]

    def _all_of_devices(self) -> list[SinkQueue]:
        return [sink_queue for sink_queues in self._of.values() for sink_queue in sink_queues]

    def _on_end(self, ended: SinkQueue, error: Exception | None) -> None:
        self._ended.append(ended)
        others = [sink_queue for _, sink_queue in self.sink_queues() if sink_queue not in self._ended]
        if not others and any(sink_queue.sink.name == ESSENTIAL for sink_queue in self._ended):
            self._on_stop(error)
        else:
            why = "its reader left" if error is None else f"{type(error).__name__}: {error}"
            self.report()("output_lost", f"nothing more is written to {ended.sink.name} ({why}).")


class Tap:
    """Hands on what comes over the wire of one device to the outputs that want it, as of then."""

    def __init__(self, sink_queues: Callable[[], Sequence[SinkQueue]], wait: bool) -> None:
        self._sink_queues, self._wait = sink_queues, wait

    @property
    def wanted(self) -> bool:
        """Whether anybody takes it."""
        return any(sink_queue.sink.takes_wire for sink_queue in self._sink_queues())

    def __call__(self, event: TransportEvent | Reads) -> None:
        """Hand on one event."""
        items: Iterable[Item] = (event,)
        for sink_queue in self._sink_queues():
            if sink_queue.sink.takes_wire:
                sink_queue.put(items, wait=self._wait)
