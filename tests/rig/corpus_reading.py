"""The files of the corpus with the options that read each, as the tables of formats and dialects say it."""

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
"""By the name of a file of `tests/recording/corpus`."""

UNREAD_DIALECTS = {name: one.unread for one in dialects() if one.unread for name in one.corpus}
"""Why files of loggers that are known are not read."""

BY_NAME = {name for one in dialects() if one.file for name in one.corpus}
"""Files whose names say what they are."""

FIELDS = {flag: one.name for one in declared(AS_IT_SAYS) for flag in one.setting.flags}


def pairs(options: str) -> dict[str, str]:
    """Return options with their values, as they are typed."""
    words = shlex.split(options)
    return dict(zip(words[::2], words[1::2], strict=True))


def how_of(options: str) -> How:
    """Return what options of the command line say."""
    said = {f"replay.{FIELDS[flag]}": value for flag, value in pairs(options).items()}
    return How(**{path.removeprefix("replay."): value for path, value in of_flags(said).items()})
