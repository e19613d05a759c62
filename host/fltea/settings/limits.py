"""How much memory a recording may take. It is asked first, since a file can say of itself what it likes."""

from typing import NamedTuple

from fltea.records.errors import UsageError

MB = 1_000_000


class Limits(NamedTuple):
    """The settings `replay.max_chunk_mb` and `replay.max_mb`.

    max_chunk_mb: of one record of an MCAP file, unpacked; of those one is in memory at a time. max_mb: of
    what an .npz or CSV file holds, 8 bytes a number; a day at 100 Hz with all that `fltea export` writes has
    700 MB. It is read a block at a time, but takes as much on the disk for temporary files or, shuffled, in
    memory. The same holds for the bytes of NDJSON that comes through a pipe. seconds: of processor time that
    a small file may take (`recording.quota`); no setting.
    """

    max_chunk_mb: float = 64.0
    max_mb: float = 1024.0
    seconds: float = 5.0

    @property
    def chunk_bytes(self) -> int:
        """The first in bytes."""
        return int(self.max_chunk_mb * MB)

    @property
    def whole_bytes(self) -> int:
        """The second in bytes."""
        return int(self.max_mb * MB)

    def chunk_too_large(self, place: str, size_bytes: int) -> UsageError:
        """What to raise for a record of an MCAP file."""
        return _too_large(place, size_bytes, "max_chunk_mb", self.max_chunk_mb)

    def whole_too_large(self, place: str, size_bytes: int) -> UsageError:
        """What to raise for a file that is read whole."""
        return _too_large(place, size_bytes, "max_mb", self.max_mb)


DEFAULT_LIMITS = Limits()


def _too_large(place: str, size_bytes: int, setting: str, limit_mb: float) -> UsageError:
    size_mb = size_bytes / MB
    return UsageError(
        f"{place}: {size_mb:.6g} MB would be needed in memory, and the limit is {limit_mb:g} MB, since a "
        "damaged or hostile file can claim any size. If you trust it, raise the limit: "
        f"--set replay.{setting}={-(-size_bytes // MB)}"
    )
