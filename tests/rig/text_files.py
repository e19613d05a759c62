"""Write a text file to a test's folder; read it as a recording, or return the message that refuses it."""

from collections.abc import Callable
from pathlib import Path

import pytest
from fltea.recording.csv_file import open_csv
from fltea.recording.files import Stored
from fltea.records.errors import UsageError
from fltea.settings.how import How


def stored(folder: Path, text: str | bytes, **how: object) -> Stored:
    """Open a file with this text as a recording.

    `how`: fields of `How`.
    """
    path = folder / "rest.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return open_csv(path, How(**how))  # type: ignore[arg-type]


def refusal(folder: Path, text: str | bytes, **how: object) -> str:
    """Return the error message, without the file's name, that refuses a file with this text."""
    return refused(folder / "rest.csv", lambda _: stored(folder, text, **how))


def refused(path: Path, read: Callable[[Path], object]) -> str:
    """Return the error message, without the file's name, with which `read` refuses a file."""
    with pytest.raises(UsageError) as caught:
        read(path)
    return str(caught.value).removeprefix(str(path))
