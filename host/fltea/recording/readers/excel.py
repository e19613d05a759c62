"""Workbooks of Excel (.xlsx)."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from fltea.recording.files import AT_ONCE


def read(path: Path, _: str) -> Iterator[bytes]:
    """The first sheet with more than ten rows as lines of text, whose fields are separated by tabs."""
    from openpyxl import load_workbook

    # By its name it would be refused without the right ending, whatever it is.
    book = load_workbook(path.open("rb"), read_only=True, data_only=True, keep_links=False)
    sheet = next((one for one in book.worksheets if (one.max_row or 11) > 10), book.worksheets[0])
    sheet.reset_dimensions()  # some programs write wrong ones, and rows beyond them would be missing
    lines: list[str] = []
    for row in sheet.iter_rows(values_only=True):
        lines.append("\t".join("" if cell is None else _cell(cell) for cell in row).rstrip("\t"))
        if len(lines) == AT_ONCE:
            yield "".join(line + "\n" for line in lines).encode()
            lines.clear()
    yield "".join(line + "\n" for line in lines).encode()


def _cell(value: Any) -> str:
    text = value.isoformat() if hasattr(value, "isoformat") else str(value)
    return text.replace("\t", " ").replace("\n", " ")
