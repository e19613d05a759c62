"""Reads lines of a text recording from a file or a pipe, with a limit on the length of a line."""

from collections.abc import Iterator
from pathlib import Path
from typing import IO, AnyStr

from fltea.records.errors import UsageError

LONGEST_LINE = 1_000_000
"""Longest line that is read [bytes or characters]. A line of a recording has a few hundred characters."""

LONGEST_SHOWN = 60

BOM, UTF_16 = b"\xef\xbb\xbf", (b"\xff\xfe", b"\xfe\xff")
"""Byte order marks: that of UTF-8, and the two of UTF-16."""


def lines(path: Path, file: IO[AnyStr]) -> Iterator[AnyStr]:
    """Yield the lines of a file, including their line ends.

    Raises:
        UsageError: a line is longer than `LONGEST_LINE`.
    """
    number = 0
    while line := file.readline(LONGEST_LINE + 1):
        number += 1
        if len(line) > LONGEST_LINE:
            raise UsageError(
                f"{path}:{number}: the line has no end within {LONGEST_LINE} characters, so this is no "
                "recording as text. Is it another kind of file, or damaged?"
            )
        yield line


def shown(text: str) -> str:
    """Return text from a file for a message: quoted, shortened, and with control characters escaped."""
    return repr(text if len(text) <= LONGEST_SHOWN else text[:LONGEST_SHOWN] + "…")
