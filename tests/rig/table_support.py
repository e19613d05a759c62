"""Tables of other programs' files, read here: the process apart takes most of its time to start."""

from pathlib import Path
from typing import Any

from fltea.recording.files import Stored
from fltea.recording.formats import FORMATS, loaded
from fltea.recording.sheet import open_sheet, with_sample
from fltea.records.errors import UsageError
from fltea.settings.how import How
from fltea.settings.limits import DEFAULT_LIMITS


def open_here(kind: str, path: Path, **how: Any) -> Stored:
    """Open a file as `apart.open_apart` does, but for its process. how: fields of `How`."""
    try:
        sheet = loaded(FORMATS[kind].reader)(path, how.get("topic") or "")
    except UsageError as error:
        raise UsageError(str(error) if str(error).startswith(f"{path}: ") else f"{path}: {error}") from error
    return open_sheet(path, with_sample(sheet), How(**how), DEFAULT_LIMITS)
