"""Decompresses data up to a size limit, since a few compressed bytes can expand to any amount."""

import bz2

SMALLEST_WINDOW_BYTES = 8 << 20
"""Smallest limit that is set for the window of a zstd frame [bytes]. The window is the stretch of past data
that a decompressor keeps. The zstd format requires every reader to support windows of 8 MB.
"""


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
