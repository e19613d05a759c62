"""Give each record to the outputs of a running program, and count what each output loses."""

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
"""Name of the standard output. Once it has failed or ended, the program ends if no other output is left."""

ByText = Mapping[Wanted | None, Sequence[AnyRecord | Block | Printed]]
"""Lists with the same records of a device. Each list is for the outputs that want one kind of text (the key),
and has this text in place of the samples.
"""

NOTHING_PRINTED: ByText = MappingProxyType({})


class Hub:
    """Takes records from the threads of the devices, and queues the records for every output.

    `on_stop`: function that is called, from any thread, when all outputs have ended. Its argument is the
    exception if the last output failed, or None if the program that read the last output has ended.
    """

    def __init__(self, on_stop: Callable[[Exception | None], None]) -> None:
        self._on_stop = on_stop
        # The lists of outputs are replaced, never changed in place, since other threads iterate over them.
        self._shared: list[SinkQueue] = []
        self._of: dict[str, list[SinkQueue]] = {}
        self.changes = 0
        """Number of times that an output was added or removed."""
        self._log: SinkQueue | None = None
        self._ended: list[SinkQueue] = []
        self._threads: dict[str, SinkThread] = {}

    def add(self, sink: Sink, device: str | None = None) -> SinkQueue:
        """Add an output for one device, or for all devices if `device` is None.

        This may be called while the program is running.
        """
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
        """Remove an output of a device. The output first writes its queued records, and is then closed."""
        self._of = self._of | {device: [one for one in self._of.get(device, []) if one is not sink_queue]}
        self.changes += 1
        sink_queue.close()

    def add_log(self, sink: Sink) -> None:
        """Add the log. It does not count as an output, and the records that it writes are not counted."""
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

        `printed`: the same records, with samples as text, for outputs that take printed text (see
        `printing`). `wait`: whether to wait for room in a full queue. This applies only to outputs that must
        not lose records.
        """
        for sink_queue in (*self._shared, *self._of.get(device, ())):
            own = printed.get(sink_queue.sink.prints, records)
            sink_queue.put(own, arrived_ns, wait=wait)
        if log and self._log is not None:
            errors = [record for record in records if isinstance(record, Error)]
            if errors:
                self._log.put(errors)

    def printing(self, device: str) -> dict[Wanted, list[SinkQueue]]:
        """Return the outputs that take a device's samples as text, by the kind of text that they take."""
        found: dict[Wanted, list[SinkQueue]] = {}
        for sink_queue in (*self._shared, *self._of.get(device, ())):
            if sink_queue.sink.prints is not None:
                found.setdefault(sink_queue.sink.prints, []).append(sink_queue)
        return found

    def print(self, text: Wanted, printed: Printed) -> None:
        """Queue `printed`, which has records of many devices as text of the kind `text`.

        It goes to the shared outputs that take text of this kind.
        """
        for sink_queue in self._shared:
            if sink_queue.sink.prints == text:
                sink_queue.put((printed,))

    def takes_blocks(self, device: str) -> bool:
        """Return whether any output of a device takes the samples as blocks (not as text)."""
        return any(
            sink_queue.sink.prints is None for sink_queue in (*self._shared, *self._of.get(device, ()))
        )

    def wait_for_room(self, timeout_s: float) -> bool:
        """Wait until the queues of all shared outputs have room. Return False if one has no room in time."""
        return all(sink_queue.wait_for_room(timeout_s) for sink_queue in self._shared)

    def written(self) -> Callable[[], bool]:
        """Return a function that tells whether the shared outputs have written all that is queued now."""
        queued = [(sink_queue, sink_queue.progress()[0]) for sink_queue in self._shared]
        return lambda: all(sink_queue.progress()[1] >= count for sink_queue, count in queued)

    def full(self) -> list[str]:
        """Return the names of those shared outputs whose queues have no room."""
        return [sink_queue.name for sink_queue in self._shared if not sink_queue.wait_for_room(0)]

    def depart(self, device: str, *, moved: bool) -> None:
        """Tell the shared outputs that a device is gone. `moved`: whether another program serves it now."""
        for sink_queue in self._shared:
            sink_queue.put((Departed(device, moved),))

    def tap(self, device: str, *, wait: bool) -> "Tap":
        """Return the `Tap` of a device: the caller passes it all that the device's wire carries.

        The tap passes these bytes and events on to the outputs that record them.
        """
        return Tap(lambda: self._of.get(device, []), wait)

    def report(self, device: str | None = None) -> Callable[[str, str], None]:
        """Return a function that sends a record `error` to outputs and to the log.

        Its arguments are the kind and the text of the error.

        `device`: name of the device whose outputs get the record; None: all outputs get it.
        """

        def report(kind: str, message: str) -> None:
            error = Error(kind, message, unix_ns(), device=device)
            sink_queues = [*self._shared, *(self._of.get(device, ()) if device else self._all_of_devices())]
            for sink_queue in sink_queues:
                sink_queue.put((error,))
            if self._log is not None:
                self._log.put((error,))

        return report

    def sink_queues(self) -> list[tuple[str | None, SinkQueue]]:
        """Return all outputs, each with the name of its device.

        The name is None if all devices share the output.
        """
        return [(None, sink_queue) for sink_queue in self._shared] + [
            (device, sink_queue) for device, sink_queues in self._of.items() for sink_queue in sink_queues
        ]

    def is_read(self, device: str) -> bool:
        """Return whether a device has any output."""
        return bool(self._shared or self._of.get(device))

    def stats(self, device: str) -> dict[str, OutputStats]:
        """Return the counts of a device's outputs, by name."""
        return {
            sink_queue.sink.name: sink_queue.stats()
            for sink_queue in (*self._shared, *self._of.get(device, ()))
        }

    def release(self) -> None:
        """End all waiting for room in queues.

        From now on, records for an output whose queue is full are dropped.
        """
        for _, sink_queue in self.sink_queues():
            sink_queue.release()

    def close(self) -> list[Awaited]:
        """Let every output write its queued records and then close. Return the tasks for which to wait."""
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
        """Close the log. Call this after `close`, since outputs that close may write to the log."""
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
    """Passes all bytes and events from one device's wire on to the outputs that record them."""

    def __init__(self, sink_queues: Callable[[], Sequence[SinkQueue]], wait: bool) -> None:
        self._sink_queues, self._wait = sink_queues, wait

    @property
    def wanted(self) -> bool:
        """Whether any output records the events or bytes of the wire."""
        return any(sink_queue.sink.takes_wire for sink_queue in self._sink_queues())

    def __call__(self, event: TransportEvent | Reads) -> None:
        """Pass one event, or the bytes of one or several reads, on to the outputs."""
        items: Iterable[Item] = (event,)
        for sink_queue in self._sink_queues():
            if sink_queue.sink.takes_wire:
                sink_queue.put(items, wait=self._wait)
