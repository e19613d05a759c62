"""Packed data, unpacked no further than to a limit: a few bytes can claim to hold any number of them."""

import bz2

SMALLEST_WINDOW_BYTES = 8 << 20
"""A reader of zstd has to have that much, says its format, however small the content."""


def decompressed_zstd(data: bytes, most: int, window: int = 0) -> bytes:
    """What a frame of zstd holds, up to `most` bytes. window: the memory that it may ask for."""
    import zstandard  # an extra, and not every bag needs it

    unpacker = zstandard.ZstdDecompressor(max_window_size=max(window, SMALLEST_WINDOW_BYTES))
    return bytes(unpacker.stream_reader(data).read(most))


def decompressed_lz4(data: bytes, most: int) -> bytes:
    """What a frame of LZ4 holds, up to `most` bytes; of one that is cut, what is there."""
    import lz4.frame

    unpacker = lz4.frame.LZ4FrameDecompressor()
    pieces = [unpacker.decompress(data, most)]
    found = len(pieces[0])
    while found < most and not unpacker.eof and not unpacker.needs_input:
        pieces.append(unpacker.decompress(b"", most - found))
        found += len(pieces[-1])
    return b"".join(pieces)


def decompressed_bz2(data: bytes, most: int) -> bytes:
    """What a stream of bzip2 holds, up to `most` bytes; of one that is cut, what is there."""
    return bz2.BZ2Decompressor().decompress(data, most)
