"""Read a user name and a password from a file that other users cannot read."""

from pathlib import Path

from fltea.records.errors import UsageError
from fltea.records.small_file import read_small


def read_login(setting: str, file: str | Path) -> tuple[str, str]:
    """Return user name and password from a file.

    `setting`: name of the setting, for messages. Messages quote nothing from the file.

    Raises:
        UsageError: the file cannot be read, everybody may read it, or it is not one line USER:PASSWORD.
    """
    try:
        data = read_small(Path(file), what=setting, most_bytes=4096, private=True)
        lines = data.decode("utf-8-sig").splitlines()  # the codec "utf-8-sig" drops a byte order mark
    except UnicodeDecodeError as error:
        raise UsageError(f"{setting} {file}: cannot be read (not UTF-8).") from error
    user, colon, password = lines[0].partition(":") if len(lines) == 1 else ("", "", "")
    if not (user and colon and password):
        raise UsageError(f"{setting} {file}: must hold one line, USER:PASSWORD.")
    return user, password
