"""Files of a user's that are read whole, such as settings: small ones, and each has an end."""

import os
import select
import stat
from pathlib import Path

from fltea.records.errors import UsageError

MOST_BYTES = 4_000_000
PATIENCE_S = 5.0
"""How long a pipe may have nothing to say: one that nobody opens for writing never has."""


def read_small(path: Path, *, what: str = "", most_bytes: int = MOST_BYTES, private: bool = False) -> bytes:
    """Return the content of a file, or of a pipe up to its end.

    what: the setting that names it, for messages, which hold nothing of the file. private: it holds a secret.

    Raises:
        UsageError: it cannot be read, has no end or a long way to it, or others may read what is private.
    """
    name = f"{what} {path}".lstrip()
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        try:
            about = os.fstat(descriptor)
            if private and about.st_mode & stat.S_IRWXO:
                raise UsageError(f"{name}: everybody on this machine may read it. Do: chmod o= {path}")
            if not stat.S_ISREG(about.st_mode):
                most_bytes = min(most_bytes, MOST_BYTES)
            data = bytearray()
            while max(len(data), about.st_size) <= most_bytes:
                chunk = _some(descriptor, name)
                if not chunk:
                    return bytes(data)
                data += chunk
            raise UsageError(f"{name}: has more than {most_bytes} bytes, so it is another kind of file.")
        finally:
            os.close(descriptor)
    except (OSError, ValueError) as error:  # ValueError: a name with a NUL
        raise UsageError(f"{name}: cannot be read ({getattr(error, 'strerror', None) or error}).") from error


def _some(descriptor: int, name: str) -> bytes:
    ready = select.poll()
    ready.register(descriptor, select.POLLIN)
    if not ready.poll(PATIENCE_S * 1e3):
        raise UsageError(f"{name}: nothing came out of this pipe for {PATIENCE_S:g} s.")
    return os.read(descriptor, 1 << 16)
