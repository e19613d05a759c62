"""Reads Excel workbooks (.xlsx)."""

from collections.abc import Iterator, Sequence
from itertools import chain, islice
from pathlib import Path
from typing import Any

from fltea.recording.column_names import axis_of
from fltea.recording.dialects import Facts, dialect_of
from fltea.recording.files import AT_ONCE
from fltea.recording.groups import gyroscopes_in, is_of_accelerometer
from fltea.recording.sheet import Text
from fltea.recording.text_fields import units_in
from fltea.recording.wanted import is_number

HEAD_ROWS, FEW_ROWS = 200, 10
"""The first HEAD_ROWS rows of each sheet are examined. A sheet with at most FEW_ROWS rows holds no table of
samples, but only facts such as the sampling rate.
"""


def read(path: Path, topic: str) -> Text:
    """Return the gyroscope's sheet as lines of text, with tabs between the fields.

    `topic`: name of the sheet to read. If it is empty, the sheet whose columns have a gyroscope's names is
    read, or else the only sheet with a table.
    """
    from openpyxl import load_workbook

    # The workbook is opened as a file object, since openpyxl refuses paths with endings other than .xlsx.
    book = load_workbook(path.open("rb"), read_only=True, data_only=True, keep_links=False)
    parts = [_Part(sheet) for sheet in book.worksheets]
    said = [line for part in parts for line in part.says()]
    if (chosen := next((part for part in parts if part.title == topic), None)) is not None:
        return Text(topic=topic, head=said, pieces=chosen.lines())
    tables = [part for part in parts if len(part.head) > FEW_ROWS]
    named = [part for part in tables if part.has_names]
    others = [part for part in tables if not is_of_accelerometer(f"{part.title}.x")]
    found = named or others or tables or parts
    asked = [part.title for part in found] if len(found) > 1 and tables else []
    return Text(parts=asked, head=said, pieces=found[0].lines())


class _Part:
    """A sheet of the workbook. `head`: first rows of the sheet.

    `has_names`: whether one of the first rows names a gyroscope's columns.
    """

    def __init__(self, sheet: Any) -> None:
        self.title: str = sheet.title
        # some programs state too few rows for a sheet, and openpyxl would not read the rows beyond that
        # number
        sheet.reset_dimensions()
        self._rows = map(_fields, sheet.iter_rows(values_only=True))
        self.head = list(islice(self._rows, HEAD_ROWS))
        group = self.title.replace(".", "_")
        units = [units_in("\t".join(row)) or () for row in (*self.head[1:], ())]
        found = (k for k, row in enumerate(self.head) if _names_gyroscope(group, row, units[k]))
        begin = next(found, None)
        self.has_names = begin is not None
        if begin is None:
            begin = max(range(len(self.head)), key=lambda k: len(self.head[k]), default=0)
        else:
            row, stated = self.head[begin], units[begin]
            beside = stated if len(stated) == len(row) else [""] * len(row)
            self.head[begin] = [_axis(group, name, unit) for name, unit in zip(row, beside, strict=True)]
        self._begin, self._width = begin, len(self.head[begin]) if self.head else 0

    def says(self) -> list[str]:
        """Return the lines of a sheet that consists only of names and values, such as `fs: 100`.

        For any other sheet, return [].
        """
        is_said = len(self.head) < HEAD_ROWS and all(len(row) <= 2 for row in self.head)
        return [": ".join(row) for row in self.head if len(row) == 2] if is_said else []

    def lines(self) -> Iterator[bytes]:
        """Yield all rows of the sheet as text.

        If a row of the sheet's table is shorter than the table's first row, empty cells are added at its end.
        """
        lines: list[str] = []
        for k, row in enumerate(chain(self.head, self._rows)):
            missing = self._width - len(row) if row and k >= self._begin else 0
            lines.append("\t".join(row) + "\t" * missing)
            if len(lines) == AT_ONCE:
                yield "".join(line + "\n" for line in lines).encode()
                lines.clear()
        yield "".join(line + "\n" for line in lines).encode()


def _axis(group: str, name: str, unit: str) -> str:
    """Return a column's name, so that it shows by itself whether the column is a gyroscope's axis.

    If need be, the unit or the name of the sheet is added: `x [deg/s]` or `Gyroscope x`.
    """
    forms = name, f"{name} [{unit}]", f"{group} {name}"
    return next((form for form in forms if axis_of(form)), name) if name else name


def _names_gyroscope(group: str, row: Sequence[str], units: Sequence[str]) -> bool:
    if 2 * sum(map(is_number, row)) >= len(row):
        return False
    beside = units if len(units) == len(row) else ()
    return bool(gyroscopes_in([f"{group}.{name}" for name in row], beside) or dialect_of(row, Facts()))


def _fields(row: Sequence[Any]) -> list[str]:
    """Return the cells of a row as text, without empty cells at its end."""
    filled = next((k for k in range(len(row), 0, -1) if row[k - 1] is not None), 0)
    return ["" if cell is None else _cell(cell) for cell in row[:filled]]


def _cell(value: Any) -> str:
    text = value.isoformat() if hasattr(value, "isoformat") else str(value)
    return text.replace("\t", " ").replace("\n", " ")
