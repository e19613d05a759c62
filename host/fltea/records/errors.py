"""Every error that a user can cause or meet, and the exit code it ends the command with.

FlteaError                     exit 1  something failed while running
├── UsageError                 exit 2  the command line, the configuration or an input file is wrong
│   └── NoNumbers              exit 2  a recording, or a piece of one, has rows, and no number in any of them
├── Incomplete                 exit 1  some of a recording cannot be read; the rest was used
└── SourceFailed               exit 1  the source gave up, and `--once` says not to wait for it
"""

import errno
from collections.abc import Sequence

MOST_SHOWN = 300
"""Characters of a library's own text that a sentence repeats."""

OF_NAMES = frozenset(
    (
        *(errno.ENOENT, errno.EACCES, errno.EPERM, errno.ENAMETOOLONG, errno.ELOOP, errno.EISDIR),
        *(errno.ENOTDIR, errno.EINVAL, errno.ENXIO, errno.ENODEV, errno.EEXIST, errno.EROFS),
    )
)
"""What the system says of a name that cannot be used; all else came while something ran."""


class FlteaError(Exception):
    """What happened, the likely cause and what to do, in one text for a person."""

    exit_code = 1


class UsageError(FlteaError):
    """The command line, the configuration or an input file is wrong."""

    exit_code = 2


class Implausible(UsageError):
    """A column that was taken for a gyroscope's holds what none gives."""


class NoNumbers(UsageError):
    """No row of a recording, or of a piece of one, has all numbers of a sample. rows: how many there are."""

    def __init__(self, text: str, rows: int) -> None:
        super().__init__(text)
        self.rows = rows


class Incomplete(FlteaError):
    """Files of a recording, or pieces of them, cannot be read, and the rest was used. why: of each file."""

    def __init__(self, why: Sequence[str]) -> None:
        super().__init__(f"not all of the recording was read, the rest is used: {' '.join(why)}")


class SourceFailed(FlteaError):
    """A live source failed and was not to be waited for."""


def of_input(error: BaseException) -> FlteaError | None:
    """Return the sentence on an error that words or files of a user's cause and that nothing named better.

    None of all others, which are faults of the program: they keep their traceback.
    """
    kind: type[FlteaError] = UsageError
    happened = "the command line, or a file that it names, cannot be used"
    match error:
        case RecursionError():
            what = "something in it is nested too deeply"
        case UnicodeError():
            what = "a name or a text in it is not UTF-8"
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
        f"{happened}: {shown}. (If that cannot be, this is a fault of fltea: "
        "`python -X dev -m fltea …` shows where.)"
    )


def _said(error: OSError) -> str:
    return f"{error.strerror}: {error.filename}" if error.filename is not None else str(error)
