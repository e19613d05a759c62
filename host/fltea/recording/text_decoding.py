"""Decodes a text before it is split into lines.

Converts UTF-16 to UTF-8, carriage returns that end lines to line feeds, and YAML documents to lines.
"""

import codecs
import re

from fltea.recording.raw_lines import BOM, UTF_16
from fltea.recording.text_forms import BEGINNING, YAML, YamlDocuments

BEGIN_BYTES, MOST_HELD = 256, 4096
"""The first BEGIN_BYTES bytes of a text are kept as `TextDecoder.begin`. At most MOST_HELD bytes are held
back while it is unclear whether the text consists of YAML documents.
"""

_LONE_RETURNS = re.compile(rb"(?<![\r\n])\r+(?![\r\n])")
"""Matches carriage returns that end a line. After or before a line feed, they belong to its line end."""


class TextDecoder:
    """Takes the bytes of a text in pieces of any length, and returns lines in UTF-8.

    `begin`: first bytes of the text.

    A few bytes are held back as long as they may be the beginning of a YAML document.
    """

    def __init__(self) -> None:
        self.begin = b""
        self._held, self._returns, self._last = b"", b"", b"\n"
        self._utf_16: codecs.IncrementalDecoder | None = None
        self._yaml: YamlDocuments | None = None
        self._returns, self._last = b"", b"\n"

    @property
    def is_cut(self) -> bool:
        """Whether the last YAML document was truncated and left out."""
        return self._yaml is not None and self._yaml.is_cut

    def drop(self) -> bytes:
        """Delete and return the bytes that are held back.

        Call this if the bytes that follow in the text were lost.
        """
        held, self._held = self._held, b""
        return held

    def feed(self, data: bytes, *, hold: bool = True) -> bytes:
        """Decode the next bytes. `hold`: whether to hold back bytes that may begin a YAML document."""
        if hold and not self.begin:
            data = self._held + data
            if len(data) <= MOST_HELD and BEGINNING.fullmatch(data.removeprefix(BOM)):
                self._held = data
                return b""
        self._held = b""
        return self._lines(data)

    def release(self) -> bytes:
        """Return the bytes that were held back, in decoded form. Call this at the end of the text."""
        held, self._held = self._held, b""
        return self._lines(held)

    def finish(self) -> bytes:
        """Return the last YAML document; the `---` after the document may be missing."""
        return b"" if self._yaml is None else self._yaml.finish()

    def _lines(self, data: bytes) -> bytes:
        if not self.begin:
            self.begin = data[:BEGIN_BYTES]
            if YAML.match(data.removeprefix(BOM)):
                self._yaml = YamlDocuments()
            if data.startswith(UTF_16):  # PowerShell and Excel's "Unicode text" write UTF-16
                self._utf_16 = codecs.getincrementaldecoder("utf-16")("replace")
        if self._utf_16 is not None:
            data = self._utf_16.decode(data).encode()
        data = self._with_line_feeds(data)
        return data if self._yaml is None else self._yaml.feed(data)

    def _with_line_feeds(self, data: bytes) -> bytes:
        """Return a text with a line feed for each carriage return that ends a line, as on old Macs.

        Carriage returns at the end of `data` are held back, since a line feed may follow.
        """
        if b"\r" not in data and not self._returns:
            self._last = data[-1:] or self._last
            return data
        data = self._returns + data
        whole = data.rstrip(b"\r")
        self._returns = data[len(whole) :]
        if whole.count(b"\r") != whole.count(b"\r\n"):
            whole = _LONE_RETURNS.sub(lambda found: b"\n" * len(found[0]), self._last + whole)[1:]
        self._last = whole[-1:] or self._last
        return whole
