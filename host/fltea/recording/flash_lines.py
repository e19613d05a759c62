"""Reads text logs of ArduPilot, in which FMT rows give the field names for each kind of row.

`FMT, 131, 43, IMU, QBff, TimeUS,I,GyrX,GyrY` names the fields of `IMU, 1745135, 0, 0.01, 0.02`. The rows of
one kind become a table with the header `IMU.TimeUS,IMU.I`, in the form that pymavlink writes. All other lines
become empty.
"""

import re
from collections.abc import Sequence

from fltea.recording.column_names import axis_of

_FORMAT = re.compile(r"FMT,\s*\d+,\s*\d+,\s*(\w+),\s*\w*,\s*(\S.*?)\s*")
_KIND = re.compile(r"(\w+),\s*(.*)")


class FlashLines:
    """Converts the lines of a text log of ArduPilot. The number of lines stays the same.

    The rows of one kind, such as IMU, are kept. `columns`: columns that the user names. A name such as
    `IMU.GyrX` decides the kind. Without such names, the first kind with a gyroscope's axes is kept.
    """

    begins = re.compile(rb"^FMT,[ \t]*\d+,[ \t]*\d+,", re.M)
    """Matches the beginning of an FMT row, which gives the field names of one kind, anywhere in a text."""

    def __init__(self, columns: Sequence[str] | None) -> None:
        self._wanted = {name.partition(".")[0] for name in columns or () if "." in name}
        self._formats: dict[str, list[str]] = {}
        self._kind = ""
        self._held: list[str] = []

    @property
    def holds(self) -> bool:
        """Whether an FMT row was found, so that the text is a log of ArduPilot."""
        return bool(self._formats)

    def take(self, lines: list[str], *, is_known: bool) -> list[str]:
        """Return the converted lines. The line before the first row kept becomes a line of column names."""
        found: list[str] = []
        for line in lines:
            format_ = _FORMAT.fullmatch(line.strip().removeprefix("\ufeff"))
            if format_ is not None:
                self._formats[format_[1]] = [name.strip() for name in format_[2].split(",")]
            if not self._formats or (is_known and not self._kind):
                found.append(line)
                continue
            row = None if format_ is not None else _KIND.fullmatch(line.strip())
            if row is not None and not self._kind and self._is_gyroscope(row[1]):
                self._kind = row[1]
                self._held = [",".join(f"{row[1]}.{name}" for name in self._formats[row[1]])]
            text = row[2] if row is not None and row[1] == self._kind else ""
            if self._kind:
                found += [*self.finish(), text]
            else:
                found += self.finish()
                self._held = [text]
        return found

    def finish(self) -> list[str]:
        """Return the line that `take` holds back: if the first row follows, column names replace it."""
        held, self._held = self._held, []
        return held

    def _is_gyroscope(self, kind: str) -> bool:
        names = self._formats.get(kind, [])
        return kind in self._wanted or (not self._wanted and {"x", "y", "z"} <= {*map(axis_of, names)})
