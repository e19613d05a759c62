"""Run the program: a pipeline for each source, the outputs, and an orderly end."""

import contextlib
import os
import select
import sys
import threading
import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from fltea.process.date_watch import DateWatch
from fltea.process.interrupted import Interrupted
from fltea.process.stop_on_signal import StopOnSignal
from fltea.records.errors import FlteaError, Incomplete, SourceFailed
from fltea.records.ports import Source
from fltea.records.visible import visible_lines
from fltea.service.checks import check_settings
from fltea.service.descriptors import check_descriptors
from fltea.service.device_stream import DeviceStream
from fltea.service.ending import Awaited, Ending
from fltea.service.hub import Hub
from fltea.service.open_outputs import open_outputs
from fltea.service.port_loop import PortLoop, has_port
from fltea.service.pressure import Pressure
from fltea.service.state import StateFile
from fltea.service.systemd import ServiceManager
from fltea.settings.config import Config
from fltea.settings.sources import is_shared
from fltea.sources.open_source import check_recordable, open_source
from fltea.sources.replay import ReplaySource
from fltea.stream.fit_worker import FitThread

if TYPE_CHECKING:
    from fltea.service.ingest.loop import Ingest


def run(configs: Sequence[Config]) -> None:
    """Run the program until its end.

    The program ends in four cases: every source has ended, a signal arrives, the program that reads the only
    output ends, or a live source fails and `--once` is given.

    Raises:
        UsageError: the configuration does not describe a source or an output, or a recording cannot be used.
        SourceFailed: `once` is set and a live source is in trouble.
        FlteaError: an output cannot be written.
    """
    with StopOnSignal() as stop:
        try:
            failure, done = _Run(configs, stop).run()
        except Interrupted:  # a signal arrived while sources and outputs were being opened
            return
    if not done:  # `os._exit` is used, since a normal exit would wait for a thread that hangs in an output
        if failure is not None:
            _last_words(f"error: {failure}")
        os._exit(failure.exit_code if failure else 0)
    if failure is not None:
        raise failure


POLL_S = 1.0
"""Time between two checks whether every device stream still handles events [s]. If every one does, the
service manager (systemd) is told that the program works.
"""

STUCK_S = 20.0
"""If a device stream has handled no event for this time, it counts as hanging [s].

Even a silent live source gives two events a second.
"""


class _Run:
    """The threads of one run of the program, and the state that these threads share."""

    def __init__(self, configs: Sequence[Config], stop: StopOnSignal) -> None:
        self._configs = configs
        self._stop = stop
        self._done = False  # true when every source has ended, or a failure ends the run
        self._failure: FlteaError | None = None
        self._hub = Hub(self._on_output_end)
        self._lock = threading.Lock()
        self._running = len(configs)
        self._manager = ServiceManager()
        self._date = DateWatch(self._hub.report())
        self._fit_worker = FitThread(sum(not is_shared(config.source) for config in configs))
        self._streams: list[DeviceStream] = []
        self._ingests: list[Ingest] = []

    def run(self) -> tuple[FlteaError | None, bool]:
        """Run until the end of the program.

        Return two values: the first failure, or None, and whether all threads and outputs ended in time.
        """
        ending = Ending(self._is_asked, lambda: self._stop.count, _last_words)
        check_settings(self._configs)
        sources: list[Source] = []
        try:
            state = self._open(sources)
            self._stop.armed = True
        except BaseException:
            self._stop.ask()
            ending.wait([*_closing(sources), *self._hub.close()])
            raise
        self._streams = [
            DeviceStream(source, config, self._hub, state, self._fit_worker, number)
            for number, (source, config) in enumerate(zip(sources, self._single(), strict=True))
        ]
        port_loop, threads = self._threads()
        for thread in threads:
            thread.daemon = True
            thread.start()
        self._manager.ready()
        self._wait(lambda: self._done)
        live = bool(self._ingests) or any(source.live for source in sources)
        if self._failure is None and not (live or self._configs[0].once or self._stop.asked):
            self._stay()
        self._manager.stopping()
        if port_loop is not None:
            port_loop.close()
        if self._is_asked():
            self._hub.release()
        ending.wait(
            [
                *_closing([*sources, *self._ingests]),
                *(Awaited(thread.name.strip(), _has_ended(thread)) for thread in threads),
                Awaited("refits", self._fit_worker.close),
            ]
        )
        saving = [] if state is None else [_begun(state.close, "state", kept=True)]
        ending.wait([*saving, *self._hub.close()])
        ending.wait(self._hub.close_log())
        return self._outcome(sources, ending.lost, state), not ending.left

    def _single(self) -> list[Config]:
        """Return the configurations of sources that are one device each, not a broker with many devices."""
        return [config for config in self._configs if not is_shared(config.source)]

    def _open(self, sources: list[Source]) -> StateFile | None:
        """Open everything that the configurations name.

        Return the file with snapshots of the estimators, or None if there is none.

        Each source is added to `sources` as soon as it is open, so that the caller can close the open sources
        if another source cannot be opened.
        """
        configs, shared = self._single(), [one for one in self._configs if is_shared(one.source)]
        # sources are opened before outputs, so that a wrong source leaves no open outputs
        for config in configs:
            sources.append(open_source(config))
            check_recordable(config, sources[-1])
        check_descriptors(sources, configs)
        replays = [
            config.name or ""
            for source, config in zip(sources, configs, strict=True)
            if isinstance(source, ReplaySource)
        ]
        open_outputs(self._configs, self._hub, replays)
        settings = self._configs[0].state
        state = None if settings.file is None else StateFile(settings, self._hub.report())
        self._ingests = [self._ingest(config) for config in shared]
        return state

    def _threads(self) -> tuple[PortLoop | None, list[threading.Thread]]:
        """Return the loop of all serial ports (None without ports), and the threads that handle events."""
        on_ports = [stream for stream in self._streams if has_port(stream)]
        pressure = Pressure(self._fit_worker, self._hub.report())
        port_loop = PortLoop(on_ports, self._end, self._hub, pressure) if on_ports else None
        threads = [
            threading.Thread(target=self._pump, args=(stream,), name=f"device {stream.name}")
            for stream in self._streams
            if not has_port(stream)
        ]
        if port_loop is not None:
            threads.append(threading.Thread(target=port_loop.run, name="ports"))
        threads += [threading.Thread(target=one.run, name=f"ingest {one.name}") for one in self._ingests]
        return port_loop, threads

    def _outcome(
        self, sources: Sequence[Source], lost: Sequence[str], state: StateFile | None
    ) -> FlteaError | None:
        """Return the first failure of the run.

        If there was no failure, but some data were not written or not read, return an error that says so.
        Otherwise return None.
        """
        if self._failure is not None:
            return self._failure
        if lost:
            return FlteaError(
                "not all data were written, since these did not end within the time limit: "
                f"{', '.join(lost)}."
            )
        if state is not None and state.has_failed:
            return FlteaError("the newest snapshots could not be written: see the error state_failed.")
        unread = [why for one in sources if isinstance(one, ReplaySource) for why in one.unread]
        return Incomplete(unread) if unread else None

    def _is_asked(self) -> bool:
        """Whether a signal (such as Ctrl-C) or a failure asks the program to end."""
        return self._stop.asked or self._failure is not None

    def _wait(self, done: Callable[[], bool]) -> None:
        moving: list[DeviceStream | Ingest] = [*self._streams, *self._ingests]
        while not (done() or self._stop.asked):
            self._date.check()
            self._stop.wake_up.wait(POLL_S)
            self._stop.wake_up.clear()
            if time.monotonic() - min(one.moved_s for one in moving) < STUCK_S:
                self._manager.alive()

    def _stay(self) -> None:
        """Keep outputs such as the live page open after a recording, until the user ends the program."""
        text = (
            "fltea: the recording has ended, and the outputs stay open; Ctrl-C ends the program (--once does "
            "so automatically)."
        )
        print(text, file=sys.stderr, flush=True)
        self._wait(lambda: False)

    def _pump(self, stream: DeviceStream) -> None:
        """Handle all events of one source. Each source has a separate thread, in which this method runs."""
        try:
            for event in stream.source.events():
                stream.take(event)
                if stream.failure is not None:
                    break
            stream.finish(whole=stream.failure is None and not self._is_asked())
        except Exception as error:
            self._end(stream, error)
            if not isinstance(error, FlteaError):
                raise
        else:
            self._end(stream, None)

    def _ingest(self, config: Config) -> "Ingest":
        from fltea.service.ingest.loop import Ingest  # imported late, since few users have a broker
        from fltea.service.ingest.receivers import receiver_of

        return Ingest(config, self._hub, receiver_of(config), self._end, self._fit_worker)

    def _end(self, stream: "DeviceStream | Ingest", error: Exception | None) -> None:
        """Note that `stream` has ended: the stream of one device, or the messages of all devices of a broker.

        An error in one source ends the whole program. Otherwise a user might believe that all sources still
        work.
        """
        failure: FlteaError | None = None
        if isinstance(error, FlteaError):
            failure = error
        elif error is not None:
            failure = FlteaError(f"{stream.name}: internal fault: {type(error).__name__}: {error}")
        elif isinstance(stream, DeviceStream) and stream.failure is not None:
            failure = SourceFailed(stream.failure.message)
        with self._lock:
            self._running -= 1
            self._failure = self._failure or failure
            if failure is not None or not self._running:
                self._done = True
                self._stop.wake_up.ring()

    def _on_output_end(self, error: Exception | None) -> None:
        with self._lock:
            if error is not None and self._failure is None:
                self._failure = FlteaError(f"cannot write the output: {error}.")
            self._stop.ask()


def _begun(close: Callable[[], object], name: str, *, kept: bool = False) -> Awaited:
    """Call `close`, which may be slow, in a new thread.

    Return a task for which the program can wait. The task ends when that thread ends.
    """
    thread = threading.Thread(target=close, daemon=True)
    thread.start()
    return Awaited(name, _has_ended(thread), kept)


def _has_ended(thread: threading.Thread) -> Callable[[float], bool]:
    def done(timeout_s: float) -> bool:
        thread.join(timeout_s)
        return not thread.is_alive()

    return done


def _closing(sources: "Sequence[Source | Ingest]") -> list[Awaited]:
    """Begin to close all sources at the same time; return the tasks to wait for."""
    return [_begun(source.close, "a source") for source in sources]


def _last_words(text: str) -> None:
    """Write to stderr unless it is blocked.

    This does not use `sys.stderr`, whose lock a hanging thread may hold.
    """
    with contextlib.suppress(OSError):
        if select.select([], [2], [], 0)[1]:
            os.write(2, visible_lines(f"fltea: {text}\n").encode())
