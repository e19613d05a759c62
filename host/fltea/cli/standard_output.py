"""Handle a standard output that is full, is closed, has lost its reader, or is limited to ASCII."""

import codecs
import contextlib
import errno
import io
import os
import sys
import unicodedata
from collections.abc import Iterator

from fltea.records.errors import FlteaError, UsageError

SPELLINGS = {
    ord(character): text
    for characters, text in (
        *(("±", "+/-"), ("√", "sqrt"), ("°", "deg"), ("µμ", "u"), ("·⋅", "*"), ("×", "x"), ("−–—", "-")),
        *(("…", "..."), ("≈", "~"), ("≤", "<="), ("≥", ">="), ("→", "->"), ("∞", "inf"), ("‰", "permille")),
        *(("‘’", "'"), ("“”", '"'), ("λ", "lambda"), ("─━═", "-"), ("│┃║", "|")),
    )
    for character in characters
}
"""ASCII spellings of characters for which Unicode's names and decompositions give no good spelling
(`spelled`).
"""

SPELL = "fltea.spelled"
"""Name under which `spelled` is registered as an error handler of Python's codecs."""


class OutputFailed(OSError):
    """Writing to standard output failed. For other files, the error is a plain OSError."""

    def as_failure(self) -> FlteaError:
        """Return the error for the user, with exit code 1."""
        remedy = {
            errno.ENOSPC: " The disk or device that it leads to is full.",
            errno.EDQUOT: " The quota of this user is used up.",
            errno.EFBIG: " The file has become larger than it may be (ulimit -f).",
            errno.EBADF: " It is not open for writing.",
        }.get(self.errno or 0, "")
        return FlteaError(f"cannot write the output: {self}.{remedy}")


class _Text(io.TextIOWrapper):
    """Standard output that raises `OutputFailed`.

    Only this object, which turns text into bytes, is ours; the object that writes the bytes is Python's own.
    One of ours could be interrupted right after a write, and Python would then write the same bytes again.
    """

    def write(self, text: str) -> int:
        with _told_apart():
            return super().write(text)

    def flush(self) -> None:
        with _told_apart():
            super().flush()


@contextlib.contextmanager
def _told_apart() -> Iterator[None]:
    try:
        yield
    except BrokenPipeError:
        raise
    except OSError as error:
        raise OutputFailed(error.errno, error.strerror) from error


def prepare() -> None:
    """Prepare standard output, so that a failed write raises `OutputFailed`.

    A character that the encoding of standard output or standard error lacks is written as ASCII text
    (`spelled`).

    Raises:
        UsageError: standard output is closed.
    """
    if sys.stdout is None:
        raise UsageError("standard output is closed; give it a file, a pipe or /dev/null.")
    codecs.register_error(SPELL, spelled)
    found = sys.stdout
    if found is sys.__stdout__ and isinstance(found, io.TextIOWrapper) and found.fileno() == 1:
        line_by_line, at_once = found.line_buffering, found.write_through
        sys.stdout = _Text(
            found.buffer, found.encoding, found.errors, line_buffering=line_by_line, write_through=at_once
        )
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper) and not stream.encoding.lower().startswith("utf"):
            stream.reconfigure(errors=SPELL)


def occupy_closed() -> None:
    """Open the null device in place of standard descriptors with which this program was started closed.

    Otherwise the next files that are opened, such as a recording, would get these descriptors, and messages
    for standard error would be written to them. Python's `print` would write these messages to standard
    output.
    """
    for number in (0, 1, 2):
        try:
            os.fstat(number)
        except OSError:  # the system gives the lowest number that is free
            os.open(os.devnull, os.O_RDWR)
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115


def finish() -> None:
    """Write what is still buffered. It is no error if the reader of the output has ended.

    Raises:
        OutputFailed: the buffered text cannot be written. After this error nothing more is written.
    """
    if sys.stdout is None:  # it was closed, which `prepare` has reported
        return
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        silence_stdout()
    except OutputFailed:
        silence_stdout()
        raise


def silence_stdout() -> None:
    """Redirect stdout to /dev/null, so that Python does not complain when it flushes the buffer at exit."""
    with contextlib.suppress(OSError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def spelled(error: UnicodeError) -> tuple[str, int]:
    """Return ASCII text in place of characters that cannot be encoded: `alpha` for α, `^2` for ².

    This is an error handler for Python's codecs: it returns the ASCII text and the position to continue from.

    Raises:
        UnicodeError: `error` itself, if it is not about encoding.
    """
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return "".join(map(_in_ascii, error.object[error.start : error.end])), error.end


def _in_ascii(character: str) -> str:
    known = character.translate(SPELLINGS)
    if known.isascii():
        return known
    parts = unicodedata.decomposition(character)
    plain = unicodedata.normalize("NFKD", character).translate(SPELLINGS)
    plain = plain.encode("ascii", "ignore").decode()
    if plain:
        return f"^{plain}" if parts.startswith("<super>") else plain
    name = unicodedata.name(character, "")
    if name.startswith("GREEK "):
        letter = name.rpartition(" ")[2]
        return letter.lower() if " SMALL " in name else letter.capitalize()
    return "?"
