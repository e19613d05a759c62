"""Formats of other programs, each by the library that is kept for it: run as a program by `apart`.

stdout: pieces, each behind its length in four bytes. The first is a `SheetHead` as JSON, or null. After null
come a `TextHead` and lines of text; after a head, and a line of JSON on stdin, the places of the columns that
are wanted, rows of their numbers. The length 0 ends them; FAILED stands before a reason.
"""

import resource
import sys
from pathlib import Path

import msgspec
import numpy as np

from fltea.recording.apart import FAILED, LENGTH
from fltea.recording.formats import FORMATS, loaded
from fltea.recording.sheet import Sheet, SheetHead, Text, TextHead, with_sample
from fltea.records.errors import UsageError

STDOUT = sys.stdout.buffer


def main(seconds: str, memory: str, kind: str, path: str, topic: str) -> None:
    """Read a file within so much processor time and address space, and write nothing but to stdout."""
    for what, most in (
        (resource.RLIMIT_CPU, int(seconds)),
        (resource.RLIMIT_AS, int(memory)),
        (resource.RLIMIT_FSIZE, 0),
        (resource.RLIMIT_CORE, 0),
    ):
        resource.setrlimit(what, (most, most))
    sys.stdout = sys.stderr  # libraries print, and what the other side reads is not for them
    try:
        found: Sheet | Text = loaded(FORMATS[kind].reader)(Path(path), topic)
        if isinstance(found, Sheet):
            head = msgspec.convert(with_sample(found), SheetHead, from_attributes=True)
            _send(msgspec.json.encode(head))
            places = msgspec.json.decode(sys.stdin.buffer.readline() or b"[]", type=list[int])
            for values in found.blocks(places) if places else ():
                _send(np.ascontiguousarray(values).tobytes())
        else:
            _send(b"null")
            _send(msgspec.json.encode(msgspec.convert(found, TextHead, from_attributes=True)))
            for data in found.pieces:
                _send(data)
        _send(b"")
    except BrokenPipeError:
        pass
    except UsageError as error:
        _fail(str(error).removeprefix(f"{path}: "))
    except MemoryError:
        _fail(f"more than the {int(memory) / 1e9:.1f} GB would be needed that a file of its size may take.")
    except Exception as error:  # whatever a library raises on damaged bytes
        reason = str(error).partition("\n")[0] or type(error).__name__
        _fail(f"cannot be read as {FORMATS[kind].title} ({reason}).")


def _send(data: bytes) -> None:
    STDOUT.write(LENGTH.pack(len(data)) + data)
    STDOUT.flush()


def _fail(reason: str) -> None:
    STDOUT.write(LENGTH.pack(FAILED) + reason.encode(errors="replace"))
    STDOUT.flush()


if __name__ == "__main__":
    main(*sys.argv[1:])
