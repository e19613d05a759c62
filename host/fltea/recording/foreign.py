"""Formats of other programs, each by the library that is kept for it: run as a program by `apart`.

Into a pipe, whose descriptor is an argument, go pieces, each behind its length in four bytes. The first is a
`SheetHead` as JSON, or null. After null come a `TextHead` and lines of text; after a head, and a line of JSON
on stdin, the places of the columns that are wanted, rows of their numbers. The length 0 ends them; FAILED
stands before a reason. Stdout is not for them, since libraries print, in Python and in C: `apart` has it lead
nowhere.
"""

import resource
import sys
from pathlib import Path
from typing import BinaryIO

import msgspec
import numpy as np

from fltea.recording.apart import FAILED, LENGTH
from fltea.recording.formats import FORMATS, loaded
from fltea.recording.sheet import Sheet, SheetHead, Text, TextHead, with_sample
from fltea.records.errors import UsageError


def main(seconds: str, memory: str, descriptor: str, kind: str, path: str, topic: str) -> None:
    """Read a file within so much processor time and address space, and write nothing but to the pipe."""
    for what, most in (
        (resource.RLIMIT_CPU, int(seconds)),
        (resource.RLIMIT_AS, int(memory)),
        (resource.RLIMIT_FSIZE, 0),
        (resource.RLIMIT_CORE, 0),
    ):
        resource.setrlimit(what, (most, most))
    out = open(int(descriptor), "wb")  # noqa: SIM115
    try:
        found: Sheet | Text = loaded(FORMATS[kind].reader)(Path(path), topic)
        if isinstance(found, Sheet):
            head = msgspec.convert(with_sample(found), SheetHead, from_attributes=True)
            _send(out, msgspec.json.encode(head))
            places = msgspec.json.decode(sys.stdin.buffer.readline() or b"[]", type=list[int])
            for values in found.blocks(places) if places else ():
                _send(out, np.ascontiguousarray(values).tobytes())
        else:
            _send(out, b"null")
            _send(out, msgspec.json.encode(msgspec.convert(found, TextHead, from_attributes=True)))
            for data in found.pieces:
                _send(out, data)
        _send(out, b"")
    except BrokenPipeError:
        pass
    except UsageError as error:
        _fail(out, str(error).removeprefix(f"{path}: "))
    except MemoryError:
        _fail(
            out, f"more than the {int(memory) / 1e9:.1f} GB would be needed that a file of its size may take."
        )
    except Exception as error:  # whatever a library raises on damaged bytes
        reason = str(error).partition("\n")[0] or type(error).__name__
        _fail(out, f"cannot be read as {FORMATS[kind].title} ({reason}).")


def _send(out: BinaryIO, data: bytes) -> None:
    out.write(LENGTH.pack(len(data)) + data)
    out.flush()


def _fail(out: BinaryIO, reason: str) -> None:
    out.write(LENGTH.pack(FAILED) + reason.encode(errors="replace"))
    out.flush()


if __name__ == "__main__":
    main(*sys.argv[1:])
