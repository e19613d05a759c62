"""What a text is as a whole, undone before it is taken as lines: UTF-16, and documents of YAML (pure)."""

import codecs

from fltea.recording.raw_lines import BOM, UTF_16
from fltea.recording.text_forms import BEGINNING, YAML, YamlDocuments

BEGIN_BYTES, MOST_HELD = 256, 4096
"""Of the beginning: what tells a document from lines, and what waits for that."""


class TextDecoder:
    """Takes the bytes of a text, cut anywhere, and gives lines in UTF-8. begin: the first bytes as they came.

    A few bytes are held back while they may still become the beginning of a document.
    """

    def __init__(self) -> None:
        self.begin = b""
        self._held = b""
        self._utf_16: codecs.IncrementalDecoder | None = None
        self._yaml: YamlDocuments | None = None

    @property
    def is_cut(self) -> bool:
        """Whether the last document was cut off, and left out."""
        return self._yaml is not None and self._yaml.is_cut

    def drop(self) -> None:
        """Forget what is held back: what comes next does not follow it."""
        self._held = b""

    def feed(self, data: bytes, *, hold: bool = True) -> bytes:
        """Take the next bytes. hold: they may be the beginning of the text."""
        if hold and not self.begin:
            data = self._held + data
            if len(data) <= MOST_HELD and BEGINNING.fullmatch(data.removeprefix(BOM)):
                self._held = data
                return b""
        self._held = b""
        return self._lines(data)

    def release(self) -> bytes:
        """Return what is held back, as no more bytes come."""
        held, self._held = self._held, b""
        return self._lines(held)

    def finish(self) -> bytes:
        """Return the last document, which may have no end."""
        return b"" if self._yaml is None else self._yaml.finish()

    def _lines(self, data: bytes) -> bytes:
        if not self.begin:
            self.begin = data[:BEGIN_BYTES]
            if YAML.match(data.removeprefix(BOM)):
                self._yaml = YamlDocuments()
            if data.startswith(UTF_16):  # as PowerShell and Excel's "Unicode text" write it
                self._utf_16 = codecs.getincrementaldecoder("utf-16")("replace")
        if self._utf_16 is not None:
            data = self._utf_16.decode(data).encode()
        return data if self._yaml is None else self._yaml.feed(data)
