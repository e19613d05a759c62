"""Begin and end recordings while the program runs. They are like the recordings of the flag `--record`."""

import shutil
import threading
import time
from collections.abc import Collection
from pathlib import Path
from typing import Any

import msgspec

from fltea.records.errors import FlteaError, UsageError
from fltea.records.ports import RecordingView
from fltea.records.records import Hello
from fltea.service.hub import Hub
from fltea.service.sink_queue import SinkQueue
from fltea.settings.extras import load
from fltea.settings.outputs import RecordConfig

FINISH_S = 5.0
FREE_EVERY_S = 5.0
"""Time between two queries of how much space is free on the disk [s]."""

REPLAYED = "This source is a recording already."
FAULT = "The recording stopped because of a fault: see the list of events."


class RecorderOfHub:
    """Begins and ends recordings, each of one device.

    A recording is an output, which is added to the hub (the object that passes records to all outputs).

    `settings`: the table `record` of the settings. `folder`: folder for recordings if `settings` names none.
    `replays`: names of the devices whose source is itself a recording.
    """

    def __init__(self, hub: Hub, settings: RecordConfig, folder: str, replays: Collection[str]) -> None:
        self._hub, self._replays = hub, replays
        self._settings = msgspec.structs.replace(settings, folder=settings.folder or folder)
        self._folder = Path(self._settings.folder or folder).absolute()
        self._lock = threading.Lock()
        self._fixed: dict[str, SinkQueue] = {}
        self._running: dict[str, SinkQueue] = {}
        self._began_s: dict[str, float] = {}
        self._done: dict[str, tuple[str | None, int]] = {}
        self._free: tuple[float, int | None] = (-FREE_EVERY_S, None)

    def adopt(self, device: str, sink_queue: SinkQueue) -> None:
        """Note that a device has a recording that runs as long as the program, and so cannot be stopped."""
        self._fixed[device] = sink_queue
        self._began_s[device] = time.monotonic()

    def view(self, device: str) -> RecordingView:
        """Return the state of a device's recording, as the page shows it."""
        sink_queue = self._fixed.get(device) or self._running.get(device)
        folder, free = str(self._folder), self._free_bytes()
        if sink_queue is None:
            file, size = self._done.get(device, (None, 0))
            why_not = REPLAYED if device in self._replays else ""
            return RecordingView(False, False, folder, file, size, free_bytes=free, why_not=why_not)
        sink: Any = sink_queue.sink
        return RecordingView(
            on=True,
            fixed=device in self._fixed,
            folder=folder,
            file=None if sink.path is None else sink.path.name,
            size_bytes=sink.size_bytes,
            seconds=time.monotonic() - self._began_s[device],
            lost=sink.lost,
            trouble=FAULT if sink_queue.join(0) else sink.trouble,
            free_bytes=free,
        )

    def start(self, device: str, hello: Hello | None) -> None:
        """Begin to record a device, unless a recording of the device is already running.

        Raises:
            UsageError: the device cannot be recorded, the folder cannot be written, or a library is missing.
        """
        with self._lock:
            if device in self._fixed or device in self._running:
                return
            if device in self._replays:
                raise UsageError(REPLAYED)
            if hello is None:
                raise UsageError(
                    "No message has come from the device yet; try again when its samples arrive."
                )
            module = load("fltea.sinks.record", "mcap", "record", "recording needs")
            hello = msgspec.structs.replace(hello, device=None)
            sink = module.RecordSink(self._settings, device, self._hub.report(device), hello)
            self._began_s[device] = time.monotonic()
            self._running[device] = self._hub.add(sink, device)

    def stop(self, device: str) -> None:
        """End a recording that `start` began, and finish its file.

        Raises:
            FlteaError: the recording runs as long as the program, or its file cannot be finished in time.
        """
        with self._lock:
            if device in self._fixed:
                raise FlteaError("This recording was started with --record and ends with the program.")
            sink_queue = self._running.pop(device, None)
            if sink_queue is None:
                return
            self._hub.remove(sink_queue, device)
            finished = sink_queue.join(FINISH_S)
            sink: Any = sink_queue.sink
            self._done[device] = None if sink.path is None else sink.path.name, sink.size_bytes
            if not finished:
                raise FlteaError(
                    f"The recording was not finished within {FINISH_S:g} s: is the disk slow? The program "
                    "goes on writing the samples that it still holds."
                )

    def _free_bytes(self) -> int | None:
        """Return the free space [bytes] on the disk that holds the folder of recordings.

        Return None if the free space is unknown.
        """
        asked_s, free = self._free
        if time.monotonic() - asked_s < FREE_EVERY_S:
            return free
        place = self._folder
        while not place.exists() and place != place.parent:
            place = place.parent
        try:
            free = shutil.disk_usage(place).free
        except OSError:
            free = None
        self._free = time.monotonic(), free
        return free
