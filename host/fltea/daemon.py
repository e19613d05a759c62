"""One run of the program: a source, a pipeline, a sink, and an orderly end."""

import contextlib
import os
import signal
import sys
import time
from types import FrameType

from fltea.config import Config
from fltea.errors import FlteaError, SourceFailed
from fltea.model import AnyRecord, Error, Trouble
from fltea.pipeline import Pipeline
from fltea.sinks import Sink, SinkClosed
from fltea.sinks.ndjson import NdjsonSink
from fltea.sinks.table import TableSink
from fltea.sources import Source
from fltea.sources.opening import open_source

PATIENCE_S = 1.0


def run(config: Config) -> None:
    """Run until the source ends, a signal arrives, the reader of the output goes, or `--once` fails.

    Raises:
        UsageError: the configuration does not describe a source, or a recording is bad.
        SourceFailed: `once` is set and a live source is in trouble.
        FlteaError: the output cannot be written.
    """
    with _StopOnSignal() as stop:
        try:
            source = open_source(config)
        except KeyboardInterrupt:  # stopped before there was anything to stop
            return
        stop.watch(source)
        _run_source(source, config, stop)


def _run_source(source: Source, config: Config, stop: "_StopOnSignal") -> None:
    to_table = config.format == "table" or (config.format == "auto" and sys.stdout.isatty())
    sink: Sink = TableSink() if to_table else NdjsonSink(sys.stdout.buffer, prompt=source.prompt)
    try:
        try:
            failure = _pump(source, Pipeline(source, config), sink, once=config.once, log=not to_table)
            if failure is None and not source.live and not config.once and not stop.asked:
                _stay(stop, sink)
        finally:
            sink.close()  # in any case: the table gives the terminal back
    except (SinkClosed, BrokenPipeError):
        silence_stdout()
        return
    except OSError as error:
        silence_stdout()
        raise FlteaError(f"cannot write the output: {error}.") from error
    finally:
        source.close()
    if failure is not None:
        raise SourceFailed(failure.message)


def _pump(source: Source, pipeline: Pipeline, sink: Sink, *, once: bool, log: bool) -> Trouble | None:
    """Move everything from source to sink; the trouble that ended it, if one did."""
    failure = None
    for event in source.events():
        if once and isinstance(event, Trouble) and event.fatal:
            failure = event
        for record in pipeline.feed(event):
            _write(sink, record, log and failure is None)  # the failure is told at the end
        if failure is not None:
            break
    _write(sink, pipeline.stats(), log)
    return failure


def _write(sink: Sink, record: AnyRecord, log: bool) -> None:
    sink.write(record)
    if log and isinstance(record, Error):
        print(f"fltea: {record.kind}: {record.message}", file=sys.stderr, flush=True)


class _StopOnSignal(contextlib.AbstractContextManager["_StopOnSignal"]):
    """SIGINT and SIGTERM end the source's iteration, and soon after it whatever still hangs.

    Before there is a source they raise KeyboardInterrupt. An output that nobody reads is given
    up `PATIENCE_S` after the signal, as if its reader had left.
    """

    def __init__(self) -> None:
        self.asked = False
        self._source: Source | None = None
        self._before: dict[signal.Signals, object] = {}

    def watch(self, source: Source) -> None:
        """From now on a signal closes this source."""
        self._source = source

    def __enter__(self) -> "_StopOnSignal":
        for number, handler in (
            (signal.SIGINT, self._on_signal),
            (signal.SIGTERM, self._on_signal),
            (signal.SIGALRM, self._on_alarm),
        ):
            self._before[number] = signal.signal(number, handler)
        return self

    def __exit__(self, *exception: object) -> None:
        signal.setitimer(signal.ITIMER_REAL, 0)
        for number, handler in self._before.items():
            signal.signal(number, handler)  # type: ignore[arg-type]

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        self.asked = True
        if self._source is None:
            raise KeyboardInterrupt
        signal.setitimer(signal.ITIMER_REAL, PATIENCE_S)
        self._source.close()

    def _on_alarm(self, number: int, frame: FrameType | None) -> None:
        silence_stdout()  # what the buffers still hold goes nowhere
        raise SinkClosed


def _stay(stop: _StopOnSignal, sink: Sink) -> None:
    """Without --once a recording's last state stays on view until somebody ends the program."""
    if isinstance(sink, NdjsonSink):
        sink.close()
    print(
        "fltea: the recording is at its end; Ctrl-C ends the program (--once does so by itself).",
        file=sys.stderr,
    )
    while not stop.asked:
        time.sleep(0.1)


def silence_stdout() -> None:
    """Let what is still buffered go nowhere, so that Python does not complain when it flushes at its end."""
    with contextlib.suppress(OSError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
