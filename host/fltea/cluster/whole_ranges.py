"""A stream of a remote file: reading a range of bytes returns the whole range, or fails.

A web server's answer may differ from the request: a proxy may answer instead of the server, cut the body
short, or ignore the range.
"""

import io
from typing import Any

from fltea.cluster.listing import File
from fltea.records.errors import FlteaError


class WholeRanges(io.RawIOBase):
    """A stream of known size; `read` returns as many bytes as requested, except at the end of the stream."""

    def __init__(self, file: File, stream: Any) -> None:
        self._file, self._stream = file, stream

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def tell(self) -> int:
        return int(self._stream.tell())

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        return int(self._stream.seek(offset, whence))

    def read(self, size: int = -1) -> bytes:
        left = max(0, self._stream.size - self.tell())
        wanted = left if size is None or size < 0 else min(size, left)
        data: bytes = self._stream.read(wanted) if wanted else b""
        if len(data) != wanted:
            raise FlteaError(
                f"{self._file.url}: the server sent {len(data)} bytes where {wanted} were asked for. Does a "
                "proxy answer in its place, or is the connection cut off? Give the same command again."
            )
        return data

    def close(self) -> None:
        self._stream.close()
        super().close()
