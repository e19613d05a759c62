"""Reads live samples as lines of text: `stdin:`, `stdin:FIFO` and `serial-text:PORT?baud=115200`.

The text is CSV with or without a header, or JSON objects. The text is read by the same rules as files
(`fltea.recording.text_rows`). All samples that have arrived together are passed on as one block.
"""

import os
import select
import stat
import sys
import threading
from collections.abc import Iterator
from urllib.parse import parse_qsl

from fltea.process.wake_up import WakeUp
from fltea.records import clock
from fltea.records.errors import UsageError
from fltea.records.events import Chunk, Event, Failed, Opened, TransportEvent
from fltea.records.stats import LinkStats
from fltea.settings.config import Config
from fltea.settings.how import How
from fltea.settings.sources import STDIN
from fltea.sources.opening import Named, port_here
from fltea.sources.text_events import TextEvents
from fltea.wire.ports import TICK_S
from fltea.wire.reader import Reader
from fltea.wire.transport import Port

DEFAULT_BAUD = 115_200
"""Serial speed that the example programs of most boards use [baud]."""

MOST_DIGITS = 9
"""Most digits of a speed; no port has a faster one."""

READ_BYTES = 1 << 16

STANDARD_INPUT = ("", "-", "/dev/stdin")
"""Names of the standard input."""


class PipeText:
    """Reads lines of text from standard input (`stdin:`), or from a FIFO or similar file (`stdin:/tmp/fifo`).

    The source ends when the input ends.

    Raises:
        UsageError: the settings are wrong, or the file does not exist.
    """

    live = False
    prompt = True

    def __init__(self, rest: str, how: How) -> None:
        self._events = TextEvents(f"stdin:{rest}", how, fatal=False)
        self._owned = rest not in STANDARD_INPUT
        self._descriptor = 0
        if self._owned:
            try:
                self._descriptor = os.open(rest, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
            except OSError as error:
                raise UsageError(f"stdin:{rest}: cannot be read ({error.strerror}).") from error
        elif sys.__stdin__ is None:  # descriptor 0 is then that of the file that was opened first
            raise UsageError("stdin: this program was started without a standard input.")
        self._wake_up = WakeUp()
        self._closed = self._begun = False
        self._lock = threading.RLock()

    @property
    def unix_offset_ns(self) -> int:
        """Offset from the monotonic clock to Unix time at present [ns]."""
        return clock.unix_offset_ns()

    @property
    def has_clock(self) -> bool:
        """Whether the text has times, by which the samples are numbered."""
        return self._events.has_clock

    def events(self) -> Iterator[Event]:
        """Yield the events of the text until the input ends or `close` is called."""
        with self._lock:
            if self._closed:
                return
            self._begun = True
        ready = select.poll()
        is_file = stat.S_ISREG(os.fstat(self._descriptor).st_mode)
        ready.register(self._descriptor, select.POLLIN)
        ready.register(self._wake_up, select.POLLIN)
        self._events.open(clock.host_ns(), within_line=False)
        try:
            while not self._closed:
                found = {descriptor for descriptor, _ in ready.poll(TICK_S * 1000)}
                if self._closed:
                    break
                now_ns = clock.host_ns()
                if self._descriptor not in found and not is_file:
                    yield from self._events.tick(now_ns)
                    continue
                try:
                    data = os.read(self._descriptor, READ_BYTES)
                except BlockingIOError:
                    continue
                if not data:
                    yield from self._events.finish(now_ns)
                    return
                yield from self._events.feed(data, now_ns)
            yield from self._events.close(clock.host_ns())
        finally:
            self._release()

    def link_stats(self) -> LinkStats:
        """Return the counts of bytes, of lines with a sample, and of lines without a sample."""
        return self._events.link_stats()

    def close(self) -> None:
        """End the iteration of `events`, which also releases the pipe."""
        with self._lock:
            self._closed = True
            if not self._begun:
                self._release()
        self._wake_up.ring()

    def _release(self) -> None:
        if self._owned:
            self._owned = False
            os.close(self._descriptor)


class SerialText:
    """Reads lines of text from a serial port. If the port is lost, it is opened again.

    `unix_offset_ns`: offset from the monotonic clock to Unix time at the last event [ns].

    Raises:
        UsageError: the settings or the name of the port are wrong.
    """

    live = prompt = True

    def __init__(self, rest: str, how: How) -> None:
        url, baud = parse_serial(rest)
        self._events = TextEvents(f"serial-text:{rest}", how, fatal=True)
        self._reader = Reader(Port(url, baud))
        self.unix_offset_ns = clock.unix_offset_ns()

    @property
    def has_clock(self) -> bool:
        """Whether the text has times, by which the samples are numbered."""
        return self._events.has_clock

    def events(self) -> Iterator[Event]:
        """Yield the events of the text until `close` is called. A separate thread reads the port."""
        self._reader.start()
        for item in self._reader.events(TICK_S):
            if item is not None:
                self.unix_offset_ns = item.unix_offset_ns
            yield from self.take(item)
        yield from self._events.close(clock.host_ns())

    def take(self, item: TransportEvent | None) -> Iterator[Event]:
        """Yield the events of what came from the port.

        An `item` of None says that nothing came for a while.
        """
        match item:
            case None:
                yield from self._events.tick(clock.host_ns())
            case Opened(host_ns, _):
                self._events.open(host_ns, within_line=True)
            case Failed():
                yield from self._events.lost(item)
            case Chunk(data, host_ns, _):
                yield from self._events.feed(data, host_ns)

    def link_stats(self) -> LinkStats:
        """Return the counts of bytes, of lost bytes, and of lines with and without a sample."""
        return self._events.link_stats(self._reader.port.overflow_bytes)

    def close(self) -> None:
        """Stop reading, and release the port."""
        self._reader.close()


def parse_serial(rest: str) -> tuple[str, int]:
    """Return port and speed [baud] from the text after `serial-text:`.

    Raises:
        UsageError: a key is unknown, or the speed is not a number.
    """
    url, mark, query = rest.rpartition("?")
    if not mark or "=" not in query:
        return rest, DEFAULT_BAUD
    baud = DEFAULT_BAUD
    for key, value in parse_qsl(query, keep_blank_values=True):
        if key != "baud" or not (value.isascii() and value.isdigit() and len(value) <= MOST_DIGITS):
            raise UsageError(
                f"serial-text:{rest}: '{key}={value}' is not known. Give the speed as a number: "
                "'serial-text:/dev/ttyUSB0?baud=115200' (in quotes, for the shell knows '?' too)."
            )
        baud = int(value)
    return url, baud


def open_named(named: Named, config: Config) -> PipeText | SerialText:
    """Return the source that reads lines of text from a pipe or from a port."""
    return (PipeText if named.scheme == STDIN else SerialText)(named.place, config.replay.how)


def only_reader_of(named: Named) -> str:
    """Return the pipe, or the port if it is one of this machine."""
    if named.scheme != STDIN:
        return port_here(parse_serial(named.place)[0])
    return "the standard input" if named.place in STANDARD_INPUT else os.path.realpath(named.place)
