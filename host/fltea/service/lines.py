"""All devices on ports with descriptors, walked by one thread."""

from collections.abc import Callable, Sequence

from fltea.records import clock
from fltea.records.events import Failed, Opened, Reads, Tick
from fltea.service.bell import Bell
from fltea.service.pressure import LOOK_NS, Pressure
from fltea.service.walk import Walk
from fltea.sources.serial import SerialSource
from fltea.wire.ports import Ports

WAIT_S = 0.5
TELL_AFTER = 16
"""Walks, of those that have something at once, after which the outputs are told of it. They would take
Python's lock from a walk for what they can as well do while all walks wait for samples."""


def has_line(walk: Walk) -> bool:
    """Whether the operating system says when this walk's source has something to read."""
    return isinstance(walk.source, SerialSource) and walk.source.port.has_descriptor


class LineLoop:
    """Reads the ports of these walks and lets each take what came from its own.

    on_end: called, from the loop's thread, with a walk that has ended and the exception that ended it, if one
    did. untold: gives the bells of outputs that do not know yet of what the walks have published. pressure:
    what is to know how long samples wait.
    """

    def __init__(
        self,
        walks: Sequence[Walk],
        on_end: Callable[[Walk, Exception | None], None],
        untold: Callable[[], list[Bell]],
        pressure: Pressure,
    ) -> None:
        self.walks = list(walks)
        self._on_end, self._untold, self._pressure = on_end, untold, pressure
        self._looked_ns = 0
        self._closed = False
        self._sources = [walk.source for walk in walks if isinstance(walk.source, SerialSource)]
        self._ports = Ports([source.port for source in self._sources])

    def run(self) -> None:
        """Walk until `close`, or until each walk has failed."""
        going = set(range(len(self.walks)))
        try:
            while going and not self._closed:
                for number, (place, item) in enumerate(self._ports.poll(WAIT_S, self._untold()), 1):
                    if place in going and not self._take(place, item):
                        going.discard(place)
                    if number % TELL_AFTER == 0:
                        self._tell()
                now_ns = clock.host_ns()
                if now_ns - self._looked_ns >= LOOK_NS:
                    self._looked_ns = now_ns
                    self._pressure.look(now_ns)
            for place in going:
                self._finish(place)
        except Exception as error:  # of the loop itself: a daemon that hears nothing must not look alive
            for place in going:
                self._on_end(self.walks[place], error)
            raise
        finally:
            self._tell()
            self._ports.close()

    def close(self) -> None:
        """End the loop, from another thread."""
        self._closed = True
        self._ports.wake()

    def _tell(self) -> None:
        for bell in self._untold():
            bell.ring()

    def _take(self, place: int, item: Reads | Opened | Failed | Tick) -> bool:
        """Let one walk take what came; whether it goes on."""
        walk, source = self.walks[place], self._sources[place]
        if isinstance(item, Reads):
            due_ns = int(item.host_ns[0]) + round(source.port.latency_s * 1e9)
            self._pressure.waited(clock.host_ns() - due_ns)
        try:
            for event in source.take(item):
                walk.take(event, tell=False)
                if walk.failure is not None:
                    break
        except Exception as error:
            self._on_end(walk, error)
            return False
        if walk.failure is None:
            return True
        self._finish(place)
        return False

    def _finish(self, place: int) -> None:
        walk = self.walks[place]
        try:
            walk.finish()
        except Exception as error:
            self._on_end(walk, error)
        else:
            self._on_end(walk, None)
