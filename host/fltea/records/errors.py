"""Every error that a user can cause or meet, and the exit code it ends the command with.

FlteaError                     exit 1  something failed while running
├── UsageError                 exit 2  the command line, the configuration or an input file is wrong
│   └── NoNumbers              exit 2  a recording, or a piece of one, has rows, and no number in any of them
├── Incomplete                 exit 1  some files of a recording cannot be read; the others were used
└── SourceFailed               exit 1  the source gave up, and `--once` says not to wait for it
"""

from collections.abc import Sequence


class FlteaError(Exception):
    """What happened, the likely cause and what to do, in one text for a person."""

    exit_code = 1


class UsageError(FlteaError):
    """The command line, the configuration or an input file is wrong."""

    exit_code = 2


class NoNumbers(UsageError):
    """No row of a recording, or of a piece of one, has all numbers of a sample. rows: how many there are."""

    def __init__(self, text: str, rows: int) -> None:
        super().__init__(text)
        self.rows = rows


class Incomplete(FlteaError):
    """Some files of a recording cannot be read, and the others were used. why: of each file."""

    def __init__(self, why: Sequence[str]) -> None:
        count = "one file" if len(why) == 1 else f"{len(why)} files"
        super().__init__(f"{count} of the recording not read, the others were: {' '.join(why)}")


class SourceFailed(FlteaError):
    """A live source failed and was not to be waited for."""
