"""Standard output as it is found: full, closed, left by its reader, or without letters beyond ASCII."""

import codecs
import contextlib
import errno
import io
import os
import sys
import unicodedata
from typing import Any

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
"""Of characters that need more than their Unicode name or decomposition; see `spelled`."""

SPELL = "fltea.spelled"
"""The name of `spelled` among Python's handlers of what an encoding cannot hold."""


class OutputFailed(OSError):
    """Standard output did not take what was written; other files raise a plain OSError."""

    def as_failure(self) -> FlteaError:
        """Return the sentence on it, with exit code 1."""
        remedy = {
            errno.ENOSPC: " The disk or device that it leads to is full.",
            errno.EDQUOT: " The quota of this user is used up.",
            errno.EFBIG: " The file has become larger than it may be (ulimit -f).",
            errno.EBADF: " It is not open for writing.",
        }.get(self.errno or 0, "")
        return FlteaError(f"cannot write the output: {self}.{remedy}")


class _Raw(io.FileIO):
    """Descriptor 1, with an error of its own."""

    def write(self, data: Any) -> int:
        try:
            return super().write(data)
        except BrokenPipeError:
            raise
        except OSError as error:
            raise OutputFailed(error.errno, error.strerror) from error


def prepare() -> None:
    """Let text come out whatever letters the output has, and its failures be told from those of files.

    Raises:
        UsageError: standard output is closed.
    """
    if sys.stdout is None:
        raise UsageError("standard output is closed; give it a file, a pipe or /dev/null.")
    codecs.register_error(SPELL, spelled)
    found = sys.stdout
    if found is sys.__stdout__ and isinstance(found, io.TextIOWrapper) and found.fileno() == 1:
        sys.stdout = io.TextIOWrapper(
            io.BufferedWriter(_Raw(1, "wb", closefd=False)),
            found.encoding,
            found.errors,
            line_buffering=found.line_buffering,
            write_through=found.write_through,
        )
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper) and not stream.encoding.lower().startswith("utf"):
            stream.reconfigure(errors=SPELL)


def finish() -> None:
    """Write what is still buffered.

    Raises:
        OutputFailed: the output does not take it; a reader that has left is no failure.
    """
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        silence_stdout()


def silence_stdout() -> None:
    """Let what is still buffered go nowhere, so that Python does not complain when it flushes at its end."""
    with contextlib.suppress(OSError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def spelled(error: UnicodeError) -> tuple[str, int]:
    """Return characters in ASCII, as Python's handlers of what cannot be encoded do: α as `alpha`, ² as `^2`.

    Raises:
        UnicodeError: `error` itself, where it is not about writing.
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
