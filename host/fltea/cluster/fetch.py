"""Makes a file, or a part of its bytes, available on the worker; samples are not sent between workers."""

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
"""Space that must stay free on the disk for temporary files [bytes]."""


def local_copy(file: File, folder: Path, limits: Limits = DEFAULT_LIMITS) -> Path:
    """Return the path of a local file, or of a copy of a remote file in `folder`.

    The name of the copy is `File.copied_name`, so a server cannot choose an arbitrary name.

    A server may send more than the stated size, or state none, so the size is checked while the file is
    copied.

    `limits`: holds the largest size that is copied if the server states no size.

    Raises:
        UsageError: the server states no size, and the file exceeds the limit.
        FlteaError: the file changed since it was listed, or the disk is full.
        OSError: the file system failed; it may raise other errors, too.
    """
    if file.protocol == "file":
        # If a file is missing, the disk may not be mounted, or the worker may lack permission. So this is not
        # reported as the file's fault.
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
            # The free space is checked again for each block, since other programs write to the same disk.
            check_room(file, len(data), folder, size_text)
            out.write(data)
    if known and copied < file.size:
        raise FlteaError(f"{file.url}: has {copied} bytes now, and had {file.size} when listed.")
    return copy


def check_room(file: File, size: int, folder: Path, size_text: str = "") -> None:
    """Check that the disk of a folder has room for `size` bytes of a file.

    `size_text`: the file's size as a text for the error message.

    Raises:
        FlteaError: the disk has no room; the disk of another worker may have enough.
    """
    free = shutil.disk_usage(folder).free
    if size + LEAST_FREE > free:
        raise FlteaError(
            f"{file.url}: {size_text or _mb(size)}, and the worker's disk for temporary files has "
            f"{_mb(free)} left. Set TMPDIR of the workers to a larger one."
        )


def _mb(size: int) -> str:
    return f"{size / 1e6:,.0f} MB"
