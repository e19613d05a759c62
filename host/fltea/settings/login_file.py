"""A user and a password from a file that others must not be able to read."""

import os
import stat
from pathlib import Path

from fltea.records.errors import UsageError


def read_login(setting: str, file: str | Path) -> tuple[str, str]:
    """User and password; setting: its name, for messages, which hold nothing of the file.

    Raises:
        UsageError: it cannot be read, everybody may read it, or it is not one line USER:PASSWORD.
    """
    try:
        with Path(file).open(encoding="utf-8") as stream:
            mode = os.fstat(stream.fileno()).st_mode
            lines = stream.read().splitlines()
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8"
        raise UsageError(f"{setting} {file}: cannot be read ({reason}).") from error
    if mode & stat.S_IRWXO:
        raise UsageError(f"{setting} {file}: everybody on this machine may read it. Do: chmod o= {file}")
    user, colon, password = lines[0].partition(":") if len(lines) == 1 else ("", "", "")
    if not (user and colon and password):
        raise UsageError(f"{setting} {file}: must hold one line, USER:PASSWORD.")
    return user, password
