"""Opens a recording that is one file, with the reader that the table of formats gives."""

import re
import shlex
from itertools import dropwhile
from pathlib import Path
from typing import NamedTuple, cast

from fltea.recording.files import Stored
from fltea.recording.formats import FORMATS, Kind, loaded
from fltea.recording.kind import is_stream, open_one_file
from fltea.recording.ndjson import Kept, read_ndjson
from fltea.recording.reading import ASK, NotStated, given_options
from fltea.records.errors import UsageError
from fltea.settings.how import AS_IT_SAYS, How
from fltea.settings.limits import DEFAULT_LIMITS, Limits


class Printed(NamedTuple):
    """Records that were read from fltea's own NDJSON output.

    `cut`: warning about a truncated last line, or None.
    """

    records: list[Kept]
    cut: str | None


def open_recording(path: Path, how: How = AS_IT_SAYS, limits: Limits = DEFAULT_LIMITS) -> Stored | Printed:
    """Open a recording for which `kind.is_one_file` is true. Libraries are imported only when needed.

    Raises:
        UsageError: the file is missing, damaged or too large, or an option does not apply to it; the message
            names file, line and reason.
    """
    if not (path.exists() or is_stream(path)):
        raise UsageError(f"{path}: there is no such file.")
    kind, file = open_one_file(path)
    try:
        check_options(path, kind, how)
    except UsageError:
        if file is not None:
            file.close()
        raise
    if kind == "ndjson":
        return Printed(*read_ndjson(path, limits=limits, file=file))
    form = FORMATS[kind]
    said = {"how": how} if form.options else {}
    content = {} if file is None else {"file": file}
    try:
        if form.reader:
            from fltea.recording.reader_process import open_in_process

            return open_in_process(kind, path, how, limits)
        return cast(Stored | Printed, loaded(form.opener)(path, limits=limits, **said, **content))
    except NotStated as error:
        error.args = (_with_command(str(error), path, how),)
        raise


def _with_command(text: str, path: Path, how: How) -> str:
    """Return a question's text with the complete command to type, including the user's options."""
    before, asks, rest = text.partition(ASK)
    options, end, table = rest.partition("\n")
    asked = dropwhile(lambda option: "?" not in option, re.split(r" (?=--)", options))
    # without ./ a name that begins with - would be taken for an option
    name = f"./{path}" if str(path).startswith("-") else str(path)
    command = ["fltea identify", shlex.quote(name), *given_options(how), *asked]
    return f"{before}{asks}{' '.join(command)}{end}{table}" if asks else text


def check_options(path: Path, kind: Kind, how: How) -> None:
    """Raise UsageError if the user gives options about facts that files of this format state themselves."""
    form = FORMATS[kind]
    if flags := how.flags(form.options):
        verb = "are" if len(flags) > 1 else "is"
        raise UsageError(
            f"{path}: {', '.join(flags)} {verb} not for {form.title}, which names its columns, its unit and "
            "its times itself."
        )
