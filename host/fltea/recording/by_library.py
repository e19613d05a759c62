"""Reads a file of another program with the library for its format; `reader_process` runs this as a program.

The program writes its output to a pipe, whose file descriptor is one of its arguments. The output consists of
blocks, each preceded by its length in four bytes. The first block is a `SheetHead` as JSON, or null. After
null, the program sends a `TextHead` and then text. After a `SheetHead`, it reads one JSON line with the
wanted columns from stdin, and sends the numbers of these columns in rows. A length of 0 ends the output. The
number `FAILED` in place of a length precedes an error message. Stdout is not used, since libraries print to
it; `reader_process` discards stdout.
"""

import sys
from functools import partial
from pathlib import Path
from typing import BinaryIO

import msgspec
import numpy as np

from fltea.recording.formats import FORMATS, loaded
from fltea.recording.process_limits import OUT_OF_MEMORY, ProcessLimits
from fltea.recording.reader_blocks import FAILED, LENGTH
from fltea.recording.sheet import Sheet, SheetHead, Text, TextHead, with_sample
from fltea.records.errors import UsageError
from fltea.records.scarce import is_scarcity


def main(limits: str, descriptor: str, kind: str, path: str, topic: str) -> None:
    """Read a file within the limits of the process, and write the result only to the pipe.

    `limits`: `ProcessLimits` as JSON. `descriptor`: file descriptor of the pipe. `kind`: the file's format.
    `topic`: part of the file to read.
    """
    held = msgspec.json.decode(limits, type=ProcessLimits)
    held.hold()
    out = open(int(descriptor), "wb")  # noqa: SIM115
    send = partial(_send, out, held)
    try:
        found: Sheet | Text = loaded(FORMATS[kind].reader)(Path(path), topic)
        if isinstance(found, Sheet):
            head = msgspec.convert(with_sample(found), SheetHead, from_attributes=True)
            send(msgspec.json.encode(head))
            with held.waiting():
                asked = sys.stdin.buffer.readline()
            places = msgspec.json.decode(asked or b"[]", type=list[int])
            for values in found.blocks(places) if places else ():
                send(np.ascontiguousarray(values).tobytes())
        else:
            send(b"null")
            send(msgspec.json.encode(msgspec.convert(found, TextHead, from_attributes=True)))
            for data in found.pieces:
                send(data)
        send(b"")
    except BrokenPipeError:
        pass
    except UsageError as error:
        _fail(out, str(error).removeprefix(f"{path}: "))
    except Exception as error:  # libraries raise various errors for damaged bytes
        if is_scarcity(error):
            sys.exit(OUT_OF_MEMORY)
        reason = str(error).partition("\n")[0] or type(error).__name__
        _fail(out, f"cannot be read as {FORMATS[kind].title} ({reason}). Is the file whole?")


def _send(out: BinaryIO, limits: ProcessLimits, data: bytes) -> None:
    with limits.waiting():
        out.write(LENGTH.pack(len(data)) + data)
        out.flush()


def _fail(out: BinaryIO, reason: str) -> None:
    out.write(LENGTH.pack(FAILED) + reason.encode(errors="replace"))
    out.flush()


if __name__ == "__main__":
    main(*sys.argv[1:])
