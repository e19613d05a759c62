"""Files that are written whole or not at all."""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

from fltea.records.errors import FlteaError


@contextlib.contextmanager
def whole_file(out: Path) -> Iterator[Path]:
    """Give the path to write to; at the end that file becomes `out`, and after any failure there is none.

    Raises:
        FlteaError: the file cannot be written; what was at `out` is as it was.
    """
    part = out.with_name(f".{out.name}.part")
    try:
        yield part
        os.replace(part, out)
    except OSError as error:
        raise FlteaError(f"{out}: cannot be written ({error}).") from error
    finally:
        with contextlib.suppress(OSError):
            part.unlink(missing_ok=True)
