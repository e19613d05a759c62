"""Rewrites lines of a text, in any form that programs print, in one of three simple forms (PlainText)."""

from collections.abc import Iterator, Sequence

from fltea.recording.flash_lines import FlashLines
from fltea.recording.label_lines import LabelLines
from fltea.recording.text_forms import plain_lines
from fltea.recording.text_numbers import decoded
from fltea.recording.text_times import A_CLOCK, Clocks


class PlainText:
    """Rewrites the lines of one text so that the reader of text files understands them.

    Each line is then a row of numbers with separators, a JSON object, or numbers with labels. Lines may be
    held back until the rest of their sample has come.

    `columns`: columns that the user names.
    """

    def __init__(self, columns: Sequence[str] | None) -> None:
        self._clocks, self._stages = Clocks(), (FlashLines(columns), LabelLines())

    def take(self, data: bytes, *, is_known: bool) -> bytes | None:
        """Return the lines in a form of the class's docstring; None if all are held back.

        `data`: whole lines, of which the last has no line end.

        `is_known`: whether the columns to read are known.
        """
        data = plain_lines(data)
        if b":" in data and A_CLOCK.search(data):
            data = self._clocks.with_seconds(decoded(data)).encode()
        for stage in self._stages:
            if stage.holds or (not is_known and stage.begins.search(data)):
                lines = stage.take(decoded(data).split("\n"), is_known=is_known)
                data = "\n".join(lines).encode()
                if not lines:
                    return None
        return data

    def finish(self) -> Iterator[bytes]:
        """Yield the lines that were held back, at the end of the text."""
        for stage in self._stages:
            if lines := stage.finish():
                yield "\n".join(lines).encode()
