"""A file, or a part of its bytes, where it is worked on: nobody sends samples to anybody."""

import shutil
from pathlib import Path

from fltea.cluster.listing import File, file_system
from fltea.records.errors import FlteaError, UsageError

COPY_BYTES = 1 << 22
LEAST_FREE = 256_000_000
"""Bytes that are left on the disk of temporary files."""


def local_copy(file: File, folder: Path) -> Path:
    """The file itself if it is this machine's, else a copy in `folder`, whose name it cannot choose.

    Raises:
        FlteaError: it is not the file that was listed any more, or there is no room.
        OSError: and whatever its file system raises.
    """
    if file.protocol == "file":
        return Path(file.path)
    copy = folder / f"recording{file.suffix}"
    check_room(file, file.size, folder)
    with (
        file_system(file.protocol).open(file.path, "rb", cache_type="none") as source,
        copy.open("wb") as out,
    ):
        shutil.copyfileobj(source, out, COPY_BYTES)
    if file.size not in (-1, copy.stat().st_size):
        raise FlteaError(f"{file.url}: has {copy.stat().st_size} bytes now, and had {file.size} when listed.")
    return copy


def check_room(file: File, size: int, folder: Path) -> None:
    """Check that the disk of a folder takes so many bytes of a file.

    Raises:
        UsageError: it does not.
    """
    free = shutil.disk_usage(folder).free
    if size + LEAST_FREE > free:
        raise UsageError(
            f"{file.url}: {size / 1e6:.0f} MB, and the worker's disk for temporary files has "
            f"{free / 1e6:.0f} MB left. Let TMPDIR of the workers name a larger one."
        )
