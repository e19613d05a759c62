"""Make recordings that state a false size, or that would fill the memory of the program that opens them."""

import io
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path

import lz4.frame
import numpy as np
import zstandard
from fltea.recording.session import SESSION, PartInfo
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Chunk, Header, Metadata
from mcap.writer import MCAP0_MAGIC

MB = 1_000_000


class Files(dict[str, bytes]):
    """A dict of files by name or kind whose short repr keeps hypothesis's output readable."""

    def __repr__(self) -> str:
        return "the files"


def mcap_with(*records: bytes) -> bytes:
    """Return the beginning of a recording that fltea makes, followed by `records`.

    The closing part of an MCAP file is left out.
    """
    builder = RecordBuilder()
    Header("", "hostile").write(builder)
    info = PartInfo("1f0c2b3a", 0, "due", "1.0", 0, 0)
    Metadata(metadata=info.to_metadata(), name=SESSION).write(builder)
    return MCAP0_MAGIC + builder.end() + b"".join(records)


def chunk(compression: str, data: bytes, declared_bytes: int) -> bytes:
    builder = RecordBuilder()
    Chunk(compression, data, 0, 0, 0, declared_bytes).write(builder)
    return bytes(builder.end())


def zeros(compression: str, size_bytes: int) -> bytes:
    """Return `size_bytes` zero bytes, compressed.

    An MCAP reader takes the zeros for records of an unknown type, each of 9 bytes.
    """
    if compression == "lz4":
        return bytes(lz4.frame.compress(bytes(size_bytes)))
    return zstandard.compress(bytes(size_bytes))


LARGE = 600 * MB

MCAP_BOMBS: dict[str, Callable[[], bytes]] = {
    "zstd": lambda: mcap_with(chunk("zstd", zeros("zstd", LARGE), LARGE)),
    "zstd without a size": lambda: mcap_with(chunk("zstd", _streamed_zeros(LARGE), LARGE)),
    "lz4": lambda: mcap_with(chunk("lz4", zeros("lz4", LARGE), LARGE)),
    "many": lambda: mcap_with(*[chunk("zstd", zeros("zstd", LARGE), LARGE)] * 20),
}
"""Functions that make recordings, by name. A reader must refuse each of these recordings, in little
memory.
"""

MCAP_LIES: dict[str, Callable[[], bytes]] = {
    "declares 4.2 GB": lambda: chunk("zstd", zeros("zstd", 900), 4_200 * MB),
    "declares 60 MB": lambda: chunk("zstd", zeros("zstd", 900), 60 * MB),
    "declares 1 kB": lambda: chunk("zstd", zeros("zstd", LARGE), 1000),
    "declares 2^64": lambda: chunk("", b"", 2**64 - 1),
    "lz4 declares 1 kB": lambda: chunk("lz4", zeros("lz4", LARGE), 1000),
    "a frame that declares 4 GB": lambda: chunk("zstd", _frame_declaring(4_200 * MB), 900),
    "an unknown packer": lambda: chunk("\x1b[31mrar", b"", 9),
}
"""Functions that make recordings, by name. In each, one chunk is damaged but not large. A reader must read
the data after that chunk.
"""


def _streamed_zeros(size_bytes: int) -> bytes:
    packer = zstandard.ZstdCompressor().compressobj()
    return packer.compress(bytes(size_bytes)) + packer.flush()


def _frame_declaring(size_bytes: int) -> bytes:
    """Return a zstd frame that declares `size_bytes` bytes of content, but holds one empty block.

    The frame consists of the magic number, a header of a single segment with a size of 8 bytes, and the last
    block, which is stored raw.
    """
    return struct.pack("<IBQ", 0xFD2FB528, 0b11100000, size_bytes) + b"\x01\x00\x00"


def sparse(path: Path, head: bytes, kind: int, length: int) -> Path:
    """Write a sparse file: `head`, then a record of zero bytes.

    The `length` zero bytes occupy no space on the disk.
    """
    with path.open("wb") as file:
        file.write(head + struct.pack("<BQ", kind, length))
        file.truncate(len(head) + 9 + length)
    return path


SPARSE_KINDS = (
    Opcode.CHUNK,
    Opcode.MESSAGE,
    Opcode.METADATA,
    Opcode.SCHEMA,
    Opcode.CHANNEL,
    Opcode.ATTACHMENT,
)


def npy(shape: object, dtype: str, data: bytes, header: bytes | None = None) -> bytes:
    """Return the bytes of an npy file, whose header may be false."""
    text = header or f"{{'descr': '{dtype}', 'fortran_order': False, 'shape': {shape}}}\n".encode()
    return b"\x93NUMPY\x02\x00" + struct.pack("<I", len(text)) + text + data


def npz(path: Path, packing: int = zipfile.ZIP_DEFLATED, **arrays: bytes | object) -> Path:
    """Write an npz file. Values that are bytes are stored unchanged; all others are stored as npy arrays."""
    with zipfile.ZipFile(path, "w", packing) as archive:
        for name, content in arrays.items():
            if not isinstance(content, bytes):
                buffer = io.BytesIO()
                np.save(buffer, np.asarray(content))
                content = buffer.getvalue()
            archive.writestr(f"{name}.npy", content)
    return path


def npz_bombs(folder: Path) -> dict[str, tuple[Path, str]]:
    """Write npz files that must be refused.

    Return a dict by the files' names. A value is the file's path and a word of the expected error message.
    """
    good = {"fs_hz": 100.0, "lsb_per_dps": 16.4}
    rows = 60 * MB
    small = npy((4, 3), "<i2", bytes(24))

    def made(name: str, **arrays: bytes | object) -> Path:
        return npz(folder / f"{name}.npz", **{**good, **arrays})

    return {
        "zeros": (made("zeros", gyro_raw=npy((rows, 3), "|i1", bytes(3 * rows))), "replay.max_mb"),
        "declared only": (made("declared", gyro_raw=npy((10**12, 3), "<i2", b"")), "replay.max_mb"),
        "declared within": (made("within", gyro_raw=npy((10**7, 3), "<i2", b"")), "declares the shape"),
        "wide type": (made("wide", gyro_raw=npy((4, 3), "|V2000000000", b"")), "does not hold numbers"),
        "accel": (
            made("accel", gyro_raw=small, accel_raw=npy((10**12, 3), "<i2", b"")),
            "replay.max_mb",
        ),
        "rate": (made("rate", gyro_raw=small, fs_hz=npy((10**12,), "<f8", b"")), "replay.max_mb"),
        "negative": (made("negative", gyro_raw=npy((-4, -3), "<i2", bytes(24))), "declares the shape"),
        "header": (
            made("header", gyro_raw=npy(0, "", b"", b"{" + b" " * 300 * MB + b"}")),
            "has a header of 300000002 bytes",
        ),
        "brackets": (made("brackets", gyro_raw=npy(0, "", b"", b"(" * 9999)), "cannot be read"),
        "minus signs": (made("minus", gyro_raw=npy(0, "", b"", b"-" * 9998 + b"1")), "cannot be read"),
        "bzip2": (
            npz(folder / "bzip2.npz", zipfile.ZIP_BZIP2, **good, gyro_raw=small),
            "compressed in a way",
        ),
    }
