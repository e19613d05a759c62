"""Keep a device stream for each device that publishes to a broker.

If a device is silent for too long, its device stream is ended.
"""

from collections.abc import Callable
from dataclasses import dataclass

import msgspec

from fltea.records.clock import host_ns, unix_offset_ns
from fltea.records.events import Chunk, Reads
from fltea.records.ports import Report
from fltea.records.repeat import OnceAMinute
from fltea.service.device_stream import DeviceStream
from fltea.service.hub import Hub
from fltea.service.ingest.inbox import Inbox
from fltea.service.ingest.receiver import Shared
from fltea.settings.config import Config
from fltea.sources.frames import FramesSource
from fltea.stream.fit_worker import FitWorker
from fltea.stream.snapshot import DeviceState

TICK_NS = 2 * 10**9
"""If no message of a device comes for this time, it is checked whether the device is silent. This is also the
time between two such checks [ns].
"""

STATS_S = 10
"""Time between two records `stats` of a device [s]. The devices take turns: each second, records of a tenth
of the devices are published.
"""

FAULT_NS = 60 * 10**9
"""If the stream of a device failed, because of a fault or unsuitable settings, a new stream is tried after
this time [ns].
"""


@dataclass
class OpenDevice:
    """A device whose device stream is open.

    `partition`: number of the device's partition, if the broker has partitions. `mark`: number of the
    device's last processed message. `kept_ns`: time of the device's last snapshot. `is_whole`: whether that
    snapshot contains the estimators.
    """

    stream: DeviceStream
    source: FramesSource
    heard_ns: int
    checked_ns: int
    partition: int | None = None
    mark: int = 0
    kept_ns: int = 0
    is_whole: bool = False


class Devices:
    """Opens, feeds and ends the streams of all devices, in one thread.

    `config`: settings of every device. `url`: URL of the broker. `shared`: the partitions that this worker
    serves; None if there is only one worker. `fit_worker`: thread that refits the noise of all devices.
    `wait_for_room`: function that is called before each event, and returns when the outputs have room.
    """

    def __init__(
        self,
        config: Config,
        hub: Hub,
        inbox: Inbox,
        url: str,
        report: Report,
        shared: Shared | None,
        fit_worker: FitWorker,
        wait_for_room: Callable[[], object],
    ) -> None:
        self.opened: dict[str, OpenDevice] = {}
        self._config, self._hub, self._inbox, self._url = config, hub, inbox, url
        self._report, self._shared, self._fit_worker = report, shared, fit_worker
        self._wait_for_room = wait_for_room
        self._broken_ns: dict[str, int] = {}
        self._opened = 0
        self._once_a_minute = OnceAMinute()

    def offset_ns(self) -> int:
        """Return the offset from `host_ns` to Unix time.

        With several workers, the offset comes from the clock of the stream that keeps the messages.
        """
        return self._shared.unix_offset_ns if self._shared is not None else unix_offset_ns()

    def is_broken(self, name: str, now_ns: int) -> bool:
        """Return whether a device's stream failed recently. Messages of such a device are not processed."""
        return now_ns < self._broken_ns.get(name, 0)

    def open(
        self, name: str, now_ns: int, partition: int | None = None, saved: DeviceState | None = None
    ) -> OpenDevice:
        """Begin a device stream. `saved`: estimators that another worker has saved, if any."""
        url = f"{self._url}/{name}"
        source = FramesSource(url, lambda: self._inbox.overflow_bytes[name])
        config = msgspec.structs.replace(self._config, name=name, source=url)
        stream = DeviceStream(source, config, self._hub, None, self._fit_worker, self._opened, STATS_S, saved)
        self._opened += 1
        device = self.opened[name] = OpenDevice(stream, source, now_ns, now_ns, partition)
        self._fit_worker.devices += 1
        for event in source.open(now_ns, self.offset_ns()):
            stream.take(event)
        return device

    def feed(self, name: str, item: Chunk | Reads | None) -> None:
        """Process bytes of a device. If an error occurs, end the device's stream.

        `item`: the bytes. None says that none came for a while, so that the stream does what is due by the
        clock.
        """
        device = self.opened[name]
        try:
            for event in device.source.take(item):
                self._wait_for_room()
                device.stream.take(event)
        except Exception as error:
            self._broken_ns[name] = host_ns() + FAULT_NS
            self._give_up(name, moved=False)
            if self._once_a_minute.is_due("line_broken", host_ns()):
                text = f"{name}: its samples are not processed for a minute: {type(error).__name__}: {error}"
                self._report("line_broken", text)

    def finish(self, name: str, *, moved: bool) -> None:
        """End a device stream with its last `stats` record.

        `moved`: whether another worker continues with the device.
        """
        self.opened[name].stream.finish()
        self._give_up(name, moved=moved)

    def check(self, now_ns: int, is_silent: Callable[[OpenDevice], bool]) -> None:
        """Tell the stream of each silent device that no message came (see `feed`).

        End the streams of devices from which no message came for too long.

        `is_silent`: function that returns False for a device of which messages may still wait in the broker.
        """
        forget_ns = int(self._config.ingest.forget_s * 1e9)
        for name, device in list(self.opened.items()):
            if now_ns - device.checked_ns < TICK_NS:
                continue
            if now_ns - device.heard_ns >= forget_ns:
                self.finish(name, moved=False)
            elif is_silent(device):
                device.checked_ns = now_ns
                self.feed(name, None)
        self._broken_ns = {name: ns for name, ns in self._broken_ns.items() if ns > now_ns}

    def _give_up(self, name: str, *, moved: bool) -> None:
        device = self.opened.pop(name)
        if not moved and device.partition is not None and self._shared is not None:
            # otherwise another worker could find the device's old snapshot later, and continue from it
            self._shared.drop(device.partition, name)
        self._hub.depart(name, moved=moved)
        self._fit_worker.devices -= 1
        self._inbox.forget(name)
