"""Decompresses data up to a size limit, since a few compressed bytes can expand to any amount."""

import bz2
import lzma
from collections.abc import Callable
from typing import BinaryIO

SMALLEST_WINDOW_BYTES = 8 << 20
"""Smallest limit that is set for the window of a zstd frame [bytes]. The window is the stretch of past data
that a decompressor keeps. The zstd format requires every reader to support windows of 8 MB.
"""

CHUNK_BYTES = 1 << 18


def decompressed_zstd(data: bytes, most: int, window: int = 0) -> bytes:
    """Return the content of a zstd frame, up to `most` bytes.

    `window`: largest window, the stretch of past data to keep, that the frame may require [bytes].
    """
    import zstandard  # imported here, since zstandard is an optional package and most bags do not need it

    unpacker = zstandard.ZstdDecompressor(max_window_size=max(window, SMALLEST_WINDOW_BYTES))
    return bytes(unpacker.stream_reader(data).read(most))


def decompressed_lz4(data: bytes, most: int) -> bytes:
    """Return the content of an LZ4 frame, up to `most` bytes; for a truncated frame, the readable part."""
    import lz4.frame

    unpacker = lz4.frame.LZ4FrameDecompressor()
    pieces = [unpacker.decompress(data, most)]
    found = len(pieces[0])
    while found < most and not unpacker.eof and not unpacker.needs_input:
        pieces.append(unpacker.decompress(b"", most - found))
        found += len(pieces[-1])
    return b"".join(pieces)


def decompressed_bz2(data: bytes, most: int) -> bytes:
    """Return the content of a bzip2 stream, up to `most` bytes; for a truncated one, the readable part."""
    return bz2.BZ2Decompressor().decompress(data, most)


class Streams:
    """Decompresses a file of bzip2 or xz, which may hold several streams, one after the other.

    The files of the standard library leave out what follows the last stream without a word. `new`: makes a
    decompressor. `has_rest`: whether other bytes than zeros follow the last stream.
    """

    def __init__(
        self, file: BinaryIO, new: Callable[[], bz2.BZ2Decompressor | lzma.LZMADecompressor]
    ) -> None:
        self.has_rest = False
        self._file, self._new, self._one = file, new, new()

    def read(self, size: int) -> bytes:
        """Return the next bytes, at most `size`; b"" at the end.

        Raises:
            OSError, ValueError, lzma.LZMAError: the data are damaged.
            EOFError: they end too early.
        """
        while not self.has_rest:
            rest, is_next = b"", self._one.eof
            if is_next:
                rest = self._next()
                if not rest:
                    break
                self._one = self._new()
            elif self._one.needs_input:
                rest = self._file.read(CHUNK_BYTES)
                if not rest:
                    raise EOFError
            try:
                if data := self._one.decompress(rest, size):
                    return data
            except (OSError, ValueError, lzma.LZMAError):
                if not is_next:
                    raise
                self.has_rest = True
        return b""

    def _next(self) -> bytes:
        """Return the next bytes behind a stream; zeros there are padding."""
        rest = self._one.unused_data.lstrip(b"\0")
        while not rest and (data := self._file.read(CHUNK_BYTES)):
            rest = data.lstrip(b"\0")
        return rest
