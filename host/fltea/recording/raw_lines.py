"""Lines of a text recording, none of them without end, from a file or a pipe."""

from collections.abc import Iterator
from pathlib import Path
from typing import IO, AnyStr

from fltea.records.errors import UsageError

LONGEST_LINE = 1_000_000
"""Bytes or characters; a line of a recording has a few hundred."""

LONGEST_SHOWN = 60

BOM, UTF_16 = b"\xef\xbb\xbf", (b"\xff\xfe", b"\xfe\xff")
"""How text may begin: the mark of UTF-8, and those of UTF-16."""


def lines(path: Path, file: IO[AnyStr]) -> Iterator[AnyStr]:
    """The lines of a file, with their ends.

    Raises:
        UsageError: a line is longer than any of a recording.
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
    """What a file holds, for a message: in quotes, short, and with nothing that a terminal would obey."""
    return repr(text if len(text) <= LONGEST_SHOWN else text[:LONGEST_SHOWN] + "…")
