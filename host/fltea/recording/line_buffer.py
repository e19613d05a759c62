"""Cuts the bytes of a text, which come in pieces of any length, into whole lines."""

from fltea.recording.raw_lines import LONGEST_LINE
from fltea.recording.text_decoding import TextDecoder

TAIL_BYTES = 2000


class LineBuffer:
    """Keeps the bytes of a line that has not ended yet.

    `tail`: last bytes of the lines so far. `has_end`: whether the text ends with a line end. `partial`:
    number of parts of lines that were dropped since the connection to the sender began or was lost within a
    line.
    """

    def __init__(self) -> None:
        self.partial = 0
        self._counts_skipped = False
        self._decoder = TextDecoder()
        self._rest = b""
        self._skipping = False
        self.tail, self.has_end = b"", True

    @property
    def pending_bytes(self) -> int:
        """Number of bytes of a line that has not ended yet."""
        return len(self._rest)

    @property
    def begin(self) -> bytes:
        """First bytes of the text."""
        return self._decoder.begin

    @property
    def is_cut(self) -> bool:
        """Whether the last document of a text in YAML was truncated and left out; False for other texts."""
        return self._decoder.is_cut

    def resume(self, *, within_line: bool) -> None:
        """Drop pending bytes, after the connection to the sender was interrupted.

        `within_line`: whether the next bytes may begin within a line, which is then dropped, too.
        """
        self.partial += bool((self._rest + self._decoder.drop()).strip())
        self._rest, self._skipping, self._counts_skipped = b"", within_line, within_line

    def feed(self, data: bytes) -> bytes | None:
        """Add `data`, and return the lines that end in it, without the last line feed; None if none ends."""
        return self._whole(self._decoder.feed(data, hold=not self._skipping))

    def release(self) -> bytes | None:
        """Return the lines in the bytes that were held back for decoding. Call this at the text's end."""
        return self._whole(self._decoder.release())

    def finish(self) -> bytes:
        """Return the last line of the text, which may lack a line end."""
        rest, self._rest = self._rest + self._decoder.finish(), b""
        self.has_end = not rest or rest.endswith(b"\n")
        return rest.removesuffix(b"\n")

    def drops_too_long(self) -> bool:
        """Drop the line that has not ended yet if it is longer than LONGEST_LINE.

        Return whether it was dropped.
        """
        if len(self._rest) <= LONGEST_LINE:
            return False
        self._rest, self._skipping, self._counts_skipped = b"", True, False
        return True

    def _whole(self, data: bytes) -> bytes | None:
        if self._skipping:
            skipped, end, data = data.partition(b"\n")
            if self._counts_skipped and skipped.strip():
                self.partial += 1
                self._counts_skipped = False
            if not end:
                return None
            self._skipping = False
        whole, end, rest = data.rpartition(b"\n")
        if not end:
            self._rest += data
            return None
        whole, self._rest = self._rest + whole, rest
        self.tail = b"\n".join(filter(None, (self.tail, whole[-TAIL_BYTES:])))[-TAIL_BYTES:]
        return whole
