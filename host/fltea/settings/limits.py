"""Limits of memory for reading a recording, checked before reading, since a file can claim any size."""

from typing import NamedTuple

from fltea.records.errors import UsageError

MB = 1_000_000


class Limits(NamedTuple):
    """The limits for reading a recording: `replay.max_chunk_mb`, `replay.max_mb`, and processor time.

    `max_chunk_mb`: largest decompressed size of one record of an MCAP file, since a whole record is in memory
    [MB]. `max_mb`: largest size of the numbers in an .npz or CSV file, at 8 bytes a number, and of NDJSON
    from a pipe [MB]. A day at 100 Hz with all columns of `fltea export` has 700 MB. These files are read in
    blocks. Temporary files on the disk may become as large as `max_mb`. If the samples are shuffled, the
    memory may become as large.
    `seconds`: processor time that reading a small file may take (`recording.quota`); no setting changes this
    limit.
    """

    max_chunk_mb: float = 64.0
    max_mb: float = 1024.0
    seconds: float = 5.0

    @property
    def chunk_bytes(self) -> int:
        """The limit `max_chunk_mb` in bytes."""
        return int(self.max_chunk_mb * MB)

    @property
    def whole_bytes(self) -> int:
        """The limit `max_mb` in bytes."""
        return int(self.max_mb * MB)

    def chunk_too_large(self, place: str, size_bytes: int) -> UsageError:
        """Return the error that says that a record of an MCAP file is too large."""
        return _too_large(place, size_bytes, "max_chunk_mb", self.max_chunk_mb)

    def whole_too_large(self, place: str, size_bytes: int) -> UsageError:
        """Return the error that says that the content of a file is too large."""
        return _too_large(place, size_bytes, "max_mb", self.max_mb)


DEFAULT_LIMITS = Limits()


def _too_large(place: str, size_bytes: int, setting: str, limit_mb: float) -> UsageError:
    size_mb = size_bytes / MB
    return UsageError(
        f"{place}: {size_mb:.6g} MB would be needed in memory, and the limit is {limit_mb:g} MB. There is a "
        "limit since a damaged or hostile file can claim any size. If you trust the file, raise the limit: "
        f"--set replay.{setting}={-(-size_bytes // MB)}"
    )
