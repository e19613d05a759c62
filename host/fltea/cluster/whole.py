"""Identifies the noise of a recording that one worker reads whole."""

import hashlib
import time
from pathlib import Path

import msgspec

from fltea.cluster.fetch import local_copy
from fltea.cluster.listing import File
from fltea.cluster.rows import Key, Row, failed, rows_of
from fltea.identification.load import Request
from fltea.identification.run import identify_all
from fltea.identification.settings import Settings
from fltea.identification.workers import Here
from fltea.records.errors import FlteaError, UsageError
from fltea.records.temporary import work_folder
from fltea.records.version import __version__
from fltea.settings.how import AS_IT_SAYS, How
from fltea.settings.limits import DEFAULT_LIMITS, Limits

BLOCK_BYTES = 64_000_000
"""A file of more than this number of bytes is cut into pieces, if its format permits."""


class Ask(msgspec.Struct, frozen=True):
    """Settings for reading and identifying every file."""

    settings: Settings
    channels: tuple[str, ...] | None = None
    how: How = AS_IT_SAYS
    limits: Limits = DEFAULT_LIMITS
    block_bytes: int = BLOCK_BYTES

    def digest(self) -> str:
        """Return a digest that changes with every setting that may change a result."""
        stated = msgspec.json.encode([__version__, msgspec.structs.astuple(self)])
        return hashlib.blake2b(stated, digest_size=8).hexdigest()

    def request(self, path: Path) -> Request:
        """Return the request for one recording, in the form that `fltea.identify` takes."""
        return Request((path,), self.channels, self.how, self.limits)


def identify_file(file: File, ask: Ask) -> list[Row]:
    """Return a row for each axis of one file, or one row with an error.

    Raises:
        OSError: the file is not readable now; its file system may raise other errors.
    """
    key = Key(file, ask.digest())
    begin = time.monotonic()
    with work_folder() as folder:
        try:
            path = local_copy(file, folder, ask.limits)
            (report,) = identify_all([ask.request(path)], ask.settings, Here())
        except FlteaError as error:
            return failed(key, str(error), again=not isinstance(error, UsageError))
    if report.failure is not None:
        reason = str(report.failure).replace(str(path), file.url)
        return failed(key, reason, again=not isinstance(report.failure, UsageError))
    return rows_of(key, report, time.monotonic() - begin)
