"""Every error that a user can cause or meet, and the exit code with which it ends the command.

FlteaError                     exit 1  something failed while running
├── UsageError                 exit 2  the command line, the configuration or an input file is wrong
│   └── NoNumbers              exit 2  a recording, or a piece of one, has rows, but none with all numbers
├── Incomplete                 exit 1  part of a recording cannot be read; the rest was used
└── SourceFailed               exit 1  the source failed, and with `--once` the program does not wait for it
"""

import errno
from collections.abc import Sequence

MOST_SHOWN = 300
"""An error message quotes at most this number of characters from a library's own text."""

OF_NAMES = frozenset(
    (
        *(errno.ENOENT, errno.EACCES, errno.EPERM, errno.ENAMETOOLONG, errno.ELOOP, errno.EISDIR),
        *(errno.ENOTDIR, errno.EINVAL, errno.ENXIO, errno.ENODEV, errno.EEXIST, errno.EROFS),
    )
)
"""Numbers of system errors (errno) that mean an unusable file name."""


class FlteaError(Exception):
    """An error whose text tells a person what happened, the likely cause and what to do."""

    exit_code = 1


class UsageError(FlteaError):
    """The command line, the configuration or an input file is wrong."""

    exit_code = 2


class Implausible(UsageError):
    """A column that was read as gyroscope rates holds values that no gyroscope gives."""


class NoNumbers(UsageError):
    """No row of a recording, or of a piece of a recording, has all numbers of a sample.

    `rows`: number of rows in the recording or piece.
    """

    def __init__(self, text: str, rows: int) -> None:
        super().__init__(text)
        self.rows = rows


class Incomplete(FlteaError):
    """Files of a recording, or parts of files, cannot be read; the rest was used.

    `why`: the reason for each unreadable file.
    """

    def __init__(self, why: Sequence[str]) -> None:
        super().__init__(f"a part of the recording could not be read; the rest is used: {' '.join(why)}")


class SourceFailed(FlteaError):
    """A live source failed, and the user asked that the program does not wait for its return (`--once`)."""


def of_input(error: BaseException) -> FlteaError | None:
    """Convert an error that the user's command line or files caused to a `FlteaError`.

    Python raised the error, so its text does not yet tell the user what to do. Return None for errors of
    other types: they are faults of the program, and the user gets their traceback.
    """
    kind: type[FlteaError] = UsageError
    happened = "the command line, or a file that it names, cannot be used"
    match error:
        case RecursionError():
            what = "something in the file is nested too deeply"
        case UnicodeError():
            what = "a name or a text in the file is not UTF-8"
        case OSError() if error.errno == errno.ENOLCK:
            what, kind, happened = _said(error), FlteaError, "the file system has no locks, or none left"
        case OSError() if error.errno is not None and error.errno not in OF_NAMES:
            what, kind, happened = _said(error), FlteaError, "the system refused what the program needs"
        case OSError():
            what = _said(error)
            kind = FlteaError if error.errno is None else UsageError
        case ValueError() | ArithmeticError():
            what = str(error)
        case _:
            return None
    shown = what if len(what) <= MOST_SHOWN else f"{what[:MOST_SHOWN]}…"
    return kind(
        f"{happened}: {shown}. (If this cannot be the cause, it is a fault of fltea: "
        "`python -X dev -m fltea …` shows where.)"
    )


def _said(error: OSError) -> str:
    return f"{error.strerror}: {error.filename}" if error.filename is not None else str(error)
