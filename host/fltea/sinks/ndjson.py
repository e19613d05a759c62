"""Write one JSON object per line to a binary stream (host/docs/reference/records.md)."""

import io
import sys
import time
from collections.abc import Iterator
from typing import BinaryIO

from fltea.diagnostics.asked import AskedOutput
from fltea.diagnostics.finding import Finding
from fltea.records.block import Block
from fltea.records.ports import Item, Printed, Sink, SinkClosed, Wanted
from fltea.sinks.json_lines import BlockLines
from fltea.sinks.opening import Opening
from fltea.sinks.record_json import record_json

BUFFER = 1 << 18
FULL_S = 0.005


class NdjsonSink(Sink):
    """Writes records as JSON lines. Samples are written only if a setting asks for them.

    `stream`: an unbuffered stream. Otherwise data could stay in its buffer when the program at the other end
    stops reading.
    """

    name = "stdout"
    lossless = True
    capacity = 50_000
    # The pause between two writes serves to write the records of many devices together. Here it can be short,
    # since the records of many devices arrive together anyway, as one text.
    rest_s = 0.0003
    prints: Wanted

    def __init__(self, stream: BinaryIO, *, samples: bool) -> None:
        self._stream = stream
        self.prints = Wanted(samples=samples, estimates=True, corrected=True)
        self._lines = BlockLines()
        self._pending = bytearray()

    def write(self, item: Item) -> None:
        """Encode the item's records, one JSON line each, and keep the lines until `flush` writes them."""
        if isinstance(item, Printed):
            self._pending += item.data
        elif isinstance(item, Block):
            self._lines.add(self._pending, item, self.prints, item.due_rows)
        else:
            self._pending += record_json(item) + b"\n"
        if len(self._pending) >= BUFFER:
            self.flush()

    def flush(self) -> None:
        """Write the JSON lines that `write` has added."""
        try:
            while self._pending:
                written = self._stream.write(self._pending)
                # `write` returns None if the stream has no room and another process has made the stream
                # non-blocking
                if written is None:
                    time.sleep(FULL_S)
                del self._pending[: written or 0]
        except (BrokenPipeError, ValueError) as error:  # ValueError: the stream was closed
            raise SinkClosed from error

    def close(self) -> None:
        """Write the JSON lines that `write` has added; the stream stays open."""
        self.flush()


def open_output(opening: Opening) -> NdjsonSink:
    """Open the output that writes JSON lines to the standard output."""
    stdout = io.FileIO(sys.stdout.fileno(), "wb", closefd=False)
    return NdjsonSink(stdout, samples=opening.program.samples)


def check_output(asked: AskedOutput) -> Iterator[Finding]:
    """Yield nothing: what is wrong with the standard output is not known before it is used."""
    return iter(())
