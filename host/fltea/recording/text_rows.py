"""The numbers in the lines of a text recording, a block of lines at a time.

numpy's own reader takes a block at once: a million rows of four numbers in 0.28 s of processor time, where a
loop over rows takes 1.2 s. pyarrow's takes 0.26 s in one thread: too little to have two paths. What numpy's
does not take, such as empty fields and comments, is cleaned first; only a block that is still refused is
looked at line by line, to find the place and the reason.
"""

import contextlib
import csv
import io
import math
import re
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fltea.recording.columns import Chosen
from fltea.recording.lines import LONGEST_LINE, shown
from fltea.recording.table import Rows
from fltea.recording.text_layout import DECIMAL_COMMA, MISSING, Layout, check_surplus, is_blank, is_comment
from fltea.records.errors import UsageError

BLOCK_BYTES = 1 << 18

COMMON_EMPTY = b"", b"NA", b"null"


class Lines(NamedTuple):
    """Successive lines, without their ends. first: the number of the first. cut: the last one has no end."""

    first: int
    lines: list[bytes]
    cut: bool = False


def blocks_of_lines(path: Path, file: BinaryIO) -> Iterator[Lines]:
    """All lines of a file.

    Raises:
        UsageError: a line is longer than any of a recording.
    """
    first, rest = 1, b""
    while data := file.read1(BLOCK_BYTES) if hasattr(file, "read1") else file.read(BLOCK_BYTES):
        whole, end, last = data.rpartition(b"\n")
        if end:
            lines = (rest + whole).split(b"\n")
            yield Lines(first, lines)
            first += len(lines)
            rest = last
        else:
            rest += data
        if len(rest) > LONGEST_LINE:
            raise UsageError(
                f"{path}:{first}: the line has no end within {LONGEST_LINE} characters, so this is no "
                "recording as text. Is it another kind of file, or damaged?"
            )
    if rest:
        yield Lines(first, [rest], cut=True)


class RowReader:
    """Turns lines into rows."""

    def __init__(self, path: Path, layout: Layout, chosen: Chosen) -> None:
        self._path, self._layout, self._chosen = path, layout, chosen
        separator = layout.separator
        if separator is None:
            self._empty = re.compile(r"(?<!\S)(?:na|n/a|null|none)(?!\S)", re.I)
        else:
            s = re.escape(separator)
            self._empty = re.compile(
                rf'(?:^|(?<={s})) *(?:na|n/a|null|none|""|) *(?=[\r ]*$|{s})', re.I | re.M
            )

    def read(self, block: Lines) -> Rows:
        """The rows in some lines.

        Raises:
            UsageError: a field is no number, or not there.
        """
        lines = block.lines
        data = b"\n".join(lines)
        commas = (len(self._layout.first) - 1) * len(lines)
        if self._layout.separator == "," and data.count(b",") > commas:
            self._check_surplus(block)
        if all(lines):
            values = self._at_once(data, len(lines))
            if values is None:
                values = self._at_once(self._filled(data), len(lines))
            if values is not None:
                return Rows(np.arange(block.first, block.first + len(lines)), values)
        texts = data.decode().split("\n")
        kept = [i for i, text in enumerate(texts) if not is_comment(text) and not self._blank(text)]
        numbers = np.array(kept, dtype=np.int64) + block.first
        if not kept:
            return Rows(numbers, np.empty((0, len(self._chosen.places))))
        texts = [texts[i] for i in kept]
        for filled in (str, partial(self._empty.sub, "nan")):
            values = self._at_once(filled("\n".join(texts)).encode(), len(kept))
            if values is not None:
                return Rows(numbers, values)
        cut = None
        if block.cut and self._is_short(texts[-1]):
            cut, numbers, texts = int(numbers[-1]), numbers[:-1], texts[:-1]
        each = [self._one(int(number), text) for number, text in zip(numbers, texts, strict=True)]
        return Rows(numbers, np.array(each).reshape(len(each), len(self._chosen.places)), cut)

    def _check_surplus(self, block: Lines) -> None:
        columns = len(self._layout.first) if self._layout.names is None else len(self._layout.names)
        for number, line in enumerate(block.lines, block.first):
            text = line.decode()
            if text.count(",") >= columns and not is_comment(text):
                with contextlib.suppress(csv.Error):  # that is told with the row
                    check_surplus(f"{self._path}:{number}", self._fields(text), columns)

    def _filled(self, data: bytes) -> bytes:
        """With nan in most of the empty fields; a regular expression, which finds all, takes its time."""
        separator = self._layout.separator
        if separator is None:
            return data
        s = separator.encode()
        for word in COMMON_EMPTY:
            for end in (s, b"\n", b"\r\n"):
                data = data.replace(s + word + end, s + b"nan" + end)
            data = data.replace(s + word + s, s + b"nan" + s)  # every second of a row of them was left
        return data

    def _at_once(self, data: bytes, rows: int) -> NDArray[np.float64] | None:
        text = data.decode()
        if not text or text.isspace():
            return None
        if self._layout.decimal_comma:
            text = text.replace(",", ".")
        try:
            values: NDArray[np.float64] = np.loadtxt(
                io.StringIO(text),
                delimiter=self._layout.separator,
                usecols=self._chosen.places,
                comments=None,
                quotechar='"',
                ndmin=2,
            )
        except ValueError:
            return None
        return values if len(values) == rows and not np.isinf(values).any() else None

    def _blank(self, text: str) -> bool:
        return not text.strip(" \r") if self._layout.separator == "\t" else is_blank(text)

    def _is_short(self, text: str) -> bool:
        try:
            return len(self._fields(text)) <= max(self._chosen.places)
        except csv.Error:
            return True

    def _fields(self, text: str) -> list[str]:
        separator = self._layout.separator
        if separator is None:
            return text.split()
        return next(csv.reader([text], delimiter=separator, strict=True), [])

    def _one(self, number: int, text: str) -> list[float]:
        where = f"{self._path}:{number}"
        try:
            fields = self._fields(text)
        except csv.Error as error:
            raise UsageError(f"{where}: cannot be read as CSV ({error}).") from error
        found = []
        for place, name in zip(self._chosen.places, self._chosen.read, strict=True):
            if place >= len(fields):
                raise UsageError(
                    f"{where}: has {len(fields)} fields; column {shown(name)} is number {place + 1}."
                )
            found.append(self._number(where, name, fields[place].strip()))
        return found

    def _number(self, where: str, name: str, field: str) -> float:
        if field.lower() in MISSING:
            return math.nan
        text = field.replace(",", ".") if self._layout.decimal_comma else field
        try:
            if "_" in text or not text.isascii():  # 1_0 is a number in Python only
                raise ValueError
            value = float(text)
        except ValueError:
            hint = (
                " Decimal commas are read where ';', a tab or blanks separate the columns."
                if DECIMAL_COMMA.fullmatch(field)
                else ""
            )
            raise UsageError(
                f"{where}: column {shown(name)}: {shown(field)} is not a number.{hint}"
            ) from None
        if math.isinf(value):
            raise UsageError(f"{where}: column {shown(name)}: {field} is not a finite number.")
        return value


def decoded_head(lines: Sequence[bytes]) -> list[str]:
    """Lines of a header: UTF-8, or what Windows writes, for units have signs that are not ASCII."""
    texts = []
    for line in lines:
        try:
            texts.append(line.decode())
        except UnicodeDecodeError:
            texts.append(line.decode("cp1252", "replace"))
    return texts
