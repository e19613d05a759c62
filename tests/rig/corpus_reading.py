"""List the recordings in tests/recording/corpus with their reading options.

The options come from the program's tables of formats and of dialects (what a logger writes in a format).
"""

import shlex

from fltea.recording.dialects import dialects
from fltea.recording.formats import FORMATS
from fltea.settings.config import of_flags
from fltea.settings.how import AS_IT_SAYS, How
from fltea.settings.setting import declared

OPTIONS: dict[str, str] = {}
for _one in FORMATS.values():
    OPTIONS.update(_one.corpus)
for _dialect in dialects():
    OPTIONS.update(_dialect.corpus)
"""Reading options of each file in `tests/recording/corpus`, by file name."""

UNREAD_DIALECTS = {name: one.unread for one in dialects() if one.unread for name in one.corpus}
"""Example files of known loggers whose files cannot be read. For each file name, the reason."""

BY_NAME = {name for one in dialects() if one.file for name in one.corpus}
"""Files whose logger is recognised by the file name."""

FIELDS = {flag: one.name for one in declared(AS_IT_SAYS) for flag in one.setting.flags}


def pairs(options: str) -> dict[str, str]:
    """Return options with their values, as a user types them."""
    words = shlex.split(options)
    return dict(zip(words[::2], words[1::2], strict=True))


def how_of(options: str) -> How:
    """Return the reading settings that command-line options give."""
    said = {f"replay.{FIELDS[flag]}": value for flag, value in pairs(options).items()}
    return How(**{path.removeprefix("replay."): value for path, value in of_flags(said).items()})
