"""A file, or a part of its bytes, where it is worked on: nobody sends samples to anybody."""

import os
import platform
import shutil
from pathlib import Path

from fltea.cluster.content import open_bytes
from fltea.cluster.listing import File
from fltea.records.errors import FlteaError, UsageError
from fltea.records.temporary import named_file
from fltea.settings.limits import DEFAULT_LIMITS, MB, Limits

COPY_BYTES = 1 << 22
LEAST_FREE = 256_000_000
"""Bytes that are left on the disk of temporary files."""


def local_copy(file: File, folder: Path, limits: Limits = DEFAULT_LIMITS) -> Path:
    """The file itself if it is this machine's, else a copy in `folder`, whose name it cannot choose.

    A server may send more than it stated, or state no size: both are looked at while it is copied.

    limits: how much of a file without a size is taken.

    Raises:
        UsageError: it has no size, and more than that.
        FlteaError: it is not the file that was listed any more, or there is no room.
        OSError: and whatever its file system raises.
    """
    if file.protocol == "file":
        # On a disk that is not there, or with rights of its own, it is no fault of the file.
        if not os.access(file.path, os.R_OK):
            raise FlteaError(
                f"{file.url}: is not there, or may not be read, on {platform.node()}. With --dask every "
                "worker has to see it under this name."
            )
        return Path(file.path)
    copy = folder / file.copied_name
    known, copied = file.size >= 0, 0
    check_room(file, max(file.size, 0), folder)
    with open_bytes(file, whole=True) as source, named_file(copy) as out:
        while data := source.read(COPY_BYTES):
            copied += len(data)
            if not known and copied > limits.whole_bytes:
                raise UsageError(
                    f"{file.url}: states no size, and does not end after {limits.max_mb:g} MB, which is "
                    "the limit for such files, since some have no end. If it is longer, raise the limit: "
                    f"--set replay.max_mb={2 * copied // MB}"
                )
            if known and copied > file.size:
                raise FlteaError(
                    f"{file.url}: has more than {file.size} bytes now, and had {file.size} when listed."
                )
            size_text = _mb(file.size) if known else f"of unknown size, and after {_mb(copied)}"
            check_room(file, len(data), folder, size_text)  # others fill the same disk meanwhile
            out.write(data)
    if known and copied < file.size:
        raise FlteaError(f"{file.url}: has {copied} bytes now, and had {file.size} when listed.")
    return copy


def check_room(file: File, size: int, folder: Path, size_text: str = "") -> None:
    """Check that the disk of a folder takes so many bytes of a file.

    size_text: stands for its size in the error.

    Raises:
        FlteaError: it does not; another worker's disk may.
    """
    free = shutil.disk_usage(folder).free
    if size + LEAST_FREE > free:
        raise FlteaError(
            f"{file.url}: {size_text or _mb(size)}, and the worker's disk for temporary files has "
            f"{_mb(free)} left. Set TMPDIR of the workers to a larger one."
        )


def _mb(size: int) -> str:
    return f"{size / 1e6:,.0f} MB"
