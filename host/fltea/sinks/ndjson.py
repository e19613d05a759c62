"""One JSON object a line on a binary stream (host/README.md, Records)."""

from typing import BinaryIO

import msgspec

from fltea.model import AnyRecord, Estimate, Sample
from fltea.sinks import SinkClosed


class NdjsonSink:
    """Writes records as lines; with `prompt` each line goes out at once, else when the buffer fills."""

    def __init__(self, stream: BinaryIO, *, prompt: bool) -> None:
        self._stream = stream
        self._prompt = prompt
        self._encoder = msgspec.json.Encoder()

    def write(self, record: AnyRecord) -> None:
        """Write one line; records that are rare go out at once in any case."""
        line = self._encoder.encode(record) + b"\n"
        try:
            self._stream.write(line)
            if self._prompt or not isinstance(record, Estimate | Sample):
                self._stream.flush()
        except (BrokenPipeError, ValueError) as error:  # ValueError: the stream was closed
            raise SinkClosed from error

    def close(self) -> None:
        """Flush what is buffered."""
        try:
            self._stream.flush()
        except (BrokenPipeError, ValueError) as error:
            raise SinkClosed from error
